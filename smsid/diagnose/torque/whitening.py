"""Noise of unknown spectrum: whitening by an autoregression per joint, and tests that allow for the rest.

What is left of measured torques is no white noise: it is coloured, larger while moving than at rest, and
shared by joints. Regressions of every joint's residual on its own past take the colour out; tests count the
rest by clusters in time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_toeplitz, solve_triangular, toeplitz
from scipy.stats import chi2, f

from smsid.arm.near_rest import variance_ratio
from smsid.arm.regression import MOST_ORDER
from smsid.diagnose.thresholds import THRESHOLDS

CLUSTERS = THRESHOLDS.torque_stretches

SPECTRUM = 4096
"""Frequencies that an autoregression's covariances are made of."""

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

    def apply_throughout(self, values: np.ndarray, near: np.ndarray) -> np.ndarray:
        """Return values (n, joints, ...) whitened, the first samples as noise that lasts begins: as many."""
        p = self.order
        if p == 0:
            return self.apply(values, near)
        first = np.empty_like(values[:p], dtype=float)
        for j, own in enumerate(self.coefficients):
            power = 1.0 / np.abs(np.fft.rfft(np.append(1.0, -own), SPECTRUM)) ** 2
            root = cholesky(toeplitz(np.fft.irfft(power)[:p]), lower=True) * self.sigma[j]
            first[:, j] = np.tensordot(solve_triangular(root, np.eye(p), lower=True), values[:p, j], 1)
        return np.concatenate([first, self.apply(values, near)])

    @property
    def slow(self) -> np.ndarray:
        """Standard deviation of the slowest noise (joints,), as of white noise with its power [N m | N]."""
        return self.sigma / np.maximum(np.abs(1.0 - self.coefficients.sum(axis=1)), LEAST)

    def only(self, j: slice) -> Whitening:
        """Return that of some of the joints."""
        larger = np.broadcast_to(self.larger_near_rest, self.sigma.shape)
        return Whitening(self.coefficients[j], self.sigma[j], larger[j])

    @classmethod
    def of(
        cls, residual: np.ndarray, spread: Sequence[np.ndarray], floor: np.ndarray, near: np.ndarray
    ) -> Whitening:
        """Return the whitening of errors (n, joints) known but for independent ones, ``spread`` of each joint
        (n, k): what a fit may have taken.

        Orders by Bayes's criterion; innovations are no less than ``floor`` (joints,). Errors may be larger
        where joints are near rest, ``near`` (n, joints).
        """
        n, joints = residual.shape
        most = min(MOST_ORDER, max(n // 20, 0))
        every = [np.column_stack([residual[:, j], spread[j]]) for j in range(joints)]
        coefficients = np.array([_autoregression(x, most) for x in every])
        there, plain = near[most:], cls(coefficients, np.ones(joints))
        squares = np.column_stack(
            [
                (plain.only(slice(j, j + 1)).apply(x[:, None], near[:, [j]]) ** 2).sum(axis=2)
                for j, x in enumerate(every)
            ]
        )
        squares += floor**2 + LEAST**2
        larger = variance_ratio(squares, there)
        variance = np.mean(squares / np.where(there, larger, 1.0), axis=0)
        return cls(coefficients, np.sqrt(variance), np.sqrt(larger))


def _autoregression(x: np.ndarray, most: int) -> np.ndarray:
    """Return coefficients (most,) of the autoregression of independent series (n, k), whose squares add up,
    that Bayes's criterion prefers; the first is that of the sample before.

    Of their products over all samples (Yule and Walker): it is always one of a noise that lasts, as the
    likelihood of all but the first samples is not where the slowest directions are not known.
    """
    n, out = len(x), np.zeros(most)
    products = np.array([np.vdot(x[lag:], x[: n - lag]) for lag in range(most + 1)]) / n
    if not products[0] > 0.0:
        return out
    least = n * np.log(products[0])
    for order in range(1, most + 1):
        found = solve_toeplitz(products[:order], products[1 : order + 1])
        variance = max(float(products[0] - found @ products[1 : order + 1]), 1e-300)
        value = n * np.log(variance) + order * np.log(n)
        if value < least:
            out, least = np.append(found, np.zeros(most - order)), value
    return out


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
