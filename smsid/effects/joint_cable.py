"""A cable across a joint."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import Field

from smsid.effects.base import Starting, physical, register
from smsid.effects.joint_state import JointStateOf, TorqueColumns
from smsid.errors import DescriptionError

if TYPE_CHECKING:
    from smsid.effects.assembly import Assembly


@register
class JointCable(Starting):
    """A cable across a joint of an arm: a spring with an angle of rest, ``-stiffness (q - rest)``."""

    summary: ClassVar[str] = "a cable or hose across a joint: a spring with an angle of rest"
    family: ClassVar[str] = "drivetrain"
    aliases: ClassVar[tuple[str, ...]] = ("torque_offset", "joint_friction")
    strength: ClassVar[tuple[str, ...]] = ("stiffness",)
    kind: Literal["joint_cable"] = "joint_cable"
    joint: str = Field(description="joint of the model: `joint2`, or `left/joint2` of a mounted arm")
    stiffness: float = physical("N m/rad", lower=0.0, default=0.0, description="torque per angle from rest")
    rest: float = physical("rad", default=0.0, description="angle at which it does not pull")

    def driven_joints(self) -> tuple[str, ...]:
        """Return the joint whose motor torque it has to do with."""
        return (self.joint,)

    def torque_columns(self, of: JointStateOf) -> TorqueColumns:
        """Return the angle from rest. Raises `DescriptionError` where it is not known."""
        return {"stiffness": {self.joint: of(self.joint).known("angle", self.name) - self.rest}}

    def attach(self, assembly: Assembly) -> None:
        """Add the spring. Raises `DescriptionError` for a joint that turns without end."""
        joint = assembly.model.joints[assembly.joint_id(self.joint)]
        if joint.nq != 1:
            raise DescriptionError(
                f"Joint '{self.joint}' turns without end: no cable is across it.",
                advice="Give it limits in the URDF (type revolute).",
                joint=self.joint,
            )
        place, index = joint.idx_q, joint.idx_v
        stiffness, rest, active = self.stiffness, self.rest, self.active

        def force(t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
            if active(t):
                tau[index] -= stiffness * (q[place] - rest)

        if stiffness:
            assembly.add_force(force, self.onset, ((index,), ()))
