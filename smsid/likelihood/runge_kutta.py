"""A fixed-step Runge-Kutta method of order six and the transition maps of its linearisation.

Butcher's seven stages (*Numerical Methods for Ordinary Differential Equations*, table 333): nodes at the ends
and at thirds and halves of a step, so that nothing is evaluated beyond a jump of the inputs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

STAGES = 7
BLOCK = 32  # steps worked on at a time, so that they stay in the cache
C = np.array([0.0, 1 / 3, 2 / 3, 1 / 3, 1 / 2, 1 / 2, 1.0])
A = np.zeros((STAGES, STAGES))
A[1, :1] = 1 / 3
A[2, :2] = 0.0, 2 / 3
A[3, :3] = 1 / 12, 1 / 3, -1 / 12
A[4, :4] = -1 / 16, 9 / 8, -3 / 16, -3 / 8
A[5, :5] = 0.0, 9 / 8, -3 / 8, -3 / 4, 1 / 2
A[6, :6] = 9 / 44, -9 / 11, 63 / 44, 18 / 11, 0.0, -16 / 11
B = np.array([11 / 120, 0.0, 27 / 40, 27 / 40, -4 / 15, -4 / 15, 11 / 120])


def transitions(
    rate: Sequence[np.ndarray], drive: Sequence[np.ndarray] | None, h: np.ndarray, *, stages: bool = False
) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]:
    """Return what one step makes of x' = rate(t) x + drive(t): x_next = Phi x + Gamma, and its stages.

    ``rate``: seven arrays (steps, n, n), one per stage, and ``drive`` seven (steps, n, p); ``h`` (steps,)
    [s]. Returns Phi (steps, n, n), Gamma (steps, n, p) and, when asked for, the maps (steps, 7, n, n) from x
    to the homogeneous stage values.
    """
    steps, n, _ = rate[0].shape
    p = 0 if drive is None else drive[0].shape[2]
    end = np.empty((steps, n, n + p))
    maps = np.empty((steps, STAGES, n, n)) if stages else None
    for first in range(0, steps, BLOCK):
        part = slice(first, min(first + BLOCK, steps))
        own = None if drive is None else [d[part] for d in drive]
        end[part] = _block([r[part] for r in rate], own, h[part], None if maps is None else maps[part])
    return end[:, :, :n], None if drive is None else end[:, :, n:], maps


def _block(
    rate: list[np.ndarray], drive: list[np.ndarray] | None, h: np.ndarray, maps: np.ndarray | None
) -> np.ndarray:
    steps, n, _ = rate[0].shape
    width = n if drive is None else n + drive[0].shape[2]
    slopes = np.zeros((STAGES, steps, n, width))
    start = np.zeros((steps, n, width))
    start[:, :, :n] = np.eye(n)
    step = h[:, None, None]
    for j in range(STAGES):
        at = start.copy()
        for i in range(j):
            if A[j, i] != 0.0:
                at += (A[j, i] * step) * slopes[i]
        if maps is not None:
            maps[:, j] = at[:, :, :n]
        np.matmul(rate[j], at, out=slopes[j])
        if drive is not None:
            slopes[j, :, :, n:] += drive[j]
    end = start
    for j in range(STAGES):
        if B[j] != 0.0:
            end = end + (B[j] * step) * slopes[j]
    return end
