"""Quaternions (x, y, z, w), body to inertial, on plain arrays: many times faster than scipy's rotations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def conjugate(q: FloatArray) -> FloatArray:
    """Invert unit quaternions; q: (..., 4)."""
    return q * np.array([-1.0, -1.0, -1.0, 1.0])


def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Multiply quaternions a, b (N, 4): what b turns a turns further."""
    (ax, ay, az, aw), (bx, by, bz, bw) = a.T, b.T
    x = aw * bx + ax * bw + ay * bz - az * by
    y = aw * by - ax * bz + ay * bw + az * bx
    z = aw * bz + ax * by - ay * bx + az * bw
    return np.stack([x, y, z, aw * bw - ax * bx - ay * by - az * bz], axis=1)


def _sizes(v: FloatArray) -> FloatArray:
    """Return the norms (N,) of rows v (N, k)."""
    return np.sqrt(np.einsum("ij,ij->i", v, v))


def turn_between(a: FloatArray, b: FloatArray) -> FloatArray:
    """Give the rotation vectors (N, 3) [rad], the shorter way round, from attitudes a to b, both (N, 4)."""
    turn = product(conjugate(a), b)
    size = _sizes(turn[:, :3])
    half = np.arctan2(size, np.abs(turn[:, 3]))
    scale = np.divide(half, size, out=1.0 / _sizes(turn), where=size > 0.0)
    return turn[:, :3] * (np.copysign(2.0, turn[:, 3]) * scale)[:, None]


def rotate(q: FloatArray, v: FloatArray) -> FloatArray:
    """Turn vectors v (N, ..., 3) by q (N, 4), from body to inertial axes (by the conjugate: back)."""
    x, y, z, w = q.T / _sizes(q)
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.einsum("ijn,n...j->n...i", np.array(rows), v)


def slerp(t: FloatArray, q: FloatArray, at: FloatArray) -> FloatArray:
    """Interpolate attitudes at constant angular velocity between neighbours, the shorter way round.

    Args:
        t: (N,) strictly increasing [s].
        q: (N, 4) quaternions; they are normalised.
        at: (M,) times within ``t`` [s].
    """
    unit = q / _sizes(q)[:, None]
    if t.size == 1:
        return np.repeat(unit, at.size, axis=0)
    last = np.searchsorted(t, at, side="right") - 1  # whose sign is kept
    k = np.minimum(last, t.size - 2)
    half = turn_between(unit[k], unit[k + 1]) * (0.5 * (at - t[k]) / (t[k + 1] - t[k]))[:, None]
    size = _sizes(half)[:, None]
    turn = np.hstack([half * np.sinc(size / np.pi), np.cos(size)])
    found = product(unit[k], turn)
    return np.where(np.sum(found * unit[last], axis=1, keepdims=True) < 0.0, -found, found)
