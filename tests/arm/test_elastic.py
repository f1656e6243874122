"""Gears and links that bend, with a measured deflection: a flexible bench of two joints, flown in MuJoCo."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

from smsid.arm import identify_arm, with_joint_effects
from smsid.arm.readings import with_passive_joints
from smsid.cli.app import app
from smsid.description import Description
from smsid.errors import RecordingError
from smsid.identify.estimate import load_estimate
from smsid.recording import Recording, save_recording

BODIES = (
    ("hub1", 0.0, 0.8, 0.02),
    ("arm1", 0.2, 1.5, 0.03),
    ("hub2", 0.0, 0.4, 0.004),
    ("arm2", 0.15, 0.6, 0.008),
)
JOINTS = ("motor1", "flex1", "motor2", "flex2")
PLACES = (0.0, 0.0, 0.4, 0.0)
STIFFNESS, DAMPING = {"flex1": 60.0, "flex2": 12.0}, {"flex1": 0.15, "flex2": 0.04}
VISCOUS = {"motor1": 0.8, "motor2": 0.3}
MOTORS, FLEX = ("motor1", "motor2"), ("flex1", "flex2")
TRUTH = {
    **{f"spring_{j}.stiffness": k for j, k in STIFFNESS.items()},
    **{f"friction_{j}.viscous": c for j, c in {**DAMPING, **VISCOUS}.items()},
}


def urdf() -> str:
    text, parent = '<robot name="bench"><link name="base"/>', "base"
    for (body, x, m, i), joint, place in zip(BODIES, JOINTS, PLACES, strict=True):
        text += (
            f'<link name="{body}"><inertial><origin xyz="{x} 0 0"/><mass value="{m}"/>'
            f'<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="{joint}" type="revolute"><parent link="{parent}"/><child link="{body}"/>'
            f'<origin xyz="{place} 0 0"/><axis xyz="0 0 1"/>'
            '<limit lower="-9" upper="9" effort="50" velocity="9"/></joint>'
        )
        parent = body
    return text + "</robot>"


def mjcf() -> str:
    text = '<mujoco><option gravity="0 0 -9.81" timestep="0.001" integrator="RK4"/><worldbody>'
    for (body, x, m, i), joint, place in zip(BODIES, JOINTS, PLACES, strict=True):
        stiffness, damping = STIFFNESS.get(joint, 0.0), {**DAMPING, **VISCOUS}[joint]
        text += (
            f'<body name="{body}" pos="{place} 0 0"><inertial pos="{x} 0 0" mass="{m}" '
            f'diaginertia="{i} {i} {i}"/><joint name="{joint}" axis="0 0 1" damping="{damping}" '
            f'stiffness="{stiffness}"/>'
        )
    motors = "".join(f'<motor joint="{j}"/>' for j in MOTORS)
    return text + "</body>" * 4 + f"</worldbody><actuator>{motors}</actuator></mujoco>"


def recorded(seed=0, seconds=20.0, noise=2e-5, torque_noise=0.05) -> Recording:
    """Motors follow sines by a controller; encoders read motors and deflections, currents the torque."""
    model = mujoco.MjModel.from_xml_string(mjcf())
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    omega = 2.0 * np.pi * 0.2 * np.arange(1, 6)
    size, phase = rng.uniform(0.05, 0.25, (2, 5, 1)), rng.uniform(0.0, 6.0, (2, 5, 1))
    t = np.arange(0.0, seconds, 0.002)
    wanted = np.sum(size * np.sin(omega[:, None] * t + phase), axis=1).T
    q, torque = np.empty((t.size, 4)), np.empty((t.size, 2))
    data.qpos[[0, 2]], before = wanted[0], np.zeros(2)
    for k in range(t.size):
        pushed = np.empty((2, 2))
        q[k] = data.qpos
        for half in range(2):
            error = wanted[k] - data.qpos[[0, 2]]
            data.ctrl[:] = [60.0, 15.0] * error - [2.0, 0.5] * data.qvel[[0, 2]]
            pushed[half] = data.ctrl
            mujoco.mj_step(model, data)
        torque[k], before = 0.5 * (before + pushed[0]), pushed[1]  # mean about the sample
    channels = {
        "encoder.joint_position": q + noise * rng.normal(size=q.shape),
        "drive.joint_torque": torque + torque_noise * rng.normal(size=torque.shape),
    }
    labels = {"encoder.joint": JOINTS, "drive.joint": MOTORS}
    return Recording.from_arrays(t, channels, labels=labels, role="estimation", name="bench")


@pytest.fixture
def bench(tmp_path) -> Description:
    (tmp_path / "bench.urdf").write_text(urdf())
    bare = Description(
        name="bench", urdf="bench.urdf", folder=tmp_path, root="fixed", gravity=(0.0, 0.0, -9.81)
    )
    return with_joint_effects(with_joint_effects(bare, JOINTS, "joint_friction"), FLEX, "joint_cable")


def test_stiffness_and_damping_are_inside_their_intervals(bench):
    scores = []
    for seed in range(4):
        found = identify_arm(bench, with_passive_joints(recorded(seed), FLEX)).estimate
        scores.append([(found[n].value - x) / found[n].sigma for n, x in TRUTH.items()])
        assert all(found[f"spring_{j}.stiffness"].sigma < 0.01 * k for j, k in STIFFNESS.items())
    assert np.mean(np.abs(scores) < 1.96) > 0.8 and np.abs(scores).max() < 4.5


def test_least_squares_does_not_shrink_what_bends(bench):
    """Equations without torque hold for parameters of any size, and their noise is in their columns."""
    found = identify_arm(bench, with_passive_joints(recorded(1), FLEX)).estimate
    shares = [found[f"spring_{j}.stiffness"].value / k for j, k in STIFFNESS.items()]
    assert np.abs(np.array(shares) - 1.0).max() < 0.005


def test_the_command_takes_joints_without_motors(bench, tmp_path):
    save_recording(recorded(2), tmp_path / "log.nc")
    arguments = ["identify", str(bench.folder / "bench.urdf"), str(tmp_path / "log.nc")]
    arguments += ["-o", str(tmp_path / "e.json")]
    refused = CliRunner().invoke(app, arguments)
    assert isinstance(refused.exception, RecordingError) and "--passive" in str(refused.exception)
    shown = CliRunner().invoke(app, [*arguments, "--passive", "flex*"])
    assert shown.exit_code == 0, shown.output
    assert "no torque at flex1, flex2" in " ".join(shown.output.split())
    found = load_estimate(tmp_path / "e.json")
    stiffness = found["spring_flex1.stiffness"]
    assert stiffness.unit == "N m/rad" and stiffness.value == pytest.approx(60.0, rel=0.01)
    names = [p.name for p in found.parameters]
    assert "rotor_motor1.inertia" in names and "rotor_flex1.inertia" not in names
