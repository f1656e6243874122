"""A reaction wheel whose mass is not centred on its axis: forces and torques at its rate."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pinocchio as pin
from pydantic import Field

from smsid.effects.assembly import Assembly
from smsid.effects.base import Effect, physical, register
from smsid.effects.spatial import joint_jacobian


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
        rows, columns = [0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]
        return np.concatenate([[0.0], self.static * radial, product[rows, columns]])
