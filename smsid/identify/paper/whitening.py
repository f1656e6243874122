"""Inverse of the polynomials in the integral that Exp. 1's regression is built from.

The regression (22) is the transfer function's equation divided by the highest power of s, so noise of the
acceleration enters it as ``Q(s)/s^n``: integrated, hence large where the slosh is. Multiplied by
``s^n/Q(s)`` the noise is white again. Here this is done exactly for the trapezoids that stand for 1/s: the
result solves ``(1 + beta I + kappa I^2) y = x`` section by section.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy  # loads a part of it when that is used

LEAST_DAMPING = 0.01  # damping ratio the filter is given at least: the estimate's may be negative

Section = tuple[float, float]  # (beta [rad/s], kappa [rad^2/s^2]) of s^2 + beta s + kappa


def sections_of(denominator: np.ndarray) -> list[Section]:
    """Return Q(s) = s^n + ..., highest power first (n + 1,) with n even, as stable sections of degree two.

    Roots in the right half plane are mirrored, and no section is damped by less than `LEAST_DAMPING`.
    """
    roots = np.roots(denominator)
    complex_ones = roots[roots.imag > 0.0]
    real = np.sort(np.abs(roots[roots.imag == 0.0].real))
    found = [(2.0 * abs(r.real), abs(r) ** 2) for r in complex_ones]
    found += [(float(a + b), float(a * b)) for a, b in zip(real[::2], real[1::2], strict=True)]
    return [(max(beta, 2.0 * LEAST_DAMPING * np.sqrt(kappa)), float(kappa)) for beta, kappa in found]


def whiten(x: np.ndarray, step: float, sections: Sequence[Section]) -> np.ndarray:
    """Return the solution of ``prod (1 + beta I + kappa I^2) y = x``, I the cumulative trapezoid from zero.

    ``x`` (N, ...) sampled every ``step`` [s]; the same shape and unit come back.
    """
    y = np.asarray(x, dtype=float)
    for beta, kappa in sections:
        b, a = _coefficients(beta, kappa, step)
        lever = 0.5 * step * (beta + 0.5 * kappa * step)
        second = -lever / (1.0 + lever)  # of a unit first sample: the trapezoid starts at zero there
        start = np.array([1.0 - b[0], second - b[1] + a[1]])
        y = scipy.signal.lfilter(b, a, y, axis=0, zi=start.reshape(2, *(1,) * (y.ndim - 1)) * y[:1])[0]
    return y


def whiten_transposed(rows: np.ndarray, step: float, sections: Sequence[Section]) -> np.ndarray:
    """Apply the transpose of `whiten` to rows (n, N); exact but for the first sample, of order ``step``."""
    y = rows[:, ::-1]
    for beta, kappa in sections:
        y = np.asarray(scipy.signal.lfilter(*_coefficients(beta, kappa, step), y, axis=1))
    return y[:, ::-1]


def _coefficients(beta: float, kappa: float, step: float) -> tuple[np.ndarray, np.ndarray]:
    first, second = 0.5 * beta * step, 0.25 * kappa * step**2
    size = 1.0 + first + second
    return np.array([1.0, -2.0, 1.0]) / size, np.array(
        [1.0, (2.0 * second - 2.0) / size, (1.0 - first + second) / size]
    )
