"""Actuators that do not do what they are told: gain, direction, torque constant, delay."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field, model_validator
from scipy.spatial.transform import Rotation

from smsid.effects.assembly import Assembly
from smsid.effects.base import Name, Starting, Vector3, physical, register
from smsid.errors import DescriptionError

if TYPE_CHECKING:
    from smsid.inputs.inputs import Inputs
    from smsid.inputs.signals import Signal
    from smsid.model.spacecraft import SpacecraftModel

THRUSTER = "thruster"


class ActuatorEffect(Starting):
    """An effect between command and actuator, on one of the inputs."""

    family = "actuator"

    def driven_joints(self) -> tuple[str, ...]:
        """Return the joint whose motor torque it has to do with."""
        return () if self.pushes() else (self.target(),)

    def pushes(self) -> bool:
        """Whether the actuator is the net thrust or a single thruster."""
        return self.target() == THRUSTER

    def target(self) -> str:
        """Return the actuator: ``thruster``, a joint or a wheel."""
        return THRUSTER

    def attach(self, assembly: Assembly) -> None:
        """Check that the actuator is there, or raise `DescriptionError`; what it does is in `drive`."""
        target = self.target()
        if target == THRUSTER or target in assembly.thrusters:
            return
        if self.pushes():
            raise DescriptionError(
                f"There is no thruster '{target}'.",
                advice=f"Thrusters: {', '.join(assembly.thrusters) or 'none; list them as [[thruster]]'}.",
                thruster=target,
            )
        assembly.joint_id(target)

    def _change_signal(
        self, inputs: Inputs, model: SpacecraftModel, change: Callable[[Signal, np.ndarray], Signal]
    ) -> Inputs:
        """Return inputs with ``change(signal, own)`` made of the actuator's signal, from the onset on.

        ``own`` are the actuator's components of the signal, one row each (k, size).
        """
        field, columns = locate(model, self.target(), self.name)
        signal: Signal | None = getattr(inputs, field)
        if signal is None:
            return inputs
        after = change(signal, np.eye(signal.size)[columns])
        if self.start is not None:
            from smsid.inputs.changed import Switched  # simulation needs effects, hence here

            after = Switched(signal, after, self.start)
        return replace(inputs, **{field: after})

    def _map_wrench(self, inputs: Inputs, model: SpacecraftModel, matrix: np.ndarray) -> Inputs:
        """Return inputs with the actuator's force (3,) in bus axes, or torque (1,), mapped by a matrix."""
        more = matrix - np.eye(len(matrix))
        return self._change_signal(
            inputs, model, lambda signal, own: signal.mapped(np.eye(signal.size) + own.T @ more @ own)
        )


def locate(model: SpacecraftModel, actuator: str, effect: str) -> tuple[str, slice]:
    """Return which input drives an actuator, and its components there.

    Raises `DescriptionError` for a joint that no motor drives.
    """
    inputs = (
        ("force", (THRUSTER,), 3),
        ("thrusts", tuple(t.name for t in model.description.thruster), 3),
        ("joint_torque", model.arm_joints.names, 1),
        ("wheel_torque", model.wheels.names, 1),
    )
    for field, names, size in inputs:
        if actuator in names:
            first = size * names.index(actuator)
            return field, slice(first, first + size)
    raise DescriptionError(
        f"[[effect]] '{effect}': '{actuator}' is not an actuator.",
        advice=f"Actuators: {', '.join(name for _, names, _ in inputs for name in names)}.",
        actuator=actuator,
    )


class ThrustEffect(ActuatorEffect):
    """An effect on the net thrust, or on one thruster of the description."""

    thruster: Name | None = Field(
        default=None, description="a single thruster by name; the net thrust when not given"
    )

    def target(self) -> str:
        """Return the thruster, or the net thrust."""
        return self.thruster or THRUSTER

    def pushes(self) -> bool:
        """Return that it does."""
        return True


