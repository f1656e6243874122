"""How a motion agrees with the samples that encoders took of it, when their clock may be off.

A clock that shows ``tau = offset + drift (t - start)`` too much dates t what happened at t - tau. With the
motion's spline s in true time, a sample y of its angle (or rate) leaves the residual ``y - s(t - tau)``. Its
derivative by the coefficients is the basis there, by tau the rate (or acceleration) of the motion. So
encoders are data like any other sensor, and their clock costs two columns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from smsid.likelihood.spline import MeasuredMotion, Samples, design, smoothness


@dataclass(frozen=True)
class Agreement:
    """Information (n, n) and gradient (n,) by coefficients, joint after joint, offset and drift; and cost."""

    information: np.ndarray
    gradient: np.ndarray
    cost: float


def agreement(motion: MeasuredMotion, coefficients: np.ndarray, clock: np.ndarray) -> Agreement:
    """Return how a motion of ``coefficients`` (m, k) agrees with the samples of ``motion``.

    ``clock`` (2,): offset [s] and drift [1] of the encoders' clock. The cost is the sum of squares of the
    whitened residuals above that of ``motion`` itself.
    """
    m, width = coefficients.shape
    n = m * width
    information, gradient = np.zeros((n + 2, n + 2)), np.zeros(n + 2)
    start = float(motion.spline.t[0])
    for s in motion.samples:
        happened = _happened(s, clock, start)
        basis, slope = (design(happened, motion.spline.t, s.derivative + d) for d in (0, 1))
        # before the start the joints stand still, whatever the time
        rate = np.where((happened < start)[:, None], 0.0, slope @ coefficients)
        left = s.values - basis @ coefficients
        gram = (basis.T @ basis).toarray()
        late = (s.times - start)[:, None]
        for k, weight in enumerate(1.0 / s.sigma**2):
            own = slice(k * m, (k + 1) * m)
            by_clock = -rate[:, k : k + 1] * np.hstack([np.ones_like(late), late])
            information[own, own] += weight * gram
            information[own, n:] += weight * (basis.T @ by_clock)
            information[n:, n:] += weight * (by_clock.T @ by_clock)
            gradient[own] += weight * (basis.T @ left[:, k])
            gradient[n:] += weight * (by_clock.T @ left[:, k])
    smooth = smoothness(m)
    for k, size in enumerate(_largest(motion)):
        own = slice(k * m, (k + 1) * m)
        information[own, own] += size * smooth.toarray()
        gradient[own] -= size * (smooth @ coefficients[:, k])
    information[n:, :n] = information[:n, n:].T
    return Agreement(information, gradient, agreement_cost(motion, coefficients, clock))


def agreement_cost(motion: MeasuredMotion, coefficients: np.ndarray, clock: np.ndarray) -> float:
    """Return the cost of `agreement` alone, for ``coefficients`` (m, k) and ``clock`` (2,)."""
    return _squares(motion, coefficients, clock) - _squares(motion, motion.coefficients, np.zeros(2))


def refit_coefficients(motion: MeasuredMotion, clock: np.ndarray) -> np.ndarray:
    """Return the coefficients (m, k) that agree best with the samples if their clock shows ``clock`` (2,)."""
    m, width = motion.coefficients.shape
    found = agreement(motion, motion.coefficients, clock)
    out = motion.coefficients.copy()
    for k in range(width):
        own = slice(k * m, (k + 1) * m)
        out[:, k] += np.linalg.solve(found.information[own, own], found.gradient[own])
    return out


def _happened(s: Samples, clock: np.ndarray, start: float) -> np.ndarray:
    return s.times - clock[0] - clock[1] * (s.times - start)


def _squares(motion: MeasuredMotion, coefficients: np.ndarray, clock: np.ndarray) -> float:
    total = 0.0
    for s in motion.samples:
        basis = design(_happened(s, clock, float(motion.spline.t[0])), motion.spline.t, s.derivative)
        total += float(np.sum(((s.values - basis @ coefficients) / s.sigma) ** 2))
    smooth = smoothness(len(coefficients))
    return total + float(np.sum(coefficients * (smooth @ coefficients) * _largest(motion)))


def _largest(motion: MeasuredMotion) -> np.ndarray:
    """The largest information of any coefficient, by joint (k,): what smoothness is relative to."""
    return motion.information[:, 0].max(axis=1)
