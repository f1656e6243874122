"""Is an attitude read in steps? Quaternions rounded and normalised again point at whole numbers."""

from __future__ import annotations

import numpy as np

ROWS = 60  # readings that are looked at
FIRST = 6  # of them: when most of these are on no grid, it is left at that
ENOUGH = 8  # readings that have to tell the step
ALL = 0.95  # share of the readings that lie on the grid: the rest may be outliers
WITHIN = 2.0  # steps within which the lengths of rounded unit quaternions are: each is within one of it
PRECISIONS = (2e-12, 2e-7)  # of double and of single numbers, a few roundings of them
FINEST = 30_000  # steps to a unit
COARSEST = 0.5  # step above which a few exact attitudes, at right angles to each other, pass for rounded


def step_of(quaternions: np.ndarray, least: float) -> tuple[float, float] | None:
    """Return the step [1] of unit quaternions (N, 4) and its standard deviation; ``None`` where there is none
    or it is below ``least``, at 0.5 or above, or finer than 1 / 30,000.

    Rounded to a step s, a quaternion is n s with n whole; normalised again, it still has the direction of n.
    The smallest n of each reading is found by trial, as one ratio's denominator after the other; their
    lengths are 1 / s within one, or that divided by a common factor.
    """
    if len(quaternions) < ENOUGH:
        return None
    distinct = quaternions[np.append(True, (np.diff(quaternions, axis=0) != 0.0).any(axis=1))]
    some = distinct[np.unique(np.linspace(0, len(distinct) - 1, ROWS).astype(int))]
    if len(some) < ENOUGH:
        return None
    largest = int(min(1.0 / max(least, 1e-12), FINEST))
    for precision in PRECISIONS:
        first = some[:: max(1, len(some) // FIRST)]
        if np.isnan([_length(q, largest, precision) for q in first]).mean() > 0.5:
            continue
        found = _common(np.array([_length(q, largest, precision) for q in some]))
        if found is not None:
            return found
    return None


def _length(q: np.ndarray, largest: int, precision: float) -> float:
    """Return the length of the shortest whole vector that has the direction of ``q``, up to ``largest``."""
    top = np.abs(q).max()
    times = np.arange(1.0, largest + 1.0)
    off = np.zeros(largest)
    for ratio in q / top:
        at = ratio * times
        off = np.maximum(off, np.abs(at - np.round(at)))
    whole = np.flatnonzero(off < precision * times)
    return float(times[whole[0]] / top) if len(whole) else np.nan


def _common(lengths: np.ndarray) -> tuple[float, float] | None:
    """Return the step and its standard deviation that lengths (N,) have in common."""
    seen = lengths[np.isfinite(lengths)]
    if len(seen) < ENOUGH:
        return None
    length = float(np.median(seen[seen > 0.7 * seen.max()]))
    factor = np.round(length / seen)
    near = np.abs(factor * seen - length) < WITHIN
    own = seen[near & (factor == 1.0)]
    if len(own) < ENOUGH or np.count_nonzero(near) < ALL * len(lengths):
        return None
    step = 1.0 / float(own.mean())
    if step >= COARSEST:
        return None
    return step, max(step**2 * float(own.std()), 1e-6 * step)  # those of a slow turn are all alike
