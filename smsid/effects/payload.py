"""Mass that is not where the description has it: payloads, grasped bodies, leaks, wheels out of balance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, Self

import numpy as np
import pinocchio as pin
from pydantic import Field, model_validator

from smsid.effects.assembly import Assembly
from smsid.effects.base import AXES, Effect, Starting, Vector3, Vector6, physical, register
from smsid.effects.inertial_parameters import matrix_to_parameters, pseudo_inertia
from smsid.effects.spatial import GrowingInertia, joint_jacobian


@register
class Payload(Effect):
    """A point mass at ``com`` in a frame: what an arm has grasped, say."""

    summary = "payload: a point mass on a link or tool"
    adds_to_body = True
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
    adds_to_body = True
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

    def plus(self, shift: np.ndarray) -> BodyError:
        """Return it with a shift (10,) more."""
        total = (np.array([self.mass, *self.first_moment, *self.inertia]) + shift).tolist()
        parts = {"mass": total[0], "first_moment": tuple(total[1:4]), "inertia": tuple(total[4:])}
        return type(self).model_validate({**dict(self), **parts})

    def without_share(self, described: np.ndarray) -> BodyError:
        """Return it without ``density``, as that of a body with parameters (10,) in its frame."""
        return self.model_copy(update={"density": 0.0}).plus(self.density * described)

    def shifted_by(self, body: str | None, shift: np.ndarray) -> BodyError | None:
        """Return it with a shift (10,) more, if it is of that body by the same name."""
        return self.plus(shift) if body == self.body else None


def point_parameters(mass: float, place: np.ndarray) -> np.ndarray:
    """Return the inertial parameters (10,) of a point mass [kg] at place (3,) [m] about the origin."""
    x, y, z = place
    about = [y * y + z * z, -x * y, x * x + z * z, -x * z, -y * z, x * x + y * y]
    return mass * np.array([1.0, x, y, z, *about])


@register
class MassLoss(Starting):
    """The mass of a body falls linearly in time: ``rate (t - start)`` less at ``position`` (start: 0 s).

    What leaves has the velocity of the point it leaves from, so it takes its momentum along and pushes
    nothing: every instant's motion is that of the mass left. The thrust of what is blown out is an
    `external_wrench` beside it. The equations of motion get the inertia of a point mass of ``-rate (t -
    start)``, with no term from its rate of change.
    """

    summary = "mass loss: the mass of a body falls linearly in time, without push"
    family = "inertia"
    aliases = ("body_error", "thruster_gain")
    grows = True
    strength = ("rate",)
    point_mass = ("rate", "position")
    in_words = "{place} loses mass"
    kind: Literal["mass_loss"] = "mass_loss"
    frame: str | None = Field(default=None, description="frame it leaves from; the bus frame when not given")
    position: Vector3 = physical("m", default=(0.0, 0.0, 0.0), description="where it leaves, in `frame`")
    rate: float = physical("kg/s", lower=0.0, description="mass lost per time")

    def attach(self, assembly: Assembly) -> None:
        """Add the point mass that is no longer there."""
        joint, placement = assembly.frame(self.frame)
        if joint == 0 or self.rate == 0.0:
            return
        unit = point_parameters(-self.rate, placement.act(np.asarray(self.position)))
        assembly.add_inertia_term(GrowingInertia(assembly.model, joint, unit, self.start or 0.0))


CENTRAL = ("centre", "central_inertia")  # given instead of first moment and inertia about the frame's origin
LARGEST_DEFECT = 1e-9  # relative to the pseudo-inertia's largest eigenvalue: rounding


@register
class GraspedBody(Effect):
    """A rigid body fixed to a link: its ten inertial parameters in the axes of ``frame``, about its origin.

    The motion is linear in ``mass``, ``first_moment`` (mass times centre of mass) and ``inertia``, which are
    therefore what is estimated. A description may give ``centre`` [m] instead of the first moment, and
    ``central_inertia`` [kg m^2] about the centre of mass, in the frame's axes, instead of the inertia. What
    a description gives must be a body that can exist (a point mass and a thin rod can); estimates are free
    within their uncertainty.
    """

    summary = "a rigid body on a link, with all ten inertial parameters: what an arm grasped"
    adds_to_body = True
    family = "inertia"
    aliases = ("payload", "body_error")
    strength = ("mass", "first_moment", "inertia")
    changes = {"mass": ("the grasped body is heavier", "the grasped body is lighter")}
    in_words = "{place} has grasped a body that the description lacks"
    kind: Literal["grasped_body"] = "grasped_body"
    frame: str | None = Field(
        default=None, description="link, tool or frame that carries it; the bus frame when not given"
    )
    mass: float = physical("kg", lower=0.0, description="of the body")
    first_moment: Vector3 = physical(
        "kg m",
        default=(0.0, 0.0, 0.0),
        description="mass times centre of mass in `frame`; `centre` [m] may be given instead",
    )
    inertia: Vector6 = physical(
        "kg m^2",
        default=(0.0,) * 6,
        description="about the origin of `frame`: xx, xy, yy, xz, yz, zz; `central_inertia` about the centre "
        "of mass may be given instead",
    )

    @model_validator(mode="before")
    @classmethod
    def _about_the_origin(cls, data: Any) -> Any:
        if not isinstance(data, Mapping) or not any(key in data for key in CENTRAL):
            return data
        rest = {k: v for k, v in data.items() if k not in CENTRAL}
        for key, other in zip(CENTRAL, ("first_moment", "inertia"), strict=True):
            if key in data and other in data:
                raise ValueError(f"give `{key}` or `{other}`, not both")
        mass = _numbers([data.get("mass", 0.0)], 1, "mass")[0]
        if "centre" in data:
            centre = _numbers(data["centre"], 3, "centre")
            rest["first_moment"] = tuple((mass * centre).tolist())
        else:
            moment = _numbers(data.get("first_moment", (0.0,) * 3), 3, "first_moment")
            centre = moment / mass if mass else np.zeros(3)
        if "central_inertia" in data:
            central = _numbers(data["central_inertia"], 6, "central_inertia")
            rest["inertia"] = tuple((central + point_parameters(mass, centre)[4:]).tolist())
        return rest

    @model_validator(mode="after")
    def _is_a_body(self, info: Any) -> GraspedBody:
        if (info.context or {}).get("estimated"):
            return self
        size = np.linalg.eigvalsh(pseudo_inertia(self.inertial_parameters()))
        if size[0] < -LARGEST_DEFECT * max(float(size[-1]), 1e-12):
            raise ValueError(
                "no rigid body has this mass, centre and inertia: is the inertia about the origin of the "
                "frame (`central_inertia` is about the centre of mass), and no moment larger than two?"
            )
        return self

    @property
    def centre(self) -> np.ndarray:
        """Centre of mass (3,) in `frame` [m]; not a number without mass."""
        return np.asarray(self.first_moment) / (self.mass or np.nan)

    def inertial_parameters(self) -> np.ndarray:
        """Return the ten parameters (10,) in the frame's axes about its origin [kg, kg m, kg m^2]."""
        return np.array([self.mass, *self.first_moment, *self.inertia])

    def attach(self, assembly: Assembly) -> None:
        """Add the body; raises `DescriptionError` when it and the link together are not physical."""
        assembly.add_remainder(self.frame, self.inertial_parameters(), pin.SE3.Identity())

    def _validate(self, data: Mapping[str, Any]) -> Self:
        return type(self).model_validate(data, context={"estimated": True})


