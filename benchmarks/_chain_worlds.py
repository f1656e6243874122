"""Effects hidden in recordings of the craft whose panel is a chain, exactly: the motion stays what it is.

Sensor errors change what was read; drag and gains change what was commanded for the same motion; a payload is
taken out of the described link. Nothing of this project's equations is in what they do to a motion.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from smsid.description.schema import Description
from smsid.effects import BodyError
from smsid.effects.payload import point_parameters
from smsid.recording import Recording

TOOL = np.array([2.0, 0.0, 0.0])  # of the paper's arm, in the last link's frame [m]
Channels = dict[str, np.ndarray]


@dataclass(frozen=True)
class World:
    """What is hidden in a recording: kind and location of the cause, its parameters by the name's ending.

    ``change`` is made to the noise-free channels, ``less`` to the description.
    """

    kind: str
    location: str
    truth: Mapping[str, float]
    change: Callable[[np.ndarray, Channels], Channels] = lambda time, channels: {}
    less: Callable[[Description], Description] = lambda description: description

    def hidden(self, description: Description, recording: Recording) -> tuple[Description, Recording]:
        """Return the description to be judged and the recording with the effect in it."""
        channels = {c: np.array(recording[c]) for c in recording.channels}
        changed = self.change(np.asarray(recording.time()), channels)
        return self.less(description), recording.with_channels(changed)


def _added(channel: str, value: list[float]) -> Callable[[np.ndarray, Channels], Channels]:
    return lambda time, channels: {channel: channels[channel] + np.array(value)}


def _rubbed(group: str, column: int, torque: Callable[[np.ndarray], np.ndarray]) -> Callable[..., Channels]:
    """Return the change by a friction: the motor was told what overcomes it."""
    rate = {"joint": "encoder.joint_velocity", "wheel": "tachometer.wheel_rate"}[group]

    def change(time: np.ndarray, channels: Channels) -> Channels:
        out = channels[f"command.{group}_torque"].copy()
        out[:, column] += torque(channels[rate][:, column])
        return {f"command.{group}_torque": out}

    return change


def _scaled(channel: str, column: int, factor: float) -> Callable[..., Channels]:
    def change(time: np.ndarray, channels: Channels) -> Channels:
        out = channels[channel].copy()
        out[:, column] *= factor
        return {channel: out}

    return change


def _late(channel: str, delay: float) -> Callable[..., Channels]:
    def change(time: np.ndarray, channels: Channels) -> Channels:
        return {channel: CubicSpline(time, channels[channel])(np.maximum(time - delay, time[0]))}

    return change


def _elsewhere(offset: list[float]) -> Callable[..., Channels]:
    """Return the change by an IMU that sits elsewhere, from rates and their derivatives as simulated."""

    def change(time: np.ndarray, channels: Channels) -> Channels:
        w, alpha = channels["imu.angular_rate"], channels["imu.angular_acceleration"]
        more = np.cross(alpha, offset) + np.cross(w, np.cross(w, offset))
        return {"imu.acceleration": channels["imu.acceleration"] + more}

    return change


def _without(mass: float) -> Callable[[Description], Description]:
    """Return what takes a point mass at the tool out of the described last link."""

    def less(description: Description) -> Description:
        m, first, inertia = np.split(-point_parameters(mass, TOOL), [1, 4])
        lighter = BodyError(
            name="lighter", body="link3", mass=float(m[0]), first_moment=tuple(first), inertia=tuple(inertia)
        )
        return description.with_effects(lighter)

    return less


WORLDS: dict[str, World] = {
    "gyro bias": World(
        "sensor_bias", "imu.angular_rate", {"bias.y": 2e-3}, _added("imu.angular_rate", [0.0, 2e-3, 0.0])
    ),
    "lever arm": World("lever_arm", "imu", {"offset.x": 0.2}, _elsewhere([0.2, 0.0, 0.0])),
    "encoder bias": World(
        "sensor_bias", "encoder.joint_position[joint2]", {"bias": 0.01},
        _added("encoder.joint_position", [0.0, 0.01, 0.0]),
    ),
    "encoder delay": World(
        "sensor_delay", "encoder.joint_position", {"delay": 0.03}, _late("encoder.joint_position", 0.03)
    ),
    "tachometer scale": World(
        "sensor_scale", "tachometer.wheel_rate[wheel_z]", {"error": 0.02},
        _scaled("tachometer.wheel_rate", 2, 1.02),
    ),
    "wheel drag": World(
        "joint_friction", "wheel_y", {"viscous": 2e-3}, _rubbed("wheel", 1, lambda v: 2e-3 * v)
    ),
    "joint drag": World("joint_friction", "joint2", {"viscous": 2.0}, _rubbed("joint", 1, lambda v: 2.0 * v)),
    "joint friction": World(
        "joint_friction", "joint3", {"coulomb": 0.2}, _rubbed("joint", 2, lambda v: 0.2 * np.tanh(v / 0.005))
    ),
    "motor gain": World(
        "torque_gain", "joint2", {"error": 0.05}, _scaled("command.joint_torque", 1, 1.0 / 1.05)
    ),
    "wheel gain": World(
        "torque_gain", "wheel_x", {"error": -0.1}, _scaled("command.wheel_torque", 0, 1.0 / 0.9)
    ),
    "payload of 2 kg": World("payload", "tool", {"mass": 2.0}, less=_without(2.0)),
    "payload of 10 kg": World("payload", "tool", {"mass": 10.0}, less=_without(10.0)),  # not 16
}  # fmt: skip
"""By name; each is hidden in ``exp2``."""
