"""What the tests of identification share: analytic Exp. 1, the reference recordings, noise, exact motions."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.signal

from smsid.description import Description, load_description
from smsid.identify.paper.motion import MeasuredMotion
from smsid.recording import Recording, import_recording
from smsid.sensing import add_noise

URDF = Path(__file__).parents[2] / "urdf"
ORACLE = os.environ.get("SMSID_ORACLE", "")
oracle = pytest.mark.skipif(
    not (ORACLE and Path(ORACLE).is_dir()),
    reason="SMSID_ORACLE does not name the folder of MuJoCo recordings",
)

M, TANK = 2256.8, (49.6, 0.41, 0.02)  # [kg], (kg, N/m, N s/m)
TWO_TANKS = (TANK, (70.0, 0.9, 0.04))
PARTICIPATION = np.array([7.7195, 4.2782, 2.5084])  # [kg^.5]
OMEGA = 2 * np.pi * np.array([0.045696, 0.286373, 0.801848])  # [rad/s]
SHAPES = 0.3 * np.array([[0.1655, 0.547, 1.0], [-0.59, -0.423, 1.0], [0.722, -0.644, 1.0]]).T


def paper() -> Description:
    return load_description(URDF / "paper_sms.toml")


def fly_exp1(tanks, *, panel: bool = False, rate: float = 100.0, duration: float = 120.0):
    """Exp. 1 along one axis from Newton's equations, discretised exactly: t, thrust, accelerations (N, dof).

    At a step of thrust a sample is the mean of both sides. Columns: base, tanks and modes relative to it.
    """
    n = 1 + len(tanks) + 3 * panel
    mass, k, d = np.zeros((3, n, n))
    mass[0, 0] = M
    for i, (m_s, k_s, b_s) in enumerate(tanks, start=1):
        mass[i, i] = mass[0, i] = mass[i, 0] = m_s
        k[i, i], d[i, i] = k_s, b_s
    for i, (lt, w) in (
        enumerate(zip(PARTICIPATION, OMEGA, strict=True), start=1 + len(tanks)) if panel else ()
    ):
        mass[i, i], mass[0, i], mass[i, 0] = 1.0, lt, lt
        k[i, i], d[i, i] = w * w, 0.01 * w
    inverse = np.linalg.inv(mass)
    a = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ k, -inverse @ d]])
    b = np.concatenate([np.zeros(n), inverse[:, 0]])[:, None]
    system = a, b, np.hstack([-inverse @ k, -inverse @ d]), inverse[:, :1]
    t = np.arange(round(duration * rate) + 1) / rate
    force = np.where(t < 20, 40.0, np.where(t < 40, -40.0, 0.0))
    discrete: Any = scipy.signal.cont2discrete(system, 1 / rate)
    acceleration = _held(discrete, force)
    half = np.diff(force, prepend=force[0]) / 2
    return t, force - half, acceleration - np.outer(half, inverse[:, 0])


def _held(system: Sequence[Any], force: np.ndarray) -> np.ndarray:
    """What `scipy.signal.dlsim` returns (N, outputs), in a tenth of the time: mode by mode."""
    a, b, c, d, _ = system
    poles, modes = np.linalg.eig(a)
    driven = np.linalg.solve(modes, b[:, 0])
    states = [scipy.signal.lfilter([0.0, g], [1.0, -p], force) for p, g in zip(poles, driven, strict=True)]
    return (np.array(states).T @ (c @ modes).T).real + np.outer(force, d[:, 0])


@cache
def reference(name: str) -> Recording:
    """A reference recording, noise-free."""
    mapping = "oracle_exp1" if name.startswith("exp1") else "oracle_exp2"
    return import_recording(Path(ORACLE) / f"{name}.npz", mapping)


def noisy(recording: Recording, description: Description, seed: int) -> Recording:
    """The recording as the description's sensors would have made it, those it has channels of."""
    sensors = [s for s in description.sensor if set(s.channels) <= set(recording.channels)]
    return add_noise(recording, sensors, np.random.default_rng(seed))


def from_twin(channels: dict[str, np.ndarray], *, name: str = "twin") -> Recording:
    """A MuJoCo twin's channels as a recording of the paper's sensors, truth beside them."""
    quaternion = channels["quat_wxyz"][:, [1, 2, 3, 0]]
    return Recording.from_arrays(
        channels["t"],
        {
            "pose.position": channels["base_pos_P"],
            "pose.velocity": channels["base_vel_P"],
            "pose.attitude": quaternion,
            "imu.acceleration": channels["acc_imu_body"],
            "imu.angular_rate": channels["omega_body"],
            "encoder.joint_position": channels["q"],
            "encoder.joint_velocity": channels["qd"],
            "tachometer.wheel_rate": channels["rw_rate"],
            "panel.acceleration": channels["panel_acc_base"],
            "command.force": channels["force_body"],
            "truth.slosh_position": channels["truth_slosh"],
            "truth.slosh_velocity": channels["truth_slosh_vel"],
            "truth.modal_position": channels["truth_panel_modal"],
            "truth.modal_velocity": channels["truth_panel_modal_vel"],
        },
        name=name,
    )


def exact_motion(states, point) -> MeasuredMotion:
    """Unrelated exact states of the twins (no accelerations: what does not need them)."""
    n, zero = len(states), np.zeros((len(states), 3))
    spin = np.array([np.cross(s.omega_b, point) for s in states])
    rotation = np.array([s.attitude for s in states])
    return MeasuredMotion(
        time=np.arange(n) / 20.0,
        position=np.array([s.position + s.attitude @ point for s in states]),
        rotation=rotation,
        velocity=np.array([s.v_b for s in states]) + spin,
        rate=np.array([s.omega_b for s in states]),
        rate_derivative=zero,
        acceleration=zero,
        angles=np.array([s.q for s in states]),
        angle_rates=np.array([s.qd for s in states]),
        wheel_rates=np.array([s.wheel_rate for s in states]),
        panels={},
        stations={},
        pose_point=np.asarray(point),
        imu_point=np.asarray(point),
    )
