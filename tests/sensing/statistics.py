"""Independent statistics the sensing tests are judged by; no code of smsid."""

import numpy as np
from scipy import stats

FAMILY_LEVEL = 1e-3
"""Chance that one test's whole family of bands is left by chance; seeds are fixed, so a failure stays one."""


def sigma_band(samples: int, family: int) -> tuple[float, float]:
    """Band of sample sigma over true sigma for independent Gaussian samples, Bonferroni over the family."""
    tail = FAMILY_LEVEL / family / 2.0
    degrees = samples - 1
    return tuple(np.sqrt(stats.chi2.ppf([tail, 1.0 - tail], degrees) / degrees))


def mean_band(sigma: float, samples: int, family: int) -> float:
    """Half width of the band of a sample mean about its expectation."""
    return float(stats.norm.isf(FAMILY_LEVEL / family / 2.0) * sigma / np.sqrt(samples))


def allan_deviation(x: np.ndarray, rate: float, tau: float) -> np.ndarray:
    """Overlapping Allan deviation of (N, columns) at one averaging time, from its definition."""
    m = round(tau * rate)
    integral = np.concatenate((np.zeros((1, x.shape[1])), np.cumsum(x, axis=0))) / rate
    second = integral[2 * m :] - 2.0 * integral[m:-m] + integral[: -2 * m]
    return np.sqrt(np.mean(second**2, axis=0) / (2.0 * (m / rate) ** 2))
