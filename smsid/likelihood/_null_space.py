"""Directions in parameter space that the data do not see, in physical words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from smsid.likelihood.normal import Normal
from smsid.likelihood.parameters import Parameters
from smsid.model.regressor import INERTIAL_NAMES

SEEN = 1.0  # information of the data relative to the prior's below which a direction is not seen
SMALL = 1e-4  # share of the largest component below which one is left out
UNITS = ("kg", *["kg m"] * 3, *["kg m^2"] * 6)


@dataclass(frozen=True)
class UnseenDirection:
    """Changes of parameters that, made together, leave what was measured as it was.

    ``changes`` by parameter name; the first is one unit (or, of a parameter on its own, its whole value).
    """

    changes: dict[str, float]
    units: dict[str, str]

    @property
    def text(self) -> str:
        """The direction in words."""
        names = list(self.changes)
        if len(names) == 1:
            return f"{names[0]} does not enter what was measured"
        parts = [f"{name} by {value:+.3g} {self.units[name]}" for name, value in self.changes.items()]
        return (
            f"only in combination: {', '.join(names)} "
            f"(changing {', '.join(parts)} leaves what was measured as it was)"
        )


def unseen_directions(at: Parameters, normal: Normal, wide: np.ndarray) -> tuple[UnseenDirection, ...]:
    """Return a sparse basis of the directions in which a wide prior knows more than the data.

    ``wide`` (size,) is that prior's information of every parameter: what a narrower one knows does not make
    the data see less.

    Everything local (poses, biases, the joints' motion) is free: the information is what is left of the
    data's once that is estimated too. Source: the null space of the Fisher information (Rothenberg 1971,
    *Identification in parametric models*), reduced to row echelon form with pivoting.
    """
    width = 1.0 / np.sqrt(wide)
    _, values, vectors = np.linalg.svd(normal.common_root(at.size) * width)
    basis = vectors[values**2 < SEEN] * width
    slopes = np.concatenate([at.sizes.ravel(), [s.slope for s in at.scalars]])
    units = _units(at)
    found = []
    for pivot, row in _echelon(basis / np.where(width > 0, width, 1.0)):
        change = row * width * slopes
        size = np.abs(row) / np.abs(row).max()
        kept = [pivot, *(int(i) for i in np.argsort(-size) if size[i] > SMALL and i != pivot)]
        change = change / change[pivot]
        names = at.names
        found.append(
            UnseenDirection({names[i]: float(change[i]) for i in kept}, {names[i]: units[i] for i in kept})
        )
    return tuple(sorted(found, key=lambda d: len(d.changes)))


def notes(directions: Sequence[UnseenDirection]) -> list[str]:
    """Return what to say about directions, those of single parameters in one sentence."""
    alone = [next(iter(d.changes)) for d in directions if len(d.changes) == 1]
    out = [f"do not enter what was measured, and stay as described: {', '.join(alone)}"] if alone else []
    return out + [d.text for d in directions if len(d.changes) > 1]


def _units(at: Parameters) -> list[str]:
    return [*(UNITS * (at.inertias.size // len(INERTIAL_NAMES))), *(s.unit for s in at.scalars)]


def _echelon(basis: np.ndarray) -> list[tuple[int, np.ndarray]]:
    """Reduced row echelon form (rows, n) with full pivoting: pivot column and row, one at the pivot."""
    rows, pivots = basis.copy(), []
    for i in range(len(rows)):
        flat = np.abs(rows[i:]).argmax()
        r, c = i + int(flat) // rows.shape[1], int(flat) % rows.shape[1]
        rows[[i, r]] = rows[[r, i]]
        rows[i] /= rows[i, c]
        for k in range(len(rows)):
            if k != i:
                rows[k] -= rows[k, c] * rows[i]
        pivots.append(c)
    return list(zip(pivots, rows, strict=True))
