"""Quaternions (x, y, z, w), body to inertial, on plain arrays; scipy's rotations take time to load."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def conjugate(q: FloatArray) -> FloatArray:
    """Invert unit quaternions; q: (..., 4)."""
    return q * np.array([-1.0, -1.0, -1.0, 1.0])


def turn_between(a: FloatArray, b: FloatArray) -> FloatArray:
    """Give the rotation vectors (N, 3) [rad], the shorter way round, from attitudes a to b, both (N, 4)."""
    from scipy.spatial.transform import Rotation

    return (Rotation.from_quat(a).inv() * Rotation.from_quat(b)).as_rotvec()


def rotate(q: FloatArray, v: FloatArray) -> FloatArray:
    """Turn vectors v (N, ..., 3) by q (N, 4), from body to inertial axes (by the conjugate: back)."""
    from scipy.spatial.transform import Rotation

    return np.einsum("nij,n...j->n...i", Rotation.from_quat(q).as_matrix(), v)


def slerp(t: FloatArray, q: FloatArray, at: FloatArray) -> FloatArray:
    """Interpolate attitudes at constant angular velocity between neighbours, the shorter way round.

    Args:
        t: (N,) strictly increasing [s].
        q: (N, 4) quaternions; they are normalised.
        at: (M,) times within ``t`` [s].
    """
    from scipy.spatial.transform import Rotation, Slerp

    if t.size == 1:
        return np.repeat(Rotation.from_quat(q).as_quat(), at.size, axis=0)
    found = Slerp(t, Rotation.from_quat(q))(at).as_quat()
    before = q[np.searchsorted(t, at, side="right") - 1]  # whose sign is kept
    return np.where(np.sum(found * before, axis=1, keepdims=True) < 0.0, -found, found)
