"""A rigid body that an arm has grasped: mass, centre of mass and inertia of its own, ten parameters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, Self

import numpy as np
import pinocchio as pin
from pydantic import Field, model_validator

from smsid.effects.assembly import Assembly
from smsid.effects.base import AXES, Effect, Vector3, Vector6, physical, register
from smsid.effects.inertial_parameters import pseudo_inertia
from smsid.effects.payload import point_parameters

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

    def _validated(self, data: Mapping[str, Any]) -> Self:
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
