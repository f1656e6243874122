"""An arm of position actuators in MuJoCo: commands go in, encoders come out."""

from __future__ import annotations

import mujoco
import numpy as np

from smsid.recording import Recording

URDF = """<robot name="two"><link name="base"/>
<link name="l1"><inertial><origin xyz="0.25 0 0"/><mass value="1.2"/>
<inertia ixx="0.002" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j1" type="revolute"><parent link="base"/><child link="l1"/><axis xyz="0 1 0"/>
<limit lower="-9" upper="9" effort="50" velocity="9"/></joint>
<link name="l2"><inertial><origin xyz="0.2 0 0"/><mass value="0.6"/>
<inertia ixx="0.001" iyy="0.008" izz="0.008" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j2" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0.5 0 0"/>
<axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="50" velocity="9"/></joint></robot>"""
MJCF = """<mujoco><option gravity="0 0 -9.81" timestep="0.0005" integrator="RK4"/><worldbody>
<body><inertial pos="0.25 0 0" mass="1.2" diaginertia="0.002 0.02 0.02"/>
<joint name="j1" axis="0 1 0" damping="{b[0]}" frictionloss="{c[0]}" solreffriction="0.002 1"
solimpfriction="0.999 0.9999 0.001" armature="{r[0]}"/>
<body pos="0.5 0 0"><inertial pos="0.2 0 0" mass="0.6" diaginertia="0.001 0.008 0.008"/>
<joint name="j2" axis="0 1 0" damping="{b[1]}" frictionloss="{c[1]}" solreffriction="0.002 1"
solimpfriction="0.999 0.9999 0.001" armature="{r[1]}"/>
</body></body></worldbody>
<actuator>{actuators}</actuator></mujoco>"""
TRUTH = {
    "servo_j1.stiffness": 60.0, "servo_j2.stiffness": 25.0,
    "friction_j1.viscous": 1.5, "friction_j2.viscous": 0.6,
    "friction_j1.coulomb": 0.5, "friction_j2.coulomb": 0.2,
    "rotor_j1.inertia": 0.15, "rotor_j2.inertia": 0.05,
}  # fmt: skip
"""Viscous: the joint's and the actuator's."""


def actuators(limits=(1e3, 1e3)) -> str:
    return "".join(
        f'<position joint="j{k + 1}" kp="{TRUTH[f"servo_j{k + 1}.stiffness"]}" kv="{kv}" '
        f'forcelimited="true" forcerange="-{limits[k]} {limits[k]}"/>'
        for k, kv in enumerate((1.0, 0.4))
    )


def recorded(seed=0, seconds=20.0, noise=2e-5, limits=(1e3, 1e3), size=1.0, coulomb=(0.5, 0.2)) -> Recording:
    """Commands at 100 Hz, held, and encoders at the same instants."""
    text = MJCF.format(b=(0.5, 0.2), c=coulomb, r=(0.15, 0.05), actuators=actuators(limits))
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 0.01)
    omega = 2.0 * np.pi * 0.15 * np.arange(1, 6)
    amplitude, phase = rng.uniform(0.1, 0.35, (2, 5, 1)) * size, rng.uniform(0.0, 6.0, (2, 5, 1))
    command = np.sum(amplitude * np.sin(omega[:, None] * t + phase), axis=1).T
    command += [-1.2, 0.4]
    data.qpos[:] = command[0]
    q = np.empty_like(command)
    for k in range(len(t)):
        q[k] = data.qpos
        data.ctrl[:] = command[k]
        mujoco.mj_step(model, data, 20)
    channels = {
        "encoder.joint_position": q + noise * rng.normal(size=q.shape),
        "command.joint_position": command,
    }
    return Recording.from_arrays(t, channels, labels={"joint": ("j1", "j2")}, role="estimation", name="log")
