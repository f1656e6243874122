"""The paper's arm on the ground in MuJoCo: recordings of other people's inverse dynamics."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from smsid.description import Description
from smsid.recording import Recording

JOINTS = ("joint1", "joint2", "joint3")
RATE = 200.0
DAMPING = (30.0, 20.0, 10.0)


def described() -> Description:
    folder = Path(__file__).parents[2] / "urdf"
    # tilted gravity, so that the first joint's links show as well
    return Description(name="arm", urdf="arm3.urdf", folder=folder, root="fixed", gravity=(0.0, 3.0, -9.0))


def motion(seconds=10.0, seed=2):
    """Time, joint angles, rates and torques."""
    arm = described()
    spec = mujoco.MjSpec.from_file(str(arm.folder / arm.urdf))
    spec.option.gravity = list(arm.gravity)
    model = spec.compile()
    model.dof_damping[:] = DAMPING
    t = np.arange(0.0, seconds, 1.0 / RATE)
    rng = np.random.default_rng(seed)
    omega = 2 * np.pi * 0.25 * np.arange(1, 5)
    phase, size = rng.uniform(0, 2 * np.pi, (3, 4, 1)), rng.uniform(0.2, 0.6, (3, 4, 1))
    arg = omega[:, None] * t + phase
    q = np.sum(size * np.sin(arg), axis=1).T
    v = np.sum(size * omega[:, None] * np.cos(arg), axis=1).T
    a = -np.sum(size * omega[:, None] ** 2 * np.sin(arg), axis=1).T
    data, torque = mujoco.MjData(model), np.empty_like(q)
    for k in range(len(t)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], v[k], a[k]
        mujoco.mj_inverse(model, data)
        torque[k] = data.qfrc_inverse
    noise = np.random.default_rng(seed + 1)
    return t, q, v, torque + noise.normal(size=torque.shape)


def recorded(t, q, torque, source="encoder") -> Recording:
    channels = {f"{source}.joint_position": q, f"{source}.joint_torque": torque}
    return Recording.from_arrays(t, channels, labels={"joint": JOINTS})
