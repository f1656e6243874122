"""Unit noise processes on a given time grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from smsid.errors import RecordingError

FloatArray = NDArray[np.float64]


def sampling_rate(times: FloatArray) -> float:
    """Return the sampling rate [Hz], from the median step of ``times`` (N,) [s].

    Raises:
        RecordingError: fewer than two samples.
    """
    if times.size < 2:
        raise RecordingError(
            "The sampling rate of one sample is unknown.", advice="Pass rate.", samples=int(times.size)
        )
    return float(1.0 / np.median(np.diff(times)))


def gauss_markov(
    times: FloatArray, correlation_time: float, shape: tuple[int, ...], rng: np.random.Generator
) -> FloatArray:
    """Return a stationary first-order Gauss-Markov process of unit variance, exact at ``times``.

    Args:
        times: (N,) increasing [s].
        correlation_time: lag at which the correlation is 1/e [s].
        shape: (N, ...) of the result; every column is independent.
        rng: source of the draws.
    """
    white = rng.standard_normal(shape)
    keep = np.exp(-np.diff(times) / correlation_time)
    innovation = np.sqrt(-np.expm1(-2.0 * np.diff(times) / correlation_time))
    white[1:] *= innovation.reshape(-1, *(1,) * (len(shape) - 1))
    if keep.size and np.ptp(keep) <= 1e-12:
        return np.asarray(lfilter([1.0], [1.0, -float(np.mean(keep))], white, axis=0))
    for k, factor in enumerate(keep):
        white[k + 1] += factor * white[k]
    return white


def random_walk(times: FloatArray, shape: tuple[int, ...], rng: np.random.Generator) -> FloatArray:
    """Return a Wiener process of unit density: zero at the first time, variance ``t - t_0`` [s].

    Args:
        times: (N,) increasing [s].
        shape: (N, ...) of the result; every column is independent.
        rng: source of the draws.
    """
    steps = rng.standard_normal(shape)
    steps[0] = 0.0
    steps[1:] *= np.sqrt(np.diff(times)).reshape(-1, *(1,) * (len(shape) - 1))
    return np.cumsum(steps, axis=0)
