"""What effects at one joint of an arm, or at a wheel, share."""

from __future__ import annotations

from pydantic import Field

from smsid.effects.assembly import Assembly
from smsid.effects.base import Effect


class JointEffect(Effect):
    """An effect at a joint."""

    family = "drivetrain"
    joint: str = Field(description="joint of the model: `joint2`, `left/joint2` of a mounted arm, or a wheel")

    def driven_joints(self) -> tuple[str, ...]:
        """Return the joint, whose motor torque it has to do with."""
        return (self.joint,)

    def attach(self, assembly: Assembly) -> None:
        """Check that the joint is there; nothing acts on the motion."""
        assembly.joint_id(self.joint)
