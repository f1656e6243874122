"""How a scene looks: factors, colours, and where the camera stands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from smsid.errors import SmsidError


@dataclass(frozen=True)
class Look:
    """Choices of a scene. What is not drawn true to scale is stated on screen.

    Attributes:
        slosh_factor: slosh displacements are drawn this many times larger; smaller again, by a whole number,
            where the fuel would leave a tank of reasonable size.
        panel_factor: deflections of appendages are drawn this many times larger.
        background: ``auto`` (light, or dark with stars where the reader's system asks for a dark scheme),
            ``light``, or ``space``.
        sensors: draw a small frame at each pose sensor and IMU, and a mark at each accelerometer.
        arrows: draw thrust, torques, momentum and the centre of mass of a motion.
        trail: draw the way of each arm's tool.

    Raises:
        SmsidError: a factor is not positive.
    """

    slosh_factor: float = 1.0
    panel_factor: float = 1.0
    background: Literal["auto", "light", "space"] = "auto"
    sensors: bool = True
    arrows: bool = True
    trail: bool = True

    def __post_init__(self) -> None:
        if not (self.slosh_factor > 0.0 and self.panel_factor > 0.0):
            raise SmsidError("Factors of exaggeration must be positive.", advice="1 is true to scale.")


STRIPS = 24  # flat ones that make up a bending surface
HULL_OPACITY = 0.2  # of the bus's visuals that hide a tank or wheel
FIELD_OF_VIEW = 38.0  # [deg], vertical
ASPECT = 1.5  # of the window the scene is fitted to
MARGIN = 0.84  # of the window that it fills
VIEW_FROM = np.array([0.42, 1.0, 0.52])
BACK = VIEW_FROM / np.linalg.norm(VIEW_FROM)  # from what is seen to the camera
RIGHT = np.cross([0.0, 0.0, 1.0], BACK)  # and UP: of the window
RIGHT /= np.linalg.norm(RIGHT)
UP = np.cross(BACK, RIGHT)


def across(corners: np.ndarray) -> np.ndarray:
    """Return the vector (3,) [m], level and along the window, that is as long as points (K, 3) [m] extend."""
    return RIGHT * float(np.ptp(corners @ RIGHT))


def fitted_camera(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the camera that has points (K, 3) [m] in the middle of the window and fills it with them.

    Its target (3,) [m], inertial axes, and its place (3,) [m] relative to that.
    """
    target = (corners.min(axis=0) + corners.max(axis=0)) / 2
    size = max(float(np.linalg.norm(np.ptp(corners, axis=0))), 1e-3)
    distance = 1.5 * size
    slope = np.tan(np.deg2rad(FIELD_OF_VIEW / 2)) * MARGIN
    for _ in range(30):
        seen = corners - target
        depth = np.maximum(distance - seen @ BACK, 0.05 * size)
        across, along = seen @ RIGHT / depth, seen @ UP / depth
        target = target + distance * (
            RIGHT * (across.max() + across.min()) / 2 + UP * (along.max() + along.min()) / 2
        )
        wanted = max(np.ptp(across) / (2 * slope * ASPECT), np.ptp(along) / (2 * slope))
        distance = float(np.clip(distance * wanted, 0.3 * size, 20.0 * size))
    return target, distance * BACK
