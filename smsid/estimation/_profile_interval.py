"""Intervals of parameters that sit at a bound: by the profile of the likelihood, within all bounds."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq, lsq_linear

from smsid._statistics import NORMAL95
from smsid.estimation._normal_equations import NormalEquations
from smsid.estimation._trust_region import REGULARISATION

AT_BOUND_SIGMAS = 1e-6  # standard deviations from its bound within which a parameter sits at it
MOST_DOUBLINGS = 20  # of a trial limit, until the likelihood has fallen far enough


def bound_intervals(found: NormalEquations, widening: float) -> dict[str, tuple[float, float]]:
    """Return the 95 % intervals of the parameters that sit at a bound, by name.

    Those are where the likelihood, at its largest over all other parameters within their bounds, is not below
    the maximum by more than 1.92, ``widening`` squared times as much. Of a Gaussian likelihood that is cut
    off at a bound such an interval covers 95 to 97.5 %, wherever the truth is.
    """
    values = np.array([found.point.value(u) for u in found.unknowns])
    bounds = np.array([(u.lower, u.upper) for u in found.unknowns]).reshape(-1, 2)
    room = (bounds - values[:, None]) / found.scales[:, None]
    sigma = np.sqrt(np.diag(np.linalg.inv(found.gram)))
    out = {}
    for i, u in enumerate(found.unknowns):
        for side in (0, 1):
            if abs(room[i, side]) < AT_BOUND_SIGMAS * sigma[i]:
                reach = profile_limit(found.gram, found.slope, room, i, widening, 1 - side)
                ends = float(values[i]), float(values[i] + reach * u.scale)
                out[u.name] = (min(ends), max(ends))
    return out


def profile_limit(
    gram: np.ndarray, slope: np.ndarray, room: np.ndarray, i: int, widening: float = 1.0, side: int = 1
) -> float:
    """Return how far parameter ``i`` may go, up (``side`` 1) or down (0), before the likelihood is too low.

    ``gram`` (m, m) and ``slope`` (m,) are the normal equations, ``room`` (m, 2) how far all parameters may go
    down and up.
    """
    fall = 0.5 * (NORMAL95 * widening) ** 2
    least = _lowest(gram, slope, room)
    sign, end = (1.0, room[i, 1]) if side else (-1.0, room[i, 0])

    def above(t: float) -> float:
        held = room.copy()
        held[i] = t
        return _lowest(gram, slope, held) - least - fall

    step = NORMAL95 * widening / float(np.sqrt(gram[i, i]))
    for _ in range(MOST_DOUBLINGS):
        if sign * step > sign * end:
            step = float(abs(end))
            break
        if above(sign * step) > 0.0:
            break
        step *= 2.0
    if above(sign * step) <= 0.0:
        return sign * step
    return float(brentq(above, 0.0, sign * step, xtol=1e-6 * step))  # pyright: ignore[reportArgumentType]


def _lowest(gram: np.ndarray, slope: np.ndarray, room: np.ndarray) -> float:
    """Return the lowest value of minus the log-posterior's quadratic form within bounds (m, 2)."""
    fixed = room[:, 1] - room[:, 0] <= 0.0
    step = np.where(fixed, room[:, 0], 0.0)
    free = ~fixed
    if free.any():
        own = gram[np.ix_(free, free)]
        aim = slope[free] - gram[np.ix_(free, fixed)] @ step[fixed]
        size = np.sqrt(np.diag(own))
        share, basis = np.linalg.eigh(own / np.outer(size, size))
        share = np.sqrt(np.maximum(share, 0.0) + REGULARISATION)
        target = basis.T @ (aim / size) / share
        best = basis @ (target / share)
        low, high = (room[free, k] * size for k in (0, 1))
        if (best < low).any() or (best > high).any():
            best = lsq_linear(share[:, None] * basis.T, target, (low, high), method="bvls").x
        step[free] = best / size
    return float(0.5 * step @ gram @ step - slope @ step)
