"""A bending mode that an appendage's description leaves out."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pinocchio as pin
from pydantic import Field, model_validator

from smsid.effects.appendage_effect import AppendageEffect
from smsid.effects.assembly import Assembly
from smsid.effects.base import Vector3, physical, register
from smsid.effects.payload import point_parameters


@register
class ExtraMode(AppendageEffect):
    """One more mode of an appendage: ``mass`` of it slides on a spring at ``position`` along ``direction``.

    With n the unit vector of the direction its participation factors are ``L_t = sqrt(mass) n`` and ``L_r =
    position x L_t``. The mass is taken out of the rigid rest. Stations do not see the mode, as its shape is
    not known there.
    """

    nominal = True
    summary = "one more bending mode of an appendage, as a mass on a spring"
    aliases = ("slosh", "frequency_drift")
    strength = ("mass",)
    in_words = "{place} has a mode that the description lacks"
    kind: Literal["extra_mode"] = "extra_mode"
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
        panel = self.panel(assembly).appendage
        if self.mass == 0.0:
            return
        axis = np.asarray(self.direction) / np.linalg.norm(self.direction)
        place = panel.placement * pin.SE3(np.eye(3), np.asarray(self.position))
        joint = assembly.add_joint(panel.frame, pin.JointModelPrismaticUnaligned(axis), place, self.name)
        assembly.add_inertia(joint, pin.Inertia(self.mass, np.zeros(3), np.zeros((3, 3))))
        omega = 2 * np.pi * self.frequency
        assembly.add_springs(joint, (self.mass * omega**2,), (2 * self.damping * omega * self.mass,))
        assembly.add_remainder(panel.frame, point_parameters(-self.mass, np.zeros(3)), place)
