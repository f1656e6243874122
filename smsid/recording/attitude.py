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


SIGN_REACH = 3
"""Rows back among which a row's sign is compared with the nearest attitude: two wild ones decide nothing."""
STRAY = 3.0
"""Times the usual turn from row to row, beyond which the row before may be wild; of a fast spin, none is."""


def continuous(q: FloatArray) -> FloatArray:
    """Choose the signs of quaternions (N, 4), of any norm, so that components run on as the attitude does.

    q and -q are one attitude, and loggers write either. Rows that are not finite stay as they are, and the
    next one is compared with those before them. The first finite row keeps its sign.
    """
    good = np.flatnonzero(np.isfinite(q).all(axis=1) & np.any(q != 0.0, axis=1))
    if good.size < 2:
        return q
    rows = q[good] / np.abs(q[good]).max(axis=1, keepdims=True)
    rows /= _sizes(rows)[:, None]
    alike = np.zeros((SIGN_REACH, good.size))  # cosines of half the turn from rows 1, 2, ... before
    for k in range(min(SIGN_REACH, good.size - 1)):
        alike[k, k + 1 :] = np.einsum("ij,ij->i", rows[k + 1 :], rows[: -k - 1])
    turn = np.arccos(np.minimum(np.abs(alike[0]), 1.0))
    nearest = np.where(turn > STRAY * np.median(turn[1:]), np.argmax(np.abs(alike), axis=0), 0)
    place = np.arange(good.size)
    signs = np.where(alike[nearest, place] < 0.0, -1.0, 1.0)
    before = np.maximum(place - 1 - nearest, 0)
    signs[0] = 1.0
    while before.any():  # each row's sign to the row before, the rows before those, twice as far a round
        signs, before = signs * signs[before], before[before]
    out = np.array(q, dtype=np.float64)
    out[good] *= signs[:, None]
    return out


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
