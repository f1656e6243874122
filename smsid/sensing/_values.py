"""Small steps of the error model: which terms are there, constants drawn once, quaternions, usable data."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from smsid.errors import RecordingError
from smsid.sensing._noise import FloatArray


def given(value: Any) -> bool:
    """Return whether a term is there: a number, or one of several, that is not zero."""
    return value is not None and bool(np.any(np.asarray(value, dtype=float) != 0.0))


def fixed_errors(
    value: Any, sigma: Any, shape: tuple[int, ...], rng: np.random.Generator | None
) -> FloatArray:
    """Return ``value`` plus a draw of ``sigma``, constant in time: the shape without its first dimension.

    Without ``rng`` nothing is drawn.
    """
    fixed = np.array(np.broadcast_to(np.asarray(value, dtype=float), shape[1:]))
    if rng is None or not given(sigma):
        return fixed
    return fixed + np.asarray(sigma, dtype=float) * rng.standard_normal(shape[1:])


def column(values: NDArray[np.bool_], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return a value per time (N,) so that it broadcasts over values of ``shape``."""
    return values.reshape(-1, *(1,) * (len(shape) - 1))


def compose(quaternions: FloatArray, turn: Rotation) -> FloatArray:
    """Return quaternions x y z w (N, 4) times a rotation, with the sign they had."""
    turned = (Rotation.from_quat(quaternions) * turn).as_quat()
    # A quaternion and its negative are the same attitude; keep the input's, so the channel is smooth.
    sign = np.where(np.sum(turned * quaternions, axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
    return sign * turned


def checked(times: ArrayLike, ideal: ArrayLike, attitude: bool) -> tuple[FloatArray, FloatArray]:
    """Return times (N,) and a copy of the values as arrays; raises `RecordingError` if they are unusable."""
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
            f"{bad.size} of {t.size} samples are not finite, the first at t = {t[bad[0]]} s.",
            advice="Remove them before applying sensor errors.",
            samples=bad,
        )
    if not np.isfinite(t).all() or np.any(np.diff(t) <= 0.0):
        raise RecordingError("Times are not finite and increasing.", advice="Sort them and drop repeats.")
    return t, x
