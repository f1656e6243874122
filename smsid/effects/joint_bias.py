"""What is constant at a joint: the zero of its encoder, and a torque that does not depend on motion."""

from __future__ import annotations

from collections.abc import Container, Iterable
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import Field

from smsid.effects.base import Effect, physical, register
from smsid.effects.joint_state import JointStateOf, TorqueColumns
from smsid.effects.sensor import joint_names
from smsid.sensing.component import ComponentError

if TYPE_CHECKING:
    from smsid.description.schema import Description
    from smsid.effects.assembly import Assembly
    from smsid.sensing.sensor import Sensor


@register
class JointOffset(Effect):
    """The joint's angle is the encoder's reading plus ``angle``. It changes what is measured, not the
    motion.
    """

    summary: ClassVar[str] = "zero of a joint's encoder: joint angle minus reading"
    family: ClassVar[str] = "drivetrain"
    aliases: ClassVar[tuple[str, ...]] = ("sensor_bias",)
    strength: ClassVar[tuple[str, ...]] = ("angle",)
    on_readings: ClassVar[bool] = True
    kind: Literal["joint_offset"] = "joint_offset"
    joint: str = Field(description="joint of the model")
    angle: float = physical("rad", description="added to the reading")

    def attach(self, assembly: Assembly) -> None:
        """Check that the joint is there; nothing acts on the motion."""
        assembly.joint_id(self.joint)

    def resolved(self, description: Description) -> Effect:
        """Return what it does to the joint's own encoder; of a welded arm the torque regression has it."""
        if description.root == "fixed":
            return self
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
        if "joint_position" not in sensor.quantities or not self.bias:
            return sensor
        error, key = sensor.error("joint_position"), str(self.column)
        own = error.components.get(key, ComponentError())
        own = own.model_copy(update={"bias": own.bias + self.bias})
        error = error.model_copy(update={"components": {**error.components, key: own}})
        return sensor.model_copy(update={"errors": {**sensor.errors, "joint_position": error}})


@register
class TorqueOffset(Effect):
    """A constant torque the motor has to give: a bias of its current, or friction that differs by direction.

    Coulomb friction ``F+`` forwards and ``F-`` backwards is a friction of ``(F+ + F-) / 2`` and an offset of
    ``(F+ - F-) / 2``.
    """

    summary: ClassVar[str] = "constant torque at a joint: current bias, or friction that differs by direction"
    family: ClassVar[str] = "drivetrain"
    aliases: ClassVar[tuple[str, ...]] = ("joint_friction",)
    strength: ClassVar[tuple[str, ...]] = ("torque",)
    kind: Literal["torque_offset"] = "torque_offset"
    joint: str = Field(description="joint of the model")
    torque: float = physical("N m", default=0.0, description="that the motor gives beyond what moves the arm")

    def driven_joints(self) -> tuple[str, ...]:
        """Return the joint whose motor torque it has to do with."""
        return (self.joint,)

    def torque_columns(self, of: JointStateOf) -> TorqueColumns:
        """Return a constant."""
        return {"torque": {self.joint: np.ones_like(of(self.joint).rate)}}

    def attach(self, assembly: Assembly) -> None:
        """Add the constant torque, against the motor."""
        index = assembly.model.joints[assembly.joint_id(self.joint)].idx_v
        torque = self.torque

        def force(t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
            tau[index] -= torque

        assembly.add_force(force, (), ((), ()))


def encoder_zeros(effects: Iterable[Effect]) -> dict[str, float]:
    """Return what is to be added to encoders' readings, by joint [rad | m], of effects."""
    return {e.joint: e.angle for e in effects if isinstance(e, JointOffset)}


def without_idle_offsets(effects: Iterable[Effect], joints: Container[str]) -> list[Effect]:
    """Return effects without the constant torques of joints that have no value yet."""
    return [e for e in effects if not (isinstance(e, TorqueOffset) and e.torque == 0.0 and e.joint in joints)]
