"""Recordings of the MuJoCo twin for the tests of maximum likelihood, made once per session of tests."""

from __future__ import annotations

import zlib
from functools import cache
from pathlib import Path

import numpy as np
from twins.mujoco_twin import Drive, MujocoTwin
from twins.recordings import Q0_ARM, thrust
from twins.state import State

from smsid.description import load_description
from smsid.description.schema import Description
from smsid.model import SpacecraftModel, build_model
from smsid.recording import Recording
from smsid.sensing import Sensor, add_noise

URDF = Path(__file__).resolve().parents[2] / "urdf"
BIASES = {"acceleration": 1e-4, "angular_rate": 1e-5}  # one sigma, drawn per axis [m/s^2, rad/s]
CHANNELS = {
    "pose.position": "base_pos_P",
    "pose.velocity": "base_vel_P",
    "imu.acceleration": "acc_imu_body",
    "imu.angular_rate": "omega_body",
    "encoder.joint_position": "q",
    "encoder.joint_velocity": "qd",
    "tachometer.wheel_rate": "rw_rate",
    "panel.acceleration": "panel_acc_base",
    "command.force": "force_body",
}

# torques of the reference recording of Exp. 2, harmonics 1 to 5 of 1/40 Hz, rounded [N m]
WHEEL_COS = np.array(
    [
        [0.2167, -0.0563, -0.1796, 0.0930, 0.1732],
        [0.1026, 0.0731, 0.3243, -0.3792, -0.1953],
        [0.2974, 0.1764, 0.1347, 0.0862, 0.2051],
    ]
)
WHEEL_SIN = np.array(
    [
        [-0.0725, 0.1315, 0.2518, -0.0500, -0.1965],
        [-0.2474, -0.5118, 0.0373, 0.1558, -0.2181],
        [-0.2859, 0.1318, 0.1294, -0.3795, 0.0745],
    ]
)
JOINT_COS = np.array(
    [
        [1.2309, -4.2414, -6.5054, 5.0738, 5.9987],
        [1.0779, -1.1264, -0.4638, -3.6429, 14.7415],
        [0.3731, -0.7229, -0.2492, -1.4449, 1.8751],
    ]
)
JOINT_SIN = np.array(
    [
        [-0.9939, -4.3173, 5.3775, 6.1946, -4.5277],
        [3.0639, -2.1717, -0.8646, -1.1323, -5.2294],
        [0.8715, -0.9298, 0.1934, -1.6903, 0.0866],
    ]
)


@cache
def description() -> Description:
    return load_description(URDF / "paper_sms.toml")


@cache
def model() -> SpacecraftModel:
    return build_model(description())


@cache
def exp1(axes: tuple[int, int, int] = (1, 1, 1), duration: float = 120.0) -> Recording:
    """Thrust (48) with the attitude held, without noise."""
    drive = Drive(force_body=thrust(np.array(axes, dtype=float), duration))
    data = MujocoTwin().simulate(drive, duration, initial=State(q=Q0_ARM.copy()), hold=True, dt=1e-2)
    return recording(data, "exp1")


@cache
def exp2(duration: float = 80.0, stiff: tuple[tuple[str, float], ...] = ()) -> Recording:
    """Fourier torques on wheels and arm, free floating, without noise.

    ``stiff``: joints and wheels with a rotor of so much inertia [kg m^2] behind a gear that nothing feels: at
    1e12 they are locked, at less they give way a little.
    """
    order = 2 * np.pi / 40.0 * np.arange(1, 6)

    def series(t: float, cos: np.ndarray, sin: np.ndarray) -> np.ndarray:
        return cos @ np.cos(order * t) + sin @ np.sin(order * t)

    def wheels(t: float) -> np.ndarray:
        return series(t, WHEEL_COS, WHEEL_SIN)

    def joints(t: float) -> np.ndarray:
        return series(t, JOINT_COS, JOINT_SIN)

    drive = Drive(wheel_torque=wheels, joint_torque=joints)
    engine = MujocoTwin()
    velocities = (*model().wheels.names, *model().arm_joints.names)
    for name, inertia in stiff:
        engine.model.dof_armature[6 + velocities.index(name)] = inertia
    data = engine.simulate(drive, duration, initial=State(q=Q0_ARM.copy()), dt=1e-2 if stiff else 5e-3)
    return recording(data, "exp2")


def recording(data: dict[str, np.ndarray], name: str) -> Recording:
    channels = {mine: data[theirs] for mine, theirs in CHANNELS.items()}
    channels["pose.attitude"] = data["quat_wxyz"][:, [1, 2, 3, 0]]
    labels = {"joint": list(model().arm_joints.names), "wheel": list(model().wheels.names)}
    return Recording.from_arrays(data["t"], channels, labels=labels, role="estimation", name=name)


def sensors(*, biased: bool = True) -> list[Sensor]:
    """The description's sensors, with biases drawn once per recording."""
    out = []
    for sensor in description().sensor:
        errors = {
            quantity: e.model_copy(update={"bias_sigma": BIASES[quantity]})
            if biased and quantity in BIASES
            else e
            for quantity, e in sensor.errors.items()
        }
        out.append(sensor.model_copy(update={"errors": errors}))
    return out


def noisy(clean: Recording, seed: int, *, biased: bool = True) -> Recording:
    rng = np.random.default_rng([seed, zlib.crc32(clean.name.encode())])
    return add_noise(clean, sensors(biased=biased), rng)
