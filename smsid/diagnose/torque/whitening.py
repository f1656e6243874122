"""Noise of unknown spectrum: whitening by an autoregression per joint, and tests that allow for the rest.

What is left of measured torques is no white noise: it is coloured, larger while moving than at rest, and
shared by joints. Regressions of every joint's residual on its own past take the colour out; tests count the
rest by clusters in time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import toeplitz
from scipy.stats import chi2, f

from smsid.arm.near_rest import variance_ratio
from smsid.arm.regression import MOST_ORDER, autoregression_of
from smsid.diagnose.thresholds import THRESHOLDS

CLUSTERS = THRESHOLDS.torque_stretches

MOST_ROUNDS, SETTLED = 60, 0.003
"""Of expectation and maximisation, and the change of the spectrum's logarithm that ends them."""

LEAST = 1e-12
"""Least standard deviation of an innovation [N m | N]: of a joint whose torque is nothing at all."""


@dataclass(frozen=True)
class Whitening:
    """Coefficients (joints, order) of each joint's autoregression, ``sigma`` (joints,) of its innovations,
    and by what that is larger near rest (joints,).
    """

    coefficients: np.ndarray
    sigma: np.ndarray
    larger_near_rest: np.ndarray | float = 1.0

    @property
    def order(self) -> int:
        """Samples of the past that are looked at."""
        return self.coefficients.shape[1]

    def apply(self, values: np.ndarray, near: np.ndarray) -> np.ndarray:
        """Return values (n, joints, ...) whitened: (n - order, joints, ...); ``near`` (n, joints) is where
        joints are near rest.
        """
        p = self.order
        out = np.array(values[p:])
        shape = (1, -1) + (1,) * (values.ndim - 2)
        for k in range(p):
            out -= self.coefficients[:, k].reshape(shape) * values[p - 1 - k : len(values) - 1 - k]
        sigma = self.sigma * np.where(near[p:], self.larger_near_rest, 1.0)
        return out / sigma.reshape(*sigma.shape, *shape[2:])

    @property
    def slow(self) -> np.ndarray:
        """Standard deviation of the slowest noise (joints,), as of white noise with its power [N m | N]."""
        return self.sigma / np.maximum(np.abs(1.0 - self.coefficients.sum(axis=1)), LEAST)

    @classmethod
    def of(
        cls, residual: np.ndarray, taken: Sequence[np.ndarray], floor: np.ndarray, near: np.ndarray
    ) -> Whitening:
        """Return the whitening of residuals (n, joints) of a fit that has taken directions (n, k) of every
        joint's errors.

        Orders by Bayes's criterion; innovations are no less than ``floor`` (joints,). Errors may be larger
        where joints are near rest, ``near`` (n, joints).
        """
        n, joints = residual.shape
        most = min(MOST_ORDER, max(n // 20, 0))
        coefficients = np.array([_autoregression(residual[:, j], taken[j], most) for j in range(joints)])
        squares = cls(coefficients, np.ones(joints)).apply(residual, near) ** 2
        squares /= np.maximum(1.0 - np.array([share_taken(u) for u in taken]), 0.25)
        there = near[most:]
        squares += floor**2 + LEAST**2
        larger = variance_ratio(squares, there)
        variance = np.mean(squares / np.where(there, larger, 1.0), axis=0)
        return cls(coefficients, np.sqrt(variance), np.sqrt(larger))


def share_taken(directions: np.ndarray) -> float:
    """Return which share of white errors (n,) a fit has taken by its directions (n, k)."""
    return float((directions**2).sum()) / len(directions)


def _autoregression(residual: np.ndarray, taken: np.ndarray, most: int) -> np.ndarray:
    """Return coefficients (most,) of the autoregression, by Bayes's criterion, of errors of which a residual
    (n,) is left; the first is that of the sample before.

    By least squares on what is left, to which at every frequency is added what such noise has where a fit has
    taken it: about expectation and maximisation, from white noise on (exactly, of directions that are waves).
    """
    n, found = len(residual), np.zeros(most)
    if most == 0 or not residual @ residual > 0.0:
        return found
    late = np.stack([residual[most - k : n - k] for k in range(most + 1)])
    products = late @ late.T / (n - most)
    share = np.sum(np.abs(np.fft.rfft(taken, axis=0)) ** 2, axis=1) / n
    white = float(residual @ residual) / max(n * (1.0 - share_taken(taken)), 1.0)
    spectrum = np.full(len(share), white)
    for _ in range(MOST_ROUNDS):
        lost = np.fft.irfft(share * spectrum, n)[: most + 1]
        found, variance = autoregression_of(products + toeplitz(lost), n)
        before = spectrum
        spectrum = variance / np.abs(np.fft.rfft(np.append(1.0, -found), n)) ** 2
        if not np.isfinite(spectrum).all() or np.abs(np.log(spectrum / before)).max() < SETTLED:
            break
    return found


def robust_p_value(basis: np.ndarray, residual: np.ndarray, ratio: float, samples: int) -> float:
    """Return the chance of a likelihood ratio when nothing is there, errors still correlated or uneven.

    Args:
        basis: (samples * joints, d) orthonormal directions tested, sample by sample.
        residual: (samples * joints,) whitened, what the directions explain taken out.
        ratio: squared length of the projection on the directions.
        samples: instants.

    The projection's covariance is taken from its sums over `CLUSTERS` stretches of time, the ratio compared
    with a scaled chi-squared of the same mean and variance (Satterthwaite), the few clusters paid for by an
    F-distribution. Never less than what chi-squared says.
    """
    d = basis.shape[1]
    if d == 0:
        return 1.0
    sums = cluster_projections(basis, residual, samples)
    values = np.linalg.eigvalsh(sums.T @ sums)
    clusters = len(sums)
    total, square = float(values.sum()), float((values**2).sum())
    plain = float(chi2.sf(ratio, d))
    if not total > 0.0:
        return plain
    freedom = total**2 / square
    return max(plain, float(f.sf(ratio / total, freedom, clusters - 1)))


def cluster_projections(basis: np.ndarray, residual: np.ndarray, samples: int) -> np.ndarray:
    """Return the projections of a residual (samples * joints,) on a basis (samples * joints, d) by stretch
    of time, (clusters, d), scaled so that their products sum to the projection's covariance.
    """
    products = (basis * residual[:, None]).reshape(samples, -1, basis.shape[1]).sum(axis=1)
    clusters = min(CLUSTERS, samples)
    starts = np.linspace(0, samples, clusters, endpoint=False).astype(int)
    return np.add.reduceat(products, starts, axis=0) * np.sqrt(clusters / (clusters - 1.0))