@register
class ThrusterGain(ThrustEffect):
    """Net thrust along each axis of the bus is ``1 + gain`` times the commanded one.

    Of a single ``thruster`` the gain is one number.
    """

    summary = "thrust that is larger or smaller than commanded, axis by axis or of one thruster"
    aliases = ("thruster_misalignment", "body_error", "sensor_scale")
    strength = ("gain",)
    strong = {"gain": (-1.0, 1.0)}  # it cannot pull
    changes = {"gain": ("the thrust has grown", "the thrust has fallen")}
    in_words = "the thrust is not what is commanded"
    kind: Literal["thruster_gain"] = "thruster_gain"
    gain: Vector3 | float = physical(
        "1",
        lower=-1.0,
        default=(0.0, 0.0, 0.0),
        description="relative error along the bus's axes; of a single thruster one number",
    )

    @model_validator(mode="before")
    @classmethod
    def _one_number_for_one_thruster(cls, data: Any) -> Any:
        if isinstance(data, Mapping) and data.get("thruster") is not None and "gain" not in data:
            return {**data, "gain": 0.0}
        return data

    @model_validator(mode="after")
    def _fits_what_it_acts_on(self) -> ThrusterGain:
        if isinstance(self.gain, tuple) == (self.thruster is not None):
            wanted = "one number" if self.thruster is not None else "three numbers, one per axis of the bus"
            raise ValueError(f"`gain` takes {wanted}" + ("" if self.thruster else " (or name a `thruster`)"))
        return self

    def drive(self, inputs: Inputs, model: SpacecraftModel) -> Inputs:
        """Scale the force."""
        return self._map_wrench(inputs, model, np.diag(1.0 + np.broadcast_to(np.asarray(self.gain), 3)))


@register
class ThrusterMisalignment(ThrustEffect):
    """Thrust is turned by a rotation vector from what is commanded; it acts at the same point.

    Of a single thruster the part along its own direction does nothing: give ``angles`` a prior there.
    """

    summary = "thrust that points elsewhere than commanded"
    aliases = ("thruster_gain", "external_wrench", "sensor_misalignment")
    strength = ("angles",)
    in_words = "the thrust points elsewhere than commanded"
    kind: Literal["thruster_misalignment"] = "thruster_misalignment"
    angles: Vector3 = physical(
        "rad",
        lower=-np.pi,
        upper=np.pi,
        default=(0.0, 0.0, 0.0),
        description="rotation vector from the commanded to the true force, bus axes",
    )

    def drive(self, inputs: Inputs, model: SpacecraftModel) -> Inputs:
        """Turn the force."""
        return self._map_wrench(inputs, model, Rotation.from_rotvec(self.angles).as_matrix())


@register
class TorqueGain(ActuatorEffect):
    """The torque of a joint's or wheel's motor is ``1 + error`` times the commanded one.

    -1: it does not turn; -2: the sign is reversed.
    """

    summary = "wrong torque constant of a motor"
    aliases = ("joint_friction", "body_error")
    strength = ("error",)
    strong = {"error": (-2.0, -1.0, 1.0)}  # the other way, not at all, twice
    changes = {"error": ("its motor gives more torque", "its motor gives less torque")}
    in_words = "the torque of {place} is not what is commanded, by a factor"
    kind: Literal["torque_gain"] = "torque_gain"
    joint: str = Field(description="joint of an arm, or wheel")
    error: float = physical("1", default=0.0, description="relative error of the torque; -2: its sign")

    def target(self) -> str:
        """Return the joint."""
        return self.joint

    def drive(self, inputs: Inputs, model: SpacecraftModel) -> Inputs:
        """Scale the torque."""
        return self._map_wrench(inputs, model, np.array([[1.0 + self.error]]))


@register
class ActuatorDelay(ActuatorEffect):
    """What is commanded at t acts at ``t + delay``; before the first command nothing acts."""

    summary = "commands that act late"
    aliases = ("joint_friction", "time_offset", "sensor_delay")
    strength = ("delay",)
    shifts_time = True
    in_words = "{place} acts later than it is commanded"
    kind: Literal["actuator_delay"] = "actuator_delay"
    actuator: str = Field(
        default=THRUSTER, description="`thruster`, a single thruster, a joint of an arm, or a wheel"
    )
    delay: float = physical(
        "s", lower=0.0, may_vanish=True, default=0.0, description="from command to action"
    )

    def target(self) -> str:
        """Return the actuator."""
        return self.actuator

    def drive(self, inputs: Inputs, model: SpacecraftModel) -> Inputs:
        """Delay the signal."""
        if self.delay == 0.0:
            return inputs
        from smsid.inputs.changed import Delayed  # simulation needs effects, hence here
        from smsid.inputs.signals import Sum

        def change(signal: Signal, own: np.ndarray) -> Signal:
            if len(own) == signal.size:
                return Delayed.of(signal, self.delay)
            part = own.T @ own
            late = Delayed.of(signal.mapped(part), self.delay)
            return Sum((signal.mapped(np.eye(signal.size) - part), late))

        return self._change_signal(inputs, model, change)
