"""Where the camera stands and where it looks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FIELD_OF_VIEW = 38.0  # [deg], vertical
ASPECT = 1.5  # of the window the scene is fitted to
MARGIN = 0.84  # of the window that it fills
VIEW_FROM = np.array([0.42, 1.0, 0.52])


@dataclass(frozen=True)
class Camera:
    """The target (3,) [m], inertial axes, and the camera's place (3,) [m] relative to it."""

    target: np.ndarray
    offset: np.ndarray


def across(corners: np.ndarray) -> np.ndarray:
    """Return the vector (3,) [m], level and along the window, that is as long as points (K, 3) [m] extend."""
    right = np.cross([0.0, 0.0, 1.0], VIEW_FROM)
    right /= np.linalg.norm(right)
    return right * float(np.ptp(corners @ right))


def fitted_camera(corners: np.ndarray) -> Camera:
    """Return the camera that has points (K, 3) [m] in the middle of the window and fills it with them."""
    back = VIEW_FROM / np.linalg.norm(VIEW_FROM)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    target = (corners.min(axis=0) + corners.max(axis=0)) / 2
    size = max(float(np.linalg.norm(np.ptp(corners, axis=0))), 1e-3)
    distance = 1.5 * size
    slope = np.tan(np.deg2rad(FIELD_OF_VIEW / 2)) * MARGIN
    for _ in range(30):
        seen = corners - target
        depth = np.maximum(distance - seen @ back, 0.05 * size)
        across, along = seen @ right / depth, seen @ up / depth
        target = target + distance * (
            right * (across.max() + across.min()) / 2 + up * (along.max() + along.min()) / 2
        )
        wanted = max(np.ptp(across) / (2 * slope * ASPECT), np.ptp(along) / (2 * slope))
        distance = float(np.clip(distance * wanted, 0.3 * size, 20.0 * size))
    return Camera(target, distance * back)
