"""Three recordings to plant faults in, each with the way it is identified: a craft, a satellite, an arm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pinocchio as pin
from _common import ROOT
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from smsid.arm import identify_arm, with_joint_effects
from smsid.arm.identify import rigid_arm
from smsid.arm.setup import arm_description
from smsid.description import Description, load_description
from smsid.estimation.identify import identify_spacecraft
from smsid.experiments import fly, named_experiment
from smsid.identify.estimate import Estimate
from smsid.model import build_model
from smsid.recording import Recording

FloatArray = NDArray[np.float64]
JOINTS = ("joint1", "joint2", "joint3")
INERTIA = np.array([[80.0, 1.0, 0.0], [1.0, 95.0, -2.0], [0.0, -2.0, 70.0]])  # wheels locked [kg m^2]
SPIN = 0.04  # of a wheel [kg m^2]
SATELLITE = f"""<robot name="satellite"><link name="bus"><inertial><mass value="300"/>
<inertia ixx="{INERTIA[0, 0]}" ixy="{INERTIA[0, 1]}" ixz="{INERTIA[0, 2]}" iyy="{INERTIA[1, 1]}"
 iyz="{INERTIA[1, 2]}" izz="{INERTIA[2, 2]}"/></inertial></link></robot>"""
WHEELS = "".join(
    f'[[wheel]]\nname = "rw{k + 1}"\naxis = {axis}\ninertia = {SPIN}\n'
    for k, axis in enumerate(np.eye(3).tolist())
)
TOML = f"""schema = 1
name = "satellite"
urdf = "satellite.urdf"
{WHEELS}
[[sensor]]
name = "tracker"
kind = "pose"
quantities = ["attitude"]
rate = 20.0
errors.attitude = {{ noise_sigma = 3e-5 }}
[[sensor]]
name = "gyro"
kind = "imu"
quantities = ["angular_rate"]
rate = 20.0
errors.angular_rate = {{ noise_sigma = 1e-5 }}
[[sensor]]
name = "tachometer"
kind = "tachometer"
rate = 20.0
errors.wheel_rate = {{ noise_sigma = 0.02 }}
"""


def satellite(seed: int) -> Recording:
    """Record a rigid satellite without arm for 200 s at 20 Hz: wheels, star tracker, gyro, tachometers.

    All begins at rest, so there is no momentum, and its conservation gives the motion in closed form.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 200.0, 0.05)
    w = 2.0 * np.pi * rng.uniform(0.02, 0.12, 3)
    torque = 0.08 * np.sin(w * t[:, None])
    spun = 0.08 * (1.0 - np.cos(w * t[:, None])) / w  # momentum of the wheels [N m s]
    rate = -np.linalg.solve(INERTIA - SPIN * np.eye(3), spun.T).T
    wheel = spun / SPIN - rate
    q = np.zeros((t.size, 4))
    q[0] = (0.1, -0.2, 0.3, np.sqrt(1.0 - 0.14))
    for k in range(t.size - 1):
        turn = 0.5 * (rate[k] + rate[k + 1]) * 0.05
        half = 0.5 * float(np.linalg.norm(turn))
        step = np.append(0.5 * turn * np.sinc(half / np.pi), np.cos(half))
        q[k + 1] = (Rotation.from_quat(q[k]) * Rotation.from_quat(step)).as_quat()
    small = np.column_stack([0.5 * 3e-5 * rng.standard_normal((t.size, 3)), np.ones(t.size)])
    q = (Rotation.from_quat(q) * Rotation.from_quat(small)).as_quat()
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    return Recording.from_arrays(
        t,
        {
            "tracker.attitude": q,
            "gyro.angular_rate": rate + 1e-5 * rng.standard_normal(rate.shape),
            "tachometer.wheel_rate": wheel + 0.02 * rng.standard_normal(wheel.shape),
            "command.wheel_torque": torque,
        },
        labels={"wheel": ["rw1", "rw2", "rw3"]},
        role="estimation",
        name="satellite",
    )


def arm(seed: int) -> Recording:
    """Record an arm of three joints for 40 s at 100 Hz: encoder angles, joint rates and motor torques."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 40.0, 0.01)
    angle, rate, change = (np.zeros((t.size, 3)) for _ in range(3))
    for k in range(3):
        for _ in range(3):
            w, a, p = rng.uniform(0.5, 3.0), rng.uniform(0.1, 0.4), rng.uniform(0.0, 6.0)
            angle[:, k] += a * np.sin(w * t + p)
            rate[:, k] += a * w * np.cos(w * t + p)
            change[:, k] -= a * w**2 * np.sin(w * t + p)
    twin = rigid_arm(_arm()).pin
    data = twin.createData()
    torque = np.array([pin.rnea(twin, data, *x) for x in zip(angle, rate, change, strict=True)])
    torque += 4.0 * rate + 3.0 * np.tanh(rate / 0.01)
    return Recording.from_arrays(
        t,
        {
            "encoder.joint_position": angle + 2e-5 * rng.standard_normal(angle.shape),
            "encoder.joint_velocity": rate + 2e-3 * rng.standard_normal(rate.shape),
            "drive.joint_torque": torque + 1.0 * rng.standard_normal(torque.shape),
        },
        labels={"joint": JOINTS},
        role="estimation",
        name="arm",
    )


def craft(seed: int) -> Recording:
    """Fly the paper's craft in Exp. 2 with the sensors of its description."""
    model = build_model(_craft())
    return fly(model, named_experiment("exp2", model), np.random.default_rng(seed)).recording


@cache
def _craft() -> Description:
    return load_description(ROOT / "urdf" / "paper_sms.toml")


@cache
def _satellite() -> Description:
    folder = Path(mkdtemp(prefix="smsid_faults_"))
    (folder / "satellite.urdf").write_text(SATELLITE, encoding="utf-8")
    (folder / "satellite.toml").write_text(TOML, encoding="utf-8")
    return load_description(folder / "satellite.toml")


@cache
def _arm() -> Description:
    bare = arm_description(ROOT / "urdf" / "arm3.urdf")
    return with_joint_effects(bare, JOINTS, "joint_friction", "motor_inertia", "torque_offset")


@dataclass(frozen=True)
class Kind:
    """A kind of recording: how one is made of a seed, where faults are planted, how it is identified."""

    make: Callable[[int], Recording]
    channels: tuple[str, ...]
    identify: Callable[[Recording], Estimate]


KINDS = {
    "paper's craft": Kind(
        craft,
        ("imu.angular_rate", "pose.velocity", "encoder.joint_velocity", "encoder.joint_position"),
        lambda recording: identify_spacecraft(_craft(), [recording]).estimate,
    ),
    "satellite without arm": Kind(
        satellite,
        ("gyro.angular_rate", "tracker.attitude"),
        lambda recording: identify_spacecraft(_satellite(), [recording]).estimate,
    ),
    "arm": Kind(
        arm,
        ("encoder.joint_position", "encoder.joint_velocity"),
        lambda recording: identify_arm(_arm(), recording).estimate,
    ),
}
