"""A cable across a joint."""

from __future__ import annotations

from typing import Literal

import numpy as np

from smsid.effects.assembly import Assembly
from smsid.effects.base import Starting, physical, register
from smsid.effects.joint_effect import JointEffect
from smsid.effects.joint_state import JointStateOf, TorqueColumns
from smsid.errors import DescriptionError


@register
class JointCable(JointEffect, Starting):
    """A cable across a joint of an arm: a spring with an angle of rest, ``-stiffness (q - rest)``."""

    summary = "a cable or hose across a joint: a spring with an angle of rest"
    aliases = ("torque_offset", "joint_friction")
    strength = ("stiffness",)
    in_words = "a cable or hose across {place} pulls it back"
    kind: Literal["joint_cable"] = "joint_cable"
    stiffness: float = physical("N m/rad", lower=0.0, default=0.0, description="torque per angle from rest")
    rest: float = physical("rad", default=0.0, description="angle at which it does not pull")

    def torque_columns(self, of: JointStateOf) -> TorqueColumns:
        """Return the angle from rest. Raises `DescriptionError` where it is not known."""
        return {"stiffness": {self.joint: of(self.joint).known("angle", self.name) - self.rest}}

    def attach(self, assembly: Assembly) -> None:
        """Add the spring. Raises `DescriptionError` for a joint that turns without end."""
        joint = assembly.joint(self.joint)
        if joint.nq != 1:
            raise DescriptionError(
                f"Joint '{self.joint}' turns without end: no cable is across it.",
                advice="Give it limits in the URDF (type revolute).",
                joint=self.joint,
            )
        place, index, stiffness, rest = joint.idx_q, joint.idx_v, self.stiffness, self.rest

        def force(t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
            tau[index] -= stiffness * (q[place] - rest)

        if stiffness:
            assembly.add_force(force, ((index,), ()))
