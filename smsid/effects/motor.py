"""Motors of an arm: the inertia of rotors seen through gears, and motors that turn with several joints."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from smsid.effects.assembly import Assembly
from smsid.effects.base import Effect, JointEffect, physical, register
from smsid.effects.joint_state import Counterpart, JointStateOf, TorqueColumns
from smsid.effects.spatial import ConstantInertia


@register
class MotorInertia(JointEffect):
    """The rotor's spin inertia seen at the joint, ratio squared times its own: torque ``inertia * qdd``.

    Gyroscopic torques of the spinning rotor are left out, as usual for geared arms.
    """

    summary = "inertia of a motor's rotor, seen at its joint"
    aliases = ("body_error", "joint_friction")
    strength = ("inertia",)
    in_words = "the motor of {place} adds inertia that the description lacks"
    kind: Literal["motor_inertia"] = "motor_inertia"
    inertia: float = physical(
        "kg m^2", lower=0.0, description="at the joint: ratio squared times the rotor's"
    )

    def torque_columns(self, of: JointStateOf) -> TorqueColumns:
        """Return the joint's acceleration."""
        return {"inertia": {self.joint: of(self.joint).acceleration}}

    def attach(self, assembly: Assembly) -> None:
        """Add the inertia to the joint's armature."""
        assembly.model.armature[assembly.joint(self.joint).idx_v] += self.inertia


@register
class MotorCoupling(Effect):
    """A motor that turns with a sum of joints, ``s = ratios . q``, as that of the last joint of many wrists.

    Its rotor and friction act on s: every joint takes part in the torque
    ``inertia sdd + viscous sd + coulomb tanh(sd / smoothing)``, times its ratio. `JointFriction` and
    `MotorInertia` of the single joints stay beside it.
    """

    summary = "a motor that turns with a sum of joints: its inertia and friction"
    family = "drivetrain"
    aliases = ("joint_friction", "motor_inertia")
    strength = ("inertia", "viscous", "coulomb")
    in_words = "the motors of {place} are coupled"
    kind: Literal["motor_coupling"] = "motor_coupling"
    joints: tuple[str, ...] = Field(min_length=2, description="joints that turn the motor")
    ratios: tuple[float, ...] = Field(
        default=(), description="weight of each joint in s; all 1 when not given"
    )
    inertia: float = physical("kg m^2", lower=0.0, default=0.0, description="of the motor, for s")
    viscous: float = physical("N m s/rad", lower=0.0, default=0.0, description="torque on s per rate of s")
    coulomb: float = physical("N m", lower=0.0, default=0.0, description="torque on s at speed")
    smoothing: float = Field(
        default=0.005, gt=0.0, description="rate of s at which the Coulomb torque reaches 76 % [rad/s]"
    )

    @model_validator(mode="after")
    def _one_ratio_per_joint(self) -> MotorCoupling:
        if self.ratios and len(self.ratios) != len(self.joints):
            raise ValueError(f"{len(self.joints)} `joints` but {len(self.ratios)} `ratios`")
        if len(set(self.joints)) != len(self.joints):
            raise ValueError("a joint is named twice")
        return self

    @property
    def weights(self) -> tuple[float, ...]:
        """Weight of each joint in s."""
        return self.ratios or (1.0,) * len(self.joints)

    def driven_joints(self) -> tuple[str, ...]:
        """Return the joints whose motor torque it has to do with."""
        return self.joints

    def joint_weights(self) -> dict[str, float]:
        """Return the weight of each joint in s."""
        return dict(zip(self.joints, self.weights, strict=True))

    def torque_columns(self, of: JointStateOf) -> TorqueColumns:
        """Return what s needs, times the weights."""
        weights, states = self.joint_weights(), {j: of(j) for j in self.joints}
        rate = sum(w * states[j].rate for j, w in weights.items())
        acceleration = sum(w * states[j].acceleration for j, w in weights.items())
        parts = {"inertia": acceleration, "viscous": rate, "coulomb": np.tanh(rate / self.smoothing)}
        return {f: {j: w * x for j, w in weights.items()} for f, x in parts.items()}

    def torque_shapes(self) -> tuple[str, ...]:
        """Return the width of the sign."""
        return ("smoothing",)

    def attach(self, assembly: Assembly) -> None:
        """Add the friction of s as a generalised force, and the rotor's inertia ``inertia w w'`` on the
        joints' rates.
        """
        index = np.array([assembly.joint(name).idx_v for name in self.joints])
        weights = np.asarray(self.weights)
        viscous, coulomb, smoothing = self.viscous, self.coulomb, self.smoothing

        def force(t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
            rate = weights @ v[index]
            tau[index] -= weights * (viscous * rate + coulomb * np.tanh(rate / smoothing))

        if viscous or coulomb:
            assembly.add_force(force, ((), index.tolist()))
        if self.inertia > 0.0:
            shared = np.outer(weights, weights) * self.inertia
            assembly.model.armature[index] += np.diag(shared)  # what each joint feels of it by itself
            shared[np.diag_indices(index.size)] = 0.0

            def rotor(mass: np.ndarray) -> None:
                mass[np.ix_(index, index)] = shared

            assembly.add_inertia_term(ConstantInertia(rotor))

    def counterpart(self, limits: Mapping[str, float]) -> Counterpart:
        """Return its damper, dry friction and rotor."""
        weights = dict(zip(self.joints, self.weights, strict=True))
        return Counterpart(weights, damping=self.viscous, dry=self.coulomb, inertia=self.inertia)
