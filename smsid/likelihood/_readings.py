"""How a motion agrees with the samples that encoders took of it, when their clock may be off.

A clock that shows ``tau = offset + drift (t - start)`` too much dates t what happened at t - tau. With the
motion's spline s in true time, a sample y of its angle (or rate) leaves the residual ``y - s(t - tau)``. Its
derivative by the coefficients is the basis there, by tau the rate (or acceleration) of the motion. So
encoders are data like any other sensor, and their clock costs two columns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solveh_banded

from smsid.likelihood.spline import (
    DEGREE,
    DerivativeSamples,
    FittedMotion,
    along,
    bands,
    basis_sums,
    smoothness,
)


@dataclass(frozen=True)
class Agreement:
    """Information and gradient of encoders by coefficients (m, joints), and by offset and drift of the clock.

    ``bands`` (joints, 6, m): diagonal and lower ones by a joint's coefficients; ``by_clock`` (m, joints, 2)
    with the clock, ``of_clock`` (2, 2) its own. ``gradient`` (m, joints), ``clock_gradient`` (2,).
    """

    bands: np.ndarray
    by_clock: np.ndarray
    of_clock: np.ndarray
    gradient: np.ndarray
    clock_gradient: np.ndarray


def agreement(motion: FittedMotion, coefficients: np.ndarray, clock: np.ndarray) -> Agreement:
    """Return how a motion of ``coefficients`` (m, k) agrees with the samples of ``motion``.

    ``clock`` (2,): offset [s] and drift [1] of the encoders' clock.
    """
    m, width = coefficients.shape
    own, by_clock, of_clock = np.zeros((width, DEGREE + 1, m)), np.zeros((m, width, 2)), np.zeros((2, 2))
    gradient, clock_gradient = np.zeros((m, width)), np.zeros(2)
    start = float(motion.spline.t[0])
    for s in motion.samples:
        happened = _true_times(s, clock, start)
        # before the start the joints stand still, whatever the time
        rate = np.where(
            (happened < start)[:, None],
            0.0,
            _motion_derivative(motion, coefficients, happened, s.derivative + 1),
        )
        left = s.values - _motion_derivative(motion, coefficients, happened, s.derivative)
        weight = 1.0 / s.sigma**2
        slopes = -np.stack([rate, rate * (s.times - start)[:, None]], axis=-1)  # (N, k, 2)
        mixed = np.concatenate([slopes.reshape(len(rate), -1), left], axis=1)
        gram, sums = basis_sums(happened, motion.spline.t, s.derivative, mixed)
        own += weight[:, None, None] * gram
        by_clock += weight[:, None] * sums[:, : 2 * width].reshape(m, width, 2)
        of_clock += np.einsum("nki,nkj,k->ij", slopes, slopes, weight)
        gradient += weight * sums[:, 2 * width :]
        clock_gradient += np.einsum("nki,nk,k->i", slopes, left, weight)
    smooth, largest = smoothness(m), _largest(motion)
    own += largest[:, None, None] * bands(smooth)
    gradient -= largest * (smooth @ coefficients)
    return Agreement(own, by_clock, of_clock, gradient, clock_gradient)


def agreement_cost(motion: FittedMotion, coefficients: np.ndarray, clock: np.ndarray) -> float:
    """Return the sum of squares of the whitened residuals above that of ``motion`` itself.

    Of ``coefficients`` (m, k), if the encoders' clock shows ``clock`` (2,) too much.
    """
    return _squares(motion, coefficients, clock) - _squares(motion, motion.coefficients, np.zeros(2))


def refit_coefficients(motion: FittedMotion, clock: np.ndarray) -> np.ndarray:
    """Return the coefficients (m, k) that agree best with the samples if their clock shows ``clock`` (2,)."""
    found = agreement(motion, motion.coefficients, clock)
    pairs = zip(found.bands, found.gradient.T, strict=True)
    return motion.coefficients + np.column_stack([solveh_banded(a, b, lower=True) for a, b in pairs])


def _true_times(s: DerivativeSamples, clock: np.ndarray, start: float) -> np.ndarray:
    return s.times - clock[0] - clock[1] * (s.times - start)


def _motion_derivative(
    motion: FittedMotion, coefficients: np.ndarray, times: np.ndarray, derivative: int
) -> np.ndarray:
    """A derivative (N, k) of the motion of other coefficients at times (N,), as `design` has it."""
    return along(motion.with_coefficients(coefficients).spline, times, derivative)


def _squares(motion: FittedMotion, coefficients: np.ndarray, clock: np.ndarray) -> float:
    total, start = 0.0, float(motion.spline.t[0])
    for s in motion.samples:
        left = s.values - _motion_derivative(motion, coefficients, _true_times(s, clock, start), s.derivative)
        total += float(np.sum((left / s.sigma) ** 2))
    smooth = smoothness(len(coefficients))
    return total + float(np.sum(coefficients * (smooth @ coefficients) * _largest(motion)))


def _largest(motion: FittedMotion) -> np.ndarray:
    """The largest information of any coefficient, by joint (k,): what smoothness is relative to."""
    return motion.information[:, 0].max(axis=1)
