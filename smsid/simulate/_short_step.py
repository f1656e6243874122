"""A light step for a stretch far shorter than the step the eighth-order method would take.

Inputs that are held restart the integration at every sample. Over 10 ms twelve stages buy an accuracy that
nobody asked for; the fifth order of Dormand and Prince, six stages, is enough there (SciPy's RK45 has the
same coefficients). Its own error estimate decides: a step that misses the tolerance is taken in a few equal
parts, and where these miss it too, left to the eighth order.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.integrate import RK45, DenseOutput

from smsid.kernel.short import MOST_ERROR, PARTS, STAGES

STAGE_ROWS = tuple(np.ascontiguousarray(RK45.A[s, :s]) for s in range(1, STAGES))
STAGE_TIMES = tuple(float(c) for c in RK45.C[1:STAGES])
END = np.ascontiguousarray(RK45.B)
ERRORS = np.ascontiguousarray(RK45.E)
POLYNOMIAL = np.ascontiguousarray(RK45.P.T)


class ShortPiece(DenseOutput):
    """An accepted short step and its fourth-order polynomial; ``rates`` (7, n) at the stages and the end."""

    def __init__(self, t_old: float, t: float, y_old: np.ndarray, y: np.ndarray, rates: np.ndarray) -> None:
        super().__init__(t_old, t)
        self.h, self.y_old, self.y, self.rates = t - t_old, y_old, y, rates

    @property
    def end_rate(self) -> np.ndarray:
        """Rate of the state at the end (n,)."""
        return self.rates[STAGES]

    def _call_impl(self, t: np.ndarray) -> np.ndarray:
        x = (np.asarray(t) - self.t_old) / self.h
        powers = np.cumprod(np.broadcast_to(x, (len(POLYNOMIAL), *x.shape)), axis=0)
        slopes = self.h * (POLYNOMIAL @ self.rates)  # (4, n)
        moved = np.tensordot(slopes.T, powers, axes=1)
        return moved + (self.y_old if x.ndim == 0 else self.y_old[:, None])


def short_steps(
    derivative: Callable[[float, np.ndarray, np.ndarray], np.ndarray],
    t: float,
    y: np.ndarray,
    rate: np.ndarray,
    t_end: float,
    relative: float,
    absolute: float,
) -> list[ShortPiece] | None:
    """Step from (t, y) with its ``rate`` to ``t_end`` [s]: at once, or in equal parts as its error says.

    y and rate (n,); ``derivative`` takes (t, y) and writes the rate into its third argument. Returns ``None``
    when that misses the tolerance.
    """
    piece, error = short_step(derivative, t, y, rate, t_end, relative, absolute)
    if error < 1.0:
        return [piece]
    if not error < MOST_ERROR:
        return None
    found: list[ShortPiece] = []
    count, start = 1 + int(PARTS * error**0.2), t
    for part in range(1, count + 1):
        end = t_end if part == count else start + part * (t_end - start) / count
        piece, error = short_step(derivative, t, y, rate, end, relative, absolute)
        if not error < 1.0:
            return None
        found.append(piece)
        t, y, rate = end, piece.y, piece.end_rate
    return found


def short_step(
    derivative: Callable[[float, np.ndarray, np.ndarray], np.ndarray],
    t: float,
    y: np.ndarray,
    rate: np.ndarray,
    t_end: float,
    relative: float,
    absolute: float,
) -> tuple[ShortPiece, float]:
    """Return the step from (t, y) with its ``rate`` to ``t_end`` [s] and its error in units of the tolerance.

    y and rate (n,); ``derivative`` as for `short_steps`.
    """
    h = t_end - t
    rates = np.empty((STAGES + 1, len(y)))
    rates[0] = rate
    for s, (a, c) in enumerate(zip(STAGE_ROWS, STAGE_TIMES, strict=True), start=1):
        at = np.dot(a, rates[:s])
        at *= h
        at += y
        derivative(t + c * h, at, rates[s])
    new = np.dot(END, rates[:STAGES])
    new *= h
    new += y
    derivative(t_end, new, rates[STAGES])
    error = np.dot(ERRORS, rates)
    error *= h
    error /= absolute + relative * np.maximum(np.abs(y), np.abs(new))
    return ShortPiece(t, t_end, y, new, rates), float(np.sqrt(error @ error / len(y)))
