"""A fixed-step Runge-Kutta method of order six and the transition maps of its linearisation.

Butcher's seven stages (*Numerical Methods for Ordinary Differential Equations*, table 333): nodes at the ends
and at thirds and halves of a step, so that nothing is evaluated beyond a jump of the inputs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

STAGES = 7
BLOCK = 20000  # numbers of a matrix of each step that are worked on at a time: they stay in the cache
C = np.array([0.0, 1 / 3, 2 / 3, 1 / 3, 1 / 2, 1 / 2, 1.0])
A = np.zeros((STAGES, STAGES))
A[1, :1] = 1 / 3
A[2, :2] = 0.0, 2 / 3
A[3, :3] = 1 / 12, 1 / 3, -1 / 12
A[4, :4] = -1 / 16, 9 / 8, -3 / 16, -3 / 8
A[5, :5] = 0.0, 9 / 8, -3 / 8, -3 / 4, 1 / 2
A[6, :6] = 9 / 44, -9 / 11, 63 / 44, 18 / 11, 0.0, -16 / 11
B = np.array([11 / 120, 0.0, 27 / 40, 27 / 40, -4 / 15, -4 / 15, 11 / 120])


PLACES = tuple(sorted({*C.tolist()}))  # of the stages in a step: (5,) different ones


def transitions(rate: Sequence[np.ndarray], h: np.ndarray, driven: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return what one step makes of x' = rate x + drive(t): x_next = Phi x + sum of Gamma drive by place.

    ``rate``: seven arrays (steps, n, n), one per stage; ``h`` (steps,) [s]. Returns Phi (steps, n, n)
    and Gamma (steps, n, places, n - driven), `PLACES` in order, by drives of the rows from ``driven`` on.
    From the last stage to the first: the derivative of the end by a slope is that of what it is used for.
    """
    steps, n, _ = rate[0].shape
    phi, gamma = np.empty((steps, n, n)), np.zeros((steps, n, len(PLACES), n - driven))
    block, unit = max(BLOCK // n**2, 1), np.eye(n)
    for first in range(0, steps, block):
        part = slice(first, min(first + block, steps))
        step = h[part, None, None]
        used = np.empty((STAGES, len(step), n, n))
        flat = used.reshape(STAGES, -1)
        for j in range(STAGES - 1, -1, -1):
            own = step * ((A[j + 1 :, j] @ flat[j + 1 :]).reshape(used[j].shape) + B[j] * unit)
            np.matmul(own, rate[j][part], out=used[j])
            gamma[part, :, PLACES.index(C[j])] += own[..., driven:]
        phi[part] = used.sum(axis=0) + unit
    return phi, gamma


def stage_values(rate: Sequence[np.ndarray], starts: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Return the stages (stages, steps, n) of x' = rate x from the ``starts`` (steps, n) of all steps.

    ``rate`` as in `transitions`, ``h`` (steps,) [s].
    """
    values, slopes = np.empty((2, STAGES, *starts.shape))
    for j in range(STAGES):
        values[j] = starts + h[:, None] * np.tensordot(A[j, :j], slopes[:j], axes=1)
        slopes[j] = (rate[j] @ values[j][..., None])[..., 0]
    return values
