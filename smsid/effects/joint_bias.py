"""What is constant at a joint: the zero of its encoder, a torque, a cable with an angle of rest."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from typing import TYPE_CHECKING, Literal

import numpy as np

from smsid.effects.assembly import Assembly
from smsid.effects.base import Effect, JointEffect, Starting, physical, register
from smsid.effects.force_laws import ConstantForce, Spring
from smsid.effects.joint_state import Counterpart, JointStateOf, TorqueColumns
from smsid.effects.sensor import joint_names
from smsid.effects.sensor_errors import SensorBias
from smsid.errors import DescriptionError

if TYPE_CHECKING:
    from smsid.description.schema import Description
    from smsid.sensing.sensor import Sensor


@register
class JointOffset(JointEffect):
    """The joint's angle is the encoder's reading plus ``angle``. It changes what is measured, not the
    motion.
    """

    on_readings = True
    summary = "zero of a joint's encoder: joint angle minus reading"
    aliases = ("sensor_bias",)
    strength = ("angle",)
    in_words = "the angle of {place} has an offset"
    kind: Literal["joint_offset"] = "joint_offset"
    angle: float = physical("rad", description="added to the reading")

    def driven_joints(self) -> tuple[str, ...]:
        """Return none: the motor's torque does not come into it."""
        return ()

    def resolved(self, description: Description) -> Effect:
        """Return what it does to the joint's own encoder."""
        return _EncoderZero(
            name=self.name, column=joint_names(description).index(self.joint), bias=-self.angle
        )


class _EncoderZero(Effect):
    """A bias of one joint's encoder, whichever sensor it is."""

    kind: Literal["encoder_zero"] = "encoder_zero"
    column: int
    bias: float

    def adjust(self, sensor: Sensor) -> Sensor:
        """Return the sensor with the bias, if it measures joint angles."""
        if "joint_position" not in sensor.quantities:
            return sensor
        bias = SensorBias(
            name=self.name,
            sensor=sensor.name,
            quantity="joint_position",
            component=self.column,
            bias=self.bias,
        )
        return bias.adjust(sensor)


@register
class TorqueOffset(JointEffect):
    """A constant torque the motor has to give: a bias of its current, or friction that differs by direction.

    Coulomb friction ``F+`` forwards and ``F-`` backwards is a friction of ``(F+ + F-) / 2`` and an offset of
    ``(F+ - F-) / 2``.
    """

    summary = "constant torque at a joint: current bias, or friction that differs by direction"
    aliases = ("joint_friction",)
    strength = ("torque",)
    in_words = "a constant torque acts at {place}"
    kind: Literal["torque_offset"] = "torque_offset"
    torque: float = physical("N m", default=0.0, description="that the motor gives beyond what moves the arm")

    def torque_columns(self, of: JointStateOf) -> TorqueColumns:
        """Return a constant."""
        return {"torque": {self.joint: np.ones_like(of(self.joint).rate)}}

    def attach(self, assembly: Assembly) -> None:
        """Add the constant torque, against the motor."""
        assembly.add_force(ConstantForce([assembly.joint(self.joint).idx_v], [-self.torque]))

    def counterpart(self, limits: Mapping[str, float]) -> Counterpart:
        """Return the constant torque."""
        return Counterpart({self.joint: 1.0}, torque=-self.torque)


def encoder_zeros(effects: Iterable[Effect]) -> dict[str, float]:
    """Return what is to be added to encoders' readings, by joint [rad | m], of effects."""
    return {e.joint: e.angle for e in effects if isinstance(e, JointOffset)}


def without_idle_offsets(effects: Iterable[Effect], joints: Container[str]) -> list[Effect]:
    """Return effects without the constant torques of joints that have no value yet."""
    return [e for e in effects if not (isinstance(e, TorqueOffset) and e.torque == 0.0 and e.joint in joints)]


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
        if self.stiffness:
            assembly.add_force(Spring(joint.idx_v, joint.idx_q, self.stiffness, self.rest))

    def counterpart(self, limits: Mapping[str, float]) -> Counterpart:
        """Return the spring, at rest where the joint is zero, and a constant torque."""
        return Counterpart({self.joint: 1.0}, torque=self.stiffness * self.rest, stiffness=self.stiffness)
