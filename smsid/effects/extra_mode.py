"""A bending mode that an appendage's description leaves out."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
import pinocchio as pin
from pydantic import Field, model_validator

from smsid.effects.appendage_drift import attached_appendage
from smsid.effects.base import Effect, Vector3, physical, register
from smsid.effects.payload import point_parameters

if TYPE_CHECKING:
    from smsid.effects.assembly import Assembly


@register
class ExtraMode(Effect):
    """One more mode of an appendage: ``mass`` of it slides on a spring at ``position`` along ``direction``.

    With n the unit vector of the direction its participation factors are ``L_t = sqrt(mass) n`` and ``L_r =
    position x L_t``. The mass is taken out of the rigid rest. Stations do not see the mode, as its shape is
    not known there.
    """

    summary: ClassVar[str] = "one more bending mode of an appendage, as a mass on a spring"
    nominal: ClassVar[bool] = True
    family: ClassVar[str] = "appendage"
    aliases: ClassVar[tuple[str, ...]] = ("slosh", "frequency_drift")
    strength: ClassVar[tuple[str, ...]] = ("mass",)
    kind: Literal["extra_mode"] = "extra_mode"
    appendage: str = Field(description="name of the appendage, which stands before this effect")
    mass: float = physical("kg", lower=0.0, default=0.0, description="modal mass, the square of L_t")
    position: Vector3 = physical("m", description="where it sits, appendage axes")
    direction: Vector3 = Field(default=(0.0, 0.0, 1.0), description="along which it moves, appendage axes")
    frequency: float = physical("Hz", lower=0.0, gt=0.0, description="of the clamped mode")
    damping: float = physical("1", lower=0.0, default=0.005, description="damping ratio")

    @model_validator(mode="after")
    def _moves_somewhere(self) -> ExtraMode:
        if not any(self.direction):
            raise ValueError("`direction` must not be zero")
        return self

    def attach(self, assembly: Assembly) -> None:
        """Add the mass on its spring, and take it from the body that carries the appendage."""
        panel = attached_appendage(assembly, self.appendage).appendage
        if self.mass == 0.0:
            return
        axis = np.asarray(self.direction) / np.linalg.norm(self.direction)
        place = panel.placement * pin.SE3(np.eye(3), np.asarray(self.position))
        joint = assembly.add_joint(panel.frame, pin.JointModelPrismaticUnaligned(axis), place, self.name)
        assembly.add_inertia(joint, pin.Inertia(self.mass, np.zeros(3), np.zeros((3, 3))))
        omega = 2 * np.pi * self.frequency
        assembly.add_springs(joint, (self.mass * omega**2,), (2 * self.damping * omega * self.mass,))
        assembly.add_remainder(panel.frame, point_parameters(-self.mass, np.zeros(3)), place)
