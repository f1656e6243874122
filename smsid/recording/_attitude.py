"""Attitudes between samples: quaternions (x, y, z, w), body to inertial."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

FloatArray = NDArray[np.float64]


def slerp(t: FloatArray, q: FloatArray, at: FloatArray) -> FloatArray:
    """Interpolate attitudes at constant angular velocity between neighbours, the shorter way round.

    Args:
        t: (N,) strictly increasing [s].
        q: (N, 4) quaternions; they are normalised, and keep their sign.
        at: (M,) times within ``t`` [s].
    """
    if t.size == 1:
        return np.repeat(q / np.linalg.norm(q), at.size, axis=0)
    turned = Slerp(t, Rotation.from_quat(q))(at).as_quat()
    nearest = q[np.clip(np.searchsorted(t, at), 0, t.size - 1)]
    return np.where(np.sum(turned * nearest, axis=-1, keepdims=True) < 0.0, -1.0, 1.0) * turned
