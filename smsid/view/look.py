"""How a scene looks: factors, colours, what follows the camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from smsid.errors import SmsidError


@dataclass(frozen=True)
class Look:
    """Choices of a scene. What is not drawn true to scale is stated on screen.

    Attributes:
        slosh_factor: slosh displacements are drawn this many times larger; smaller again, by a whole number,
            where the fuel would leave a tank of reasonable size.
        panel_factor: deflections of appendages are drawn this many times larger.
        strips: flat strips that make up a bending surface.
        hull_opacity: of the bus's visuals that hide a tank or wheel, 0 to 1.
        background: ``auto`` (light, or dark with stars where the reader's system asks for a dark scheme),
            ``light``, or ``space``.
        follow: the camera's target moves with the bus.
        sensors: draw a small frame at each pose sensor and IMU, and a mark at each accelerometer.
        arrows: draw thrust, torques, momentum and the centre of mass of a motion.
        trail: draw the way of each arm's tool.

    Raises:
        SmsidError: a factor or opacity out of range, or fewer than two strips.
    """

    slosh_factor: float = 1.0
    panel_factor: float = 1.0
    strips: int = 24
    hull_opacity: float = 0.2
    background: Literal["auto", "light", "space"] = "auto"
    follow: bool = True
    sensors: bool = True
    arrows: bool = True
    trail: bool = True

    def __post_init__(self) -> None:
        if not (self.slosh_factor > 0.0 and self.panel_factor > 0.0):
            raise SmsidError("Factors of exaggeration must be positive.", advice="1 is true to scale.")
        if not 0.0 < self.hull_opacity <= 1.0 or self.strips < 2:
            raise SmsidError("`hull_opacity` lies in (0, 1], and a surface needs two strips or more.")
