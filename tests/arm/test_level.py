"""A base that is not level: gravity's direction with its interval, against Pinocchio under turned gravity."""

from __future__ import annotations

import re

import numpy as np
import pinocchio as pin
import pytest

from smsid.arm import identify_arm, with_joint_effects
from smsid.arm._residual_dependence import leftover_sentences
from smsid.description import Description
from smsid.effects import BaseTilt
from smsid.effects.external import horizontal_axes, tilted_gravity
from smsid.model import build_model
from smsid.recording import Recording

URDF = """<robot name="two"><link name="base"/>
<link name="l1"><inertial><origin xyz="0.1 0 0.2"/><mass value="5"/>
<inertia ixx="0.05" iyy="0.06" izz="0.04" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j1" type="revolute"><parent link="base"/><child link="l1"/><axis xyz="0 0 1"/>
<limit lower="-9" upper="9" effort="50" velocity="5"/></joint>
<link name="l2"><inertial><origin xyz="0.3 0 0"/><mass value="3"/>
<inertia ixx="0.01" iyy="0.08" izz="0.08" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j2" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0 0 0.4"/>
<axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="50" velocity="5"/></joint></robot>"""


@pytest.fixture
def arm(tmp_path) -> Description:
    (tmp_path / "two.urdf").write_text(URDF)
    bare = Description(name="two", urdf="two.urdf", folder=tmp_path, root="fixed", gravity=(0.0, 0.0, -9.81))
    return with_joint_effects(bare, ("j1", "j2"), "joint_friction")


def log(gravity, seed=0) -> Recording:
    model = pin.buildModelFromXML(URDF)
    model.gravity.linear = np.asarray(gravity)
    t = np.arange(0.0, 20.0, 0.01)
    draw = np.random.default_rng(seed)
    omega = 2.0 * np.pi * 0.1 * np.arange(1, 5)
    size, phase = draw.uniform(0.2, 0.5, (2, 4, 1)), draw.uniform(0.0, 6.0, (2, 4, 1))
    arg = omega[:, None] * t + phase
    q = np.sum(size * np.sin(arg), axis=1).T
    v = np.sum(size * omega[:, None] * np.cos(arg), axis=1).T
    a = -np.sum(size * omega[:, None] ** 2 * np.sin(arg), axis=1).T
    data = model.createData()
    torque = np.array([pin.rnea(model, data, *x) for x in zip(q, v, a, strict=True)])
    torque += [1.0, 0.6] * v + [1.2, 0.8] * np.tanh(v / 0.01) + 0.1 * draw.normal(size=v.shape)
    channels = {"e.joint_position": q + 1e-5 * draw.normal(size=q.shape), "d.joint_torque": torque}
    return Recording.from_arrays(t, channels, labels={"joint": ("j1", "j2")}, role="estimation")


def turned(x: float, y: float) -> np.ndarray:
    """Gravity turned about a level axis, written with Rodrigues' formula."""
    axis = np.array([y, -x, 0.0])
    angle = np.linalg.norm(axis)
    return pin.exp3(axis / angle * angle) @ np.array([0.0, 0.0, -9.81])


def test_gravity_leans_to_the_named_axes(arm):
    np.testing.assert_allclose(np.column_stack(horizontal_axes(np.array([0, 0, -9.81]))), np.eye(3)[:, :2])
    np.testing.assert_allclose(tilted_gravity(np.array([0, 0, -9.81]), 0.3, -0.2), turned(0.3, -0.2))
    model = build_model(arm.with_effects(BaseTilt(name="t", x=0.3, y=-0.2)))
    np.testing.assert_allclose(model.pin.gravity.linear, turned(0.3, -0.2))


def test_the_tilt_of_a_base_is_found_within_its_interval(arm):
    truth = np.array([0.05, -0.03])
    scores = []
    for seed in range(2):
        recording = log(turned(*truth), seed)
        found = identify_arm(arm.with_effects(BaseTilt(name="floor")), recording)
        x, y = found.estimate["floor.x"], found.estimate["floor.y"]
        assert x.unit == "rad" and 0.0 < x.sigma < 0.01
        scores += [(x.value - truth[0]) / x.sigma, (y.value - truth[1]) / y.sigma]
        assert found.description.get_effect("floor").x == x.value
        viscous = found.estimate["friction_j1.viscous"]
        assert abs(viscous.value - 1.0) < 4.0 * viscous.sigma
    assert np.sqrt(np.mean(np.square(scores))) < 2.0
    # what is left is noise, as it is not if the floor is taken to be level
    assert found.judge(log(turned(*truth), 9).with_role("validation")).rmse["j1"] < 0.11
    assert "it is noise" in leftover_sentences(found)[0]
    assert not any("--level" in s for s in leftover_sentences(found))
    level = identify_arm(arm, recording)
    assert level.judge(recording).rmse["j1"] > 2.0 * found.judge(recording).rmse["j1"]


@pytest.mark.parametrize(("degrees", "told"), [(0.0, False), (1.0, True)])
def test_a_floor_taken_for_level_that_is_not_is_told(arm, degrees, told):
    lean = np.radians(degrees) * np.array([0.6, -0.8])
    gravity = turned(*lean) if told else np.array([0.0, 0.0, -9.81])
    hints = [s for s in leftover_sentences(identify_arm(arm, log(gravity, 4))) if "--level" in s]
    assert len(hints) == told
    if told:
        about = float(re.findall(r"about ([\d.]+) degrees", hints[0])[0])
        assert degrees / 2.0 < about < 2.0 * degrees


def test_a_level_floor_is_found_level(arm):
    found = identify_arm(arm.with_effects(BaseTilt(name="floor")), log((0.0, 0.0, -9.81)))
    for axis in "xy":
        p = found.estimate[f"floor.{axis}"]
        assert abs(p.value) < 4.0 * p.sigma
