"""Quaternions (x, y, z, w), body to inertial, on plain arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def conjugate(q: FloatArray) -> FloatArray:
    """Invert unit quaternions; q: (..., 4)."""
    return q * np.array([-1.0, -1.0, -1.0, 1.0])


def multiply(a: FloatArray, b: FloatArray) -> FloatArray:
    """Compose rotations, ``b`` first; a, b: (..., 4)."""
    vector = a[..., 3:] * b[..., :3] + b[..., 3:] * a[..., :3] + np.cross(a[..., :3], b[..., :3])
    scalar = a[..., 3] * b[..., 3] - np.sum(a[..., :3] * b[..., :3], axis=-1)
    return np.concatenate([vector, scalar[..., None]], axis=-1)


def rotate(q: FloatArray, v: FloatArray) -> FloatArray:
    """Turn vectors from body to inertial axes (by the conjugate: from inertial to body).

    Args:
        q: (N, 4) quaternions; they are normalised.
        v: (N, ..., 3) vectors in the axes the rotation starts from.
    """
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    q = q.reshape(q.shape[0], *([1] * (v.ndim - 2)), 4)
    u, w = q[..., :3], q[..., 3:]
    twist = 2.0 * np.cross(u, v)
    return v + w * twist + np.cross(u, twist)


def rotation_vector(q: FloatArray) -> FloatArray:
    """Give the rotation vector [rad] of the shorter way round; q: (..., 4), result (..., 3)."""
    q = np.where(q[..., 3:] < 0.0, -q, q)
    sine = np.linalg.norm(q[..., :3], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, q[..., 3:])
    return q[..., :3] * np.divide(angle, sine, out=np.full_like(sine, 2.0), where=sine > 0.0)


def slerp(t: FloatArray, q: FloatArray, at: FloatArray) -> FloatArray:
    """Interpolate attitudes at constant angular velocity between neighbours, the shorter way round.

    Args:
        t: (N,) strictly increasing [s].
        q: (N, 4) quaternions; they are normalised.
        at: (M,) times within ``t`` [s].
    """
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    if t.size == 1:
        return np.repeat(q, at.size, axis=0)
    k = np.clip(np.searchsorted(t, at, side="right") - 1, 0, t.size - 2)
    fraction = ((at - t[k]) / (t[k + 1] - t[k]))[:, None]
    step = rotation_vector(multiply(conjugate(q[k]), q[k + 1])) * fraction
    half = 0.5 * np.linalg.norm(step, axis=-1, keepdims=True)
    turn = np.concatenate([0.5 * step * np.sinc(half / np.pi), np.cos(half)], axis=-1)
    return multiply(q[k], turn)