def _numbers(value: Any, size: int, name: str) -> np.ndarray:
    try:
        found = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        found = np.zeros(0)
    if found.shape != (size,) or not np.isfinite(found).all():
        axes = f" ({', '.join(AXES[size])})" if size in AXES else ""
        raise ValueError(f"`{name}` takes {size} finite number{'s' * (size > 1)}{axes}")
    return found


@register
class WheelImbalance(Effect):
    """The wheel's first moment ``static`` and product of inertia ``dynamic`` about its axis.

    Both lie in the plane through the axis at ``phase`` from a reference that is fixed to the wheel: where the
    wheel's angle is zero, the bus's x axis less its part along the wheel's axis (y, for an axis along x). At
    rate W the wheel pulls with ``static W^2`` and tilts with ``dynamic W^2``. The mass itself is part of the
    bus. The first moment sits at the wheel's place: `position` of the description matters here.
    """

    summary = "static and dynamic imbalance of a wheel"
    family = "actuator"
    aliases = ()
    strength = ("static", "dynamic")
    polar = (("static", "dynamic"), "phase")
    in_words = "{place} is out of balance"
    kind: Literal["wheel_imbalance"] = "wheel_imbalance"
    wheel: str = Field(description="wheel, or the joint that is the wheel")
    static: float = physical("kg m", default=0.0, lower=0.0, description="mass times distance from the axis")
    phase: float = physical("rad", default=0.0, description="angle on the wheel where both lie")
    dynamic: float = physical(
        "kg m^2", default=0.0, description="product of inertia between axis and that direction"
    )

    def attach(self, assembly: Assembly) -> None:
        """Add first moment and product of inertia to the wheel."""
        joint = assembly.joint_id(self.wheel)
        if self.static or self.dynamic:
            theta = self.inertia(assembly.model, joint)
            assembly.add_imbalance(joint, theta)

    def inertia(self, model: pin.Model, joint: int) -> np.ndarray:
        """Return its inertial parameters (10,) in the frame of the wheel's joint."""
        jacobian = joint_jacobian(model, model.createData(), pin.neutral(model), joint)
        axis = jacobian[3:, model.joints[joint].idx_v]
        reference = np.array([1.0, 0.0, 0.0]) if abs(axis[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
        first = reference - (reference @ axis) * axis
        first /= np.linalg.norm(first)
        radial = np.cos(self.phase) * first + np.sin(self.phase) * np.cross(axis, first)
        product = -self.dynamic * (np.outer(axis, radial) + np.outer(radial, axis))
        return np.concatenate([[0.0], self.static * radial, matrix_to_parameters(product)])
