"""Base parameters: the combinations of inertial parameters that a regressor can tell apart, readably named.

Column-scaled QR decomposition after Gautier (1991), *Numerical calculation of the base inertial parameters of
robots*.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from smsid.errors import NotIdentifiableError


@dataclass(frozen=True)
class BaseParameters:
    """Identifiable combinations ``beta = K theta``.

    ``independent`` (b,) are the columns kept, ``matrix`` K (b, n) with identity on them, ``names`` readable
    combinations. A regressor Y restricted to ``independent`` satisfies
    ``Y[:, independent] @ beta = Y @ theta``. ``unseen`` are parameters that do not enter at all;
    ``condition`` is the condition number of the kept columns, each scaled to unit norm.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    independent: np.ndarray
    matrix: np.ndarray
    unseen: tuple[str, ...]
    condition: float

    def __len__(self) -> int:
        return len(self.independent)

    def values(self, theta: np.ndarray) -> np.ndarray:
        """Return beta (b,) for parameters theta (n,)."""
        return self.matrix @ theta

    def unlike(self, other: BaseParameters) -> tuple[str, ...]:
        """Return the combinations of either that the other does not tell.

        Compared are the columns kept and the factors, to 1e-6: names are rounded, and a factor half way
        between two roundings is no other combination.
        """
        mine, theirs = (
            {int(i): (name, row) for i, name, row in zip(b.independent, b.names, b.matrix, strict=True)}
            for b in (self, other)
        )
        lost = [{**mine, **theirs}[i][0] for i in sorted(mine.keys() ^ theirs.keys())]
        both = sorted(mine.keys() & theirs.keys())
        changed = [
            mine[i][0] for i in both if not np.allclose(mine[i][1], theirs[i][1], rtol=1e-6, atol=1e-6)
        ]
        return tuple(lost + changed)


DEPENDENT = 1e-8
"""Share of a column below which nothing of it is left beside the others."""


def base_parameters(
    regressor: np.ndarray, names: Sequence[str], units: Sequence[str], *, prefer: Sequence[int] = ()
) -> BaseParameters:
    """Return the base parameters of a regressor (rows, n).

    Columns are scaled to unit norm; one is dependent when what is left of it after projection on those
    before is below `DEPENDENT`. ``prefer`` lists columns to be kept first; the others follow in order,
    that is from the base to the tip: what cannot be told apart is lumped into the body nearer the base, as
    textbooks do. Raises `NotIdentifiableError` when nothing can be identified.
    """
    reduced = _triangle(regressor)
    norm = np.linalg.norm(reduced, axis=0)
    floor = DEPENDENT * max(float(norm.max(initial=0.0)), 1e-300)
    seen = norm > floor
    first = list(dict.fromkeys(prefer))
    order = [i for i in (*first, *(i for i in range(len(names)) if i not in first)) if seen[i]]
    if not order:
        raise NotIdentifiableError(
            "The regressor is zero: nothing moves.", advice="Excite the joints or wheels."
        )
    scaled = reduced[:, order] / norm[order]
    kept: list[int] = []
    basis = np.zeros((scaled.shape[0], 0))
    for k in range(len(order)):
        rest = scaled[:, k]
        for _ in range(2):  # twice is enough (Kahan, Parlett)
            rest = rest - basis @ (basis.T @ rest)
        size = np.linalg.norm(rest)
        if size > DEPENDENT:
            kept.append(k)
            basis = np.column_stack([basis, rest / size])
    independent = np.array([order[k] for k in kept], dtype=int)
    q, r = np.linalg.qr(scaled[:, kept])
    matrix = np.zeros((len(kept), len(names)))
    matrix[:, order] = solve_triangular(r, q.T @ scaled) * norm[order] / norm[independent][:, None]
    matrix[np.abs(matrix) < 1e-7] = 0.0
    matrix[:, independent] = np.eye(len(kept))
    sort = np.argsort(independent)
    independent, matrix = independent[sort], matrix[sort]
    condition = float(np.linalg.cond(scaled[:, kept]))
    return BaseParameters(
        names=tuple(_combination(row, i, names) for row, i in zip(matrix, independent.tolist(), strict=True)),
        units=tuple(str(units[i]) for i in independent.tolist()),
        independent=independent,
        matrix=matrix,
        unseen=tuple(n for n, s in zip(names, seen, strict=True) if not s),
        condition=condition,
    )


def _triangle(regressor: np.ndarray, block: int = 20000) -> np.ndarray:
    """Return R (n, n) of the QR decomposition of a tall matrix, block by block."""
    n = regressor.shape[1]
    r = np.zeros((0, n))
    for start in range(0, len(regressor), block):
        r = np.asarray(np.linalg.qr(np.vstack([r, regressor[start : start + block]]), mode="r"))
    return r


def _combination(row: np.ndarray, own: int, names: Sequence[str]) -> str:
    text = names[own]
    for i in np.flatnonzero(row).tolist():
        if i == own:
            continue
        factor = float(f"{row[i]:.9g}")  # so that a half is rounded alike whatever the last bits are
        sign, size = ("+", factor) if factor > 0 else ("-", -factor)
        text += f" {sign} {names[i]}" if abs(size - 1.0) < 1e-6 else f" {sign} {size:.4g} {names[i]}"
    return text
