"""Mass that is not where the description has it: a payload, and wrong inertial parameters of a body."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pinocchio as pin
from pydantic import Field

from smsid.effects.assembly import Assembly
from smsid.effects.base import Effect, Vector3, Vector6, physical, register


@register
class Payload(Effect):
    """A point mass at ``com`` in a frame: what an arm has grasped, say."""

    summary = "payload: a point mass on a link or tool"
    family = "inertia"
    aliases = ("body_error",)
    strength = ("mass",)
    strong = {"mass": (5.0, 15.0, 50.0, 150.0, 500.0)}  # [kg]
    changes = {"mass": ("the payload is heavier", "the payload is lighter")}
    in_words = "{place} carries a mass that the description lacks"
    kind: Literal["payload"] = "payload"
    frame: str | None = Field(default=None, description="frame that carries it; the bus frame when not given")
    mass: float = physical("kg", lower=0.0, description="of the payload")
    com: Vector3 = physical("m", default=(0.0, 0.0, 0.0), description="where it is, in `frame`")

    def attach(self, assembly: Assembly) -> None:
        """Add the point mass to the body."""
        assembly.add_remainder(
            self.frame, point_parameters(self.mass, np.asarray(self.com)), pin.SE3.Identity()
        )


@register
class BodyError(Effect):
    """What is added to the inertial parameters of a body, of either sign; the sum must be physical.

    ``first_moment`` is mass times centre of mass, ``inertia`` is about the origin of the body's frame, in its
    axes: moments and products as they stand in the inertia matrix. ``density`` changes all of them together,
    as a body that is heavier where it is heavy already. On a welded bus it changes nothing.
    """

    summary = "wrong mass, centre of mass or inertia of a body: what is added to them"
    family = "inertia"
    aliases = ("payload",)
    strength = ("mass", "first_moment", "inertia", "density")
    strong = {"density": (1.0, -0.5)}
    shifted_body = "body"
    in_words = "the {shape} of {place} is not what the description says"
    kind: Literal["body_error"] = "body_error"
    body: str | None = Field(
        default=None, description="link, joint or frame of the body; the bus when not given"
    )
    mass: float = physical("kg", default=0.0, description="added to the mass")
    first_moment: Vector3 = physical(
        "kg m", default=(0.0, 0.0, 0.0), description="added to mass times centre of mass, in the body's frame"
    )
    inertia: Vector6 = physical(
        "kg m^2",
        default=(0.0,) * 6,
        description="added to the inertia about the origin of the body's frame: xx, xy, yy, xz, yz, zz",
    )
    density: float = physical(
        "1",
        default=0.0,
        lower=-0.99,
        description="share of all of these that it has more, before the others are added",
    )

    def attach(self, assembly: Assembly) -> None:
        """Add the parameters; raises `DescriptionError` when the sum is not physical."""
        theta = np.array([self.mass, *self.first_moment, *self.inertia])
        assembly.scale_body(self.body, 1.0 + self.density)
        assembly.add_remainder(self.body, theta, pin.SE3.Identity())


def point_parameters(mass: float, place: np.ndarray) -> np.ndarray:
    """Return the inertial parameters (10,) of a point mass [kg] at place (3,) [m] about the origin."""
    x, y, z = place
    about = [y * y + z * z, -x * y, x * x + z * z, -x * z, -y * z, x * x + y * y]
    return mass * np.array([1.0, x, y, z, *about])
