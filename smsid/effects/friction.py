"""Joint friction: viscous and smoothed Coulomb."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import Field

from smsid.effects.base import Effect, physical, register

if TYPE_CHECKING:
    from smsid.model.assembly import Assembly


@register
class JointFriction(Effect):
    """Torque ``-coulomb tanh(qd / smoothing) - viscous qd`` on one joint of an arm or wheel."""

    summary: ClassVar[str] = "viscous and Coulomb friction of one joint"
    kind: Literal["joint_friction"] = "joint_friction"
    joint: str = Field(
        description="joint of the model: `joint2`, or `left/joint2` of a mounted arm, or a wheel"
    )
    viscous: float = physical("N m s/rad", lower=0.0, default=0.0, description="torque per rate")
    coulomb: float = physical("N m", lower=0.0, default=0.0, description="torque at speed")
    smoothing: float = Field(
        default=0.005, gt=0.0, description="rate at which the Coulomb torque reaches 76 % [rad/s]"
    )

    def attach(self, assembly: Assembly) -> None:
        """Add the friction torque; the viscous part is a linear damper."""
        joint = assembly.joint_id(self.joint)
        assembly.add_springs(joint, (0.0,), (self.viscous,))
        if self.coulomb == 0.0:
            return
        index = assembly.model.joints[joint].idx_v
        coulomb, smoothing = self.coulomb, self.smoothing

        def force(t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
            tau[index] -= coulomb * np.tanh(v[index] / smoothing)

        assembly.add_force(force)
