"""Upper bound on the structured singular value by D-G scaling; the lower is a plant, see `worst_parameters`.

mu(N) <= beta when, with D > 0 and G real that commute with the structure (here diagonal, and a number for
each full block; G only for real scalars),

    N^H D N + j (G N - N^H G) - beta^2 D <= 0   (Fan, Tits and Doyle, 1991).

Any such D, G gives a valid bound, the largest generalised eigenvalue; the best are searched by a quasi-Newton
method with the exact gradient. A real scalar repeated r times is given as r real scalars, which can only
raise the bound.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import minimize

from smsid.errors import ControlError

STEPS = 150  # evaluations of the quasi-Newton method
RANGE = 20.0  # largest logarithm of a scaling


@dataclass(frozen=True)
class UncertainBlock:
    """A block of the uncertainty: a ``real`` scalar (``size`` 1), or a full complex block (size, size)."""

    name: str
    size: int
    real: bool

    def __post_init__(self) -> None:
        if self.size < 1 or (self.real and self.size != 1):
            raise ControlError(
                f"The block '{self.name}' of size {self.size} is neither a real scalar nor a full block.",
                advice="Give a repeated real scalar as that many scalars.",
            )


def mu_upper_bound(
    response: np.ndarray, blocks: Sequence[UncertainBlock], start: np.ndarray | None = None
) -> tuple[float, np.ndarray]:
    """Return an upper bound on mu of a matrix, and its scalings, from which a neighbour's search may start.

    Args:
        response: (n, n) complex, dimensionless, n the sum of the blocks' sizes.
        blocks: the structure, in order.
        start: scalings of another matrix.

    Raises:
        ControlError: sizes that do not fit, or entries that are not finite.
    """
    n = np.asarray(response, dtype=complex)
    size = sum(b.size for b in blocks)
    if n.shape != (size, size) or not np.isfinite(n).all():
        raise ControlError(
            f"A matrix of shape {n.shape} does not fit blocks of {size} channels, or is not finite."
        )
    owner = np.repeat(np.arange(len(blocks)), [b.size for b in blocks])
    real = np.flatnonzero([b.real for b in blocks])
    first = _balance_scalings(n, owner, len(blocks))
    choices = [np.concatenate([first, np.zeros(len(real))])]
    if start is not None:
        choices.append(start)
    best = min(choices, key=lambda x: _bound(x, n, owner, real)[0])
    found = minimize(
        _bound,
        best,
        args=(n, owner, real),
        jac=True,
        method="L-BFGS-B",
        bounds=[(-RANGE, RANGE)] * len(blocks) + [(None, None)] * len(real),
        options={"maxfun": STEPS, "maxcor": 30, "ftol": 1e-7},
    )
    scalings = found.x if found.fun <= _bound(best, n, owner, real)[0] else best
    square = _bound(scalings, n, owner, real)[0]
    return float(np.sqrt(max(square, 0.0))), scalings


def _bound(x: np.ndarray, n: np.ndarray, owner: np.ndarray, real: np.ndarray) -> tuple[float, np.ndarray]:
    """Return beta^2 for scalings x = (log D, G / D) and its gradient."""
    count = int(owner[-1]) + 1
    d = np.exp(x[:count])
    diagonal = d[owner]
    ratio = np.zeros(count)
    ratio[real] = x[count:]
    g = (ratio * d)[owner]
    scaled = n.conj().T @ (diagonal[:, None] * n)
    turned = 1j * (g[:, None] * n)
    matrix = scaled + turned + turned.conj().T
    # to an ordinary eigenvalue problem: D^-1/2 . D^-1/2
    root = 1.0 / np.sqrt(diagonal)
    top = len(diagonal) - 1
    values, vectors = eigh(root[:, None] * matrix * root, subset_by_index=(top, top))
    value, y = float(values[0]), root * vectors[:, 0]
    ny = n @ y
    by_d = np.bincount(owner, np.abs(ny) ** 2 - value * np.abs(y) ** 2, minlength=count)
    by_g = np.bincount(owner, -2.0 * np.imag(y.conj() * ny), minlength=count)
    gradient = np.concatenate([d * (by_d + ratio * by_g), (d * by_g)[real]])
    return value, gradient


def _balance_scalings(n: np.ndarray, owner: np.ndarray, count: int) -> np.ndarray:
    """Return log D that evens out the blocks' rows and columns (Osborne, 1960)."""
    size = np.array(
        [[np.linalg.norm(n[np.ix_(owner == i, owner == j)]) for j in range(count)] for i in range(count)]
    )
    np.fill_diagonal(size, 0.0)
    log = np.zeros(count)
    for _ in range(50):
        moved = 0.0
        for k in range(count):
            scale = np.exp(log)
            row = np.linalg.norm(scale[k] * size[k] / scale)
            column = np.linalg.norm(scale * size[:, k] / scale[k])
            if row > 0.0 and column > 0.0:
                step = 0.5 * np.log(column / row)
                log[k] += step
                moved = max(moved, abs(step))
        if moved < 1e-3:
            break
    return np.clip(2.0 * (log - log.mean()), -RANGE, RANGE)  # D is the square of the scaling
