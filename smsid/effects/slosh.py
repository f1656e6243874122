"""Fuel slosh as a spring-mounted point mass, equations (1), (2), (12)."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
import pinocchio as pin
from pydantic import Field

from smsid.effects.base import Effect, Vector3, physical, register

if TYPE_CHECKING:
    from smsid.model.assembly import Assembly


@register
class Slosh(Effect):
    """A point mass on springs and dampers along the axes of the frame it is mounted in.

    ``position`` is its equilibrium c_s in ``frame`` (default: the bus frame) [m].
    """

    summary: ClassVar[str] = "fuel slosh: a spring-mounted point mass with three degrees of freedom"
    kind: Literal["slosh"] = "slosh"
    frame: str | None = Field(default=None, description="frame it is in; the bus frame when not given")
    position: Vector3 = Field(description="equilibrium c_s of the mass in `frame` [m]")
    mass: float = physical("kg", lower=0.0, gt=0.0, description="m_s, beside the mass of the bus")
    stiffness: Vector3 = physical("N/m", lower=0.0, description="of the springs along the axes of `frame`")
    damping: Vector3 = physical("N s/m", lower=0.0, description="of the dampers along the axes of `frame`")

    def attach(self, assembly: Assembly) -> None:
        """Add a translation joint carrying the point mass, with its springs and dampers."""
        placement = pin.SE3(np.eye(3), np.asarray(self.position))
        joint = assembly.add_joint(self.frame, pin.JointModelTranslation(), placement, self.name)
        assembly.add_inertia(joint, pin.Inertia(self.mass, np.zeros(3), np.zeros((3, 3))))
        assembly.add_springs(joint, self.stiffness, self.damping)
        assembly.note_slosh(self.name, joint)
