"""Interpolation of a sampled channel."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, Slerp

from smsid.errors import RecordingError
from smsid.sensing._noise import FloatArray


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
    turned = Slerp(times, Rotation.from_quat(values))(at).as_quat()
    nearest = values[np.clip(np.searchsorted(times, at), 0, times.size - 1)]
    return np.where(np.sum(turned * nearest, axis=-1, keepdims=True) < 0.0, -1.0, 1.0) * turned
