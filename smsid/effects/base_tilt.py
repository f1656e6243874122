"""A base that is not level: gravity leans in its axes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

import numpy as np

from smsid.effects.assembly import Assembly
from smsid.effects.base import Effect, physical, register
from smsid.errors import DescriptionError


@register
class BaseTilt(Effect):
    """Gravity of the description, leaning by small angles: a floor, or a mount, that is not level.

    With g the described gravity and e1, e2 of `horizontal_axes`, gravity is
    ``|g| (cos(a) g/|g| + sin(a)/a (x e1 + y e2))``, ``a = hypot(x, y)``. It concerns a welded base.
    """

    summary = "the base of a welded arm is not level: gravity leans in its axes"
    family = "external"
    aliases = ("body_error", "torque_offset")
    not_estimated = dict.fromkeys(
        ("x", "y"), "no ground is under a spacecraft; of an arm on the ground it is"
    )
    on_readings = True
    in_words = "the base under {place} is not level"
    kind: Literal["base_tilt"] = "base_tilt"
    x: float = physical(
        "rad", lower=-1.6, upper=1.6, default=0.0, description="by which gravity leans to the base's x axis"
    )
    y: float = physical("rad", lower=-1.6, upper=1.6, default=0.0, description="the same, to its y axis")

    def attach(self, assembly: Assembly) -> None:
        """Turn the model's gravity."""
        gravity = assembly.model.gravity
        gravity.linear = tilted_gravity(gravity.linear, self.x, self.y)


def tilt_of(effects: Iterable[Effect]) -> BaseTilt | None:
    """Return the base that is not level among effects, if there is one.

    Raises:
        DescriptionError: there are two.
    """
    found = [e for e in effects if isinstance(e, BaseTilt)]
    if len(found) > 1:
        raise DescriptionError("The base has two tilts.", advice="Keep one effect of the kind 'base_tilt'.")
    return found[0] if found else None


def horizontal_axes(gravity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return two unit vectors (3,) that are level: the base's x and y axes if z is vertical.

    Else the first is that axis which gravity is least along, made level, and both are perpendicular.
    """
    down = np.asarray(gravity) / np.linalg.norm(gravity)
    first = np.eye(3)[int(np.argmin(np.abs(down)))]
    first = first - down * (down @ first)
    first = first / np.linalg.norm(first)
    return first, np.cross(-down, first)


def tilted_gravity(gravity: np.ndarray, x: float, y: float) -> np.ndarray:
    """Return gravity (3,) [m/s^2] leaning by small angles x and y [rad]; zero stays zero."""
    size, angle = float(np.linalg.norm(gravity)), float(np.hypot(x, y))
    if size == 0.0:
        return np.array(gravity)
    first, second = horizontal_axes(gravity)
    aside = np.sinc(angle / np.pi) * (x * first + y * second)
    return size * (np.cos(angle) * np.asarray(gravity) / size + aside)
