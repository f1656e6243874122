"""Small steps of the error model: unit noise processes, interpolation, constants drawn once, quaternions."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from smsid._recursion import filter_recursively
from smsid._time_text import time_text
from smsid.errors import RecordingError
from smsid.recording.attitude import slerp

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
        return filter_recursively(np.ones(1), np.array([1.0, -float(np.mean(keep))]), white)
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


def resample(times: FloatArray, values: FloatArray, at: FloatArray, *, attitude: bool = False) -> FloatArray:
    """Return ``values`` at other times, by a cubic spline, or slerp for quaternions.

    The spline's error is of fourth order in the step; a jump in the data rings for about three samples, by a
    tenth of the jump. Slerp's is of second order, the angular acceleration times the step squared over eight.

    Args:
        times: (N,) increasing [s].
        values: (N, ...) [unit], or (N, 4) quaternions x y z w with ``attitude``.
        at: (M,) times within the record [s].
        attitude: the values are quaternions.

    Raises:
        RecordingError: a time lies outside the record (by more than rounding), or there is only one sample.
    """
    slack = 1e-9 * max(1.0, float(np.max(np.abs(times))))
    if at.size and (at.min() < times[0] - slack or at.max() > times[-1] + slack):
        raise RecordingError(
            f"Samples are asked from {at.min()} to {at.max()} s; the record is {times[0]} to {times[-1]} s.",
            advice="Ask within the record; nothing is extrapolated.",
            start=float(times[0]),
            stop=float(times[-1]),
        )
    if times.size < 2:
        raise RecordingError(
            "One sample cannot be interpolated.", advice="Give at least two.", samples=times.size
        )
    at = np.clip(at, times[0], times[-1])
    if not attitude:
        return np.asarray(CubicSpline(times, values, axis=0)(at))
    return slerp(times, values, at)


def is_given(value: Any) -> bool:
    """Return whether a term is there: a number, or one of several, that is not zero."""
    return value is not None and bool(np.any(np.asarray(value, dtype=float) != 0.0))


def fixed_errors(
    value: Any, sigma: Any, shape: tuple[int, ...], rng: np.random.Generator | None
) -> FloatArray:
    """Return ``value`` plus a draw of ``sigma``, constant in time, (...) for a shape (N, ...).

    Without ``rng`` nothing is drawn.
    """
    fixed = np.array(np.broadcast_to(np.asarray(value, dtype=float), shape[1:]))
    if rng is None or not is_given(sigma):
        return fixed
    return fixed + np.asarray(sigma, dtype=float) * rng.standard_normal(shape[1:])


def compose(quaternions: FloatArray, turn: Rotation) -> FloatArray:
    """Return quaternions x y z w (N, 4) times a rotation, with the sign they had."""
    turned = (Rotation.from_quat(quaternions) * turn).as_quat()
    # A quaternion and its negative are the same attitude; keep the input's, so the channel is smooth.
    sign = np.where(np.sum(turned * quaternions, axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
    return sign * turned


def check_samples(times: ArrayLike, ideal: ArrayLike, attitude: bool) -> tuple[FloatArray, FloatArray]:
    """Return times (N,) and a copy of ideal values (N, ...); raises `RecordingError` if they are unusable."""
    t: NDArray[np.float64] = np.asarray(times, dtype=float)
    x: NDArray[np.float64] = np.array(ideal, dtype=float)
    if t.ndim != 1 or t.size == 0 or x.ndim == 0 or x.shape[0] != t.size:
        raise RecordingError(
            f"Times of shape {t.shape} do not fit values of shape {x.shape}.",
            advice="Give (N,) times and (N, ...) values.",
            times=t.shape,
            values=x.shape,
        )
    if attitude and (x.ndim != 2 or x.shape[1] != 4):
        raise RecordingError(
            f"An attitude has shape (N, 4), not {x.shape}.", advice="Quaternions are x y z w.", values=x.shape
        )
    bad = np.flatnonzero(~np.isfinite(x).reshape(t.size, -1).all(axis=1))
    if bad.size:
        raise RecordingError(
            f"{bad.size} of {t.size} samples are not finite, the first at "
            f"t = {time_text(float(t[bad[0]]), float(t[0]))}.",
            advice="Remove them before applying sensor errors.",
            samples=bad,
        )
    if not np.isfinite(t).all() or np.any(np.diff(t) <= 0.0):
        raise RecordingError("Times are not finite and increasing.", advice="Sort them and drop repeats.")
    return t, x
