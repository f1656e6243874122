"""Inertial parameters (10,) of a body: m, m c (3), Ixx Ixy Iyy Ixz Iyz Izz about the frame's origin."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

Array = np.ndarray
SYMBOLS = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
_ROWS, _COLUMNS = np.array([0, 0, 1, 0, 1, 2]), np.array([0, 1, 1, 2, 2, 2])


def matrix(six: Array) -> Array:
    """(3, 3) from xx, xy, yy, xz, yz, zz."""
    out = np.zeros((3, 3))
    out[_ROWS, _COLUMNS] = six
    out[_COLUMNS, _ROWS] = six
    return out


def six(m: Array) -> Array:
    """xx, xy, yy, xz, yz, zz of a symmetric matrix (3, 3)."""
    return m[_ROWS, _COLUMNS]


def steiner(mass: float, r: ArrayLike) -> Array:
    """(3, 3) inertia of a point mass at r (3,) about the origin [kg m2]."""
    r = np.asarray(r, dtype=float)
    return mass * (r @ r * np.eye(3) - np.outer(r, r))


def theta(mass: float, centre: ArrayLike, about_centre: Array) -> Array:
    """Parameters (10,) from mass, centre of mass (3,) and inertia about it (3, 3)."""
    c = np.asarray(centre, dtype=float)
    return np.concatenate([[mass], mass * c, six(np.asarray(about_centre) + steiner(mass, c))])


def point(mass: float, at: ArrayLike) -> Array:
    """Parameters (10,) of a point mass at (3,) [m]."""
    return theta(mass, at, np.zeros((3, 3)))


def split(parameters: Array) -> tuple[float, Array, Array]:
    """Mass, centre of mass (3,) and inertia about it (3, 3)."""
    mass = float(parameters[0])
    centre = parameters[1:4] / mass
    return mass, centre, matrix(parameters[4:]) - steiner(mass, centre)


def sizes(parameters: Array) -> Array:
    """What errors of the parameters (10,) are measured in, so that a small share of it stays physical."""
    mass = parameters[0]
    diagonal = parameters[[4, 6, 9]]
    gyration = np.sqrt(diagonal.sum() / (2 * mass))
    cross = np.sqrt([diagonal[0] * diagonal[1], diagonal[0] * diagonal[2], diagonal[1] * diagonal[2]])
    inertia = [diagonal[0], cross[0], diagonal[1], cross[1], cross[2], diagonal[2]]
    return np.concatenate([[mass], np.full(3, mass * gyration), inertia])


def is_physical(parameters: Array) -> bool:
    """Whether a rigid body can have them: positive mass, principal moments that satisfy the triangle rule."""
    if parameters[0] <= 0.0:
        return False
    low, middle, high = np.linalg.eigvalsh(split(parameters)[2])
    return bool(low > 0.0 and high < low + middle)


def reach(parameters: Array, change: Array, cap: float) -> float:
    """Largest size up to cap by which a change (10,) may be added or taken away, and a body stays a body.

    A fifth is kept back, as the world's own numbers differ a little from those it is asked for.
    """
    low, high = 0.0, cap
    for _ in range(40):
        middle = 0.5 * (low + high)
        fits = all(is_physical(parameters + sign * middle * change) for sign in (1.0, -1.0))
        low, high = (middle, high) if fits else (low, middle)
    return 0.8 * low if low < 0.999 * cap else cap
