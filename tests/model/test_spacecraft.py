"""Masses, inertias, wheels and joints of the assembled model, against numbers by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smsid.description import Arm, Description, Wheel, load_description
from smsid.effects import Slosh
from smsid.effects.inertial_parameters import move_parameters, pseudo_inertia
from smsid.model import build_model
from smsid.model.spacecraft import JointGroup, group_angles, set_group_angles

URDF = Path(__file__).resolve().parents[2] / "urdf"
PAPER = build_model(load_description(URDF / "paper_sms.toml"))
vectors = st.tuples(*[st.floats(-2.0, 2.0)] * 3)
axes = vectors.filter(lambda a: np.linalg.norm(a) > 1e-3)


def mass_matrix(model, q):
    upper = np.triu(pin.crba(model.pin, model.data, q))
    return upper + np.triu(upper, 1).T


def about_origin(mass, cm, moments):
    """Inertia about the bus origin of a body with its CM at cm and axes along the bus's."""
    cm = np.asarray(cm, dtype=float)
    return np.diag(moments) + mass * (cm @ cm * np.eye(3) - np.outer(cm, cm))


def plate(mass, length, width, thickness):
    squares = np.array([length, width, thickness]) ** 2
    return mass / 12.0 * (squares.sum() - squares)


def test_mass_of_the_papers_spacecraft():
    """Table 2: 2000 + 10 + 50 + 50 + 97.2 + 49.6."""
    assert PAPER.mass == pytest.approx(2256.8, rel=1e-12)


def test_inertia_of_the_papers_spacecraft_with_everything_locked():
    q = PAPER.set_joint_angles(PAPER.home, np.zeros(3))
    expected = (
        1500.0 * np.eye(3)  # the spin inertia of the wheels is part of it
        + about_origin(10.0, (-1.0, -1.0, 1.25), (0.21, 0.21, 0.01))
        + about_origin(50.0, (0.0, -1.0, 1.5), (0.05, 16.69, 16.69))
        + about_origin(50.0, (2.0, -1.0, 1.5), (0.05, 16.69, 16.69))
        + about_origin(97.2, (4.5, 0.0, 0.0), plate(97.2, 6.0, 3.0, 0.002))
        + about_origin(49.6, (0.03, -0.04, 0.05), (0.0, 0.0, 0.0))
    )
    np.testing.assert_allclose(mass_matrix(PAPER, q)[3:6, 3:6], expected, rtol=1e-12, atol=1e-9)


def test_centre_of_mass_of_the_papers_spacecraft():
    q = PAPER.set_joint_angles(PAPER.home, np.zeros(3))
    first = (
        10.0 * np.array([-1.0, -1.0, 1.25])
        + 50.0 * np.array([0.0, -1.0, 1.5])
        + 50.0 * np.array([2.0, -1.0, 1.5])
        + 97.2 * np.array([4.5, 0.0, 0.0])
        + 49.6 * np.array([0.03, -0.04, 0.05])
    )
    found = pin.centerOfMass(PAPER.pin, PAPER.data, q)
    np.testing.assert_allclose(found, first / 2256.8, atol=1e-14)


def test_joints_of_the_papers_spacecraft():
    assert PAPER.arm_joints.names == ("joint1", "joint2", "joint3")
    assert PAPER.wheels.names == ("wheel_x", "wheel_y", "wheel_z")
    assert PAPER.modes.names == ("panel.mode1", "panel.mode2", "panel.mode3")
    assert [s.name for s in PAPER.slosh] == ["tank"]
    taken = [*range(6), *PAPER.arm_joints.v, *PAPER.wheels.v, *PAPER.modes.v, *range(12, 15)]
    assert sorted(taken) == list(range(PAPER.nv))
    assert PAPER.slosh[0].v == slice(12, 15)
    np.testing.assert_allclose(PAPER.joint_angles(PAPER.home), [0.4, -0.6, 0.9])


@settings(max_examples=40, deadline=None)
@given(
    layout=st.lists(st.tuples(axes, vectors, st.floats(0.01, 2.0)), min_size=1, max_size=5),
    inside=st.booleans(),
)
def test_wheels_in_any_layout(layout, inside):
    """Spinning wheels carry sum I a w; locked, the bus keeps its inertia or gains what is not inside it."""
    wheels = tuple(
        Wheel(name=f"w{i}", axis=axis, position=position, inertia=inertia, inertia_in_bus=inside)
        for i, (axis, position, inertia) in enumerate(layout)
    )
    model = build_model(Description(name="x", urdf="bus.urdf", folder=URDF, wheel=wheels))
    unit = np.array([np.array(a) / np.linalg.norm(a) for a, _, _ in layout])
    inertia = np.array([i for _, _, i in layout])
    mass = mass_matrix(model, model.home)
    spin = np.einsum("w,wi,wj->ij", inertia, unit, unit)
    expected = 1500.0 * np.eye(3) + (0.0 if inside else 1.0) * spin
    np.testing.assert_allclose(mass[3:6, 3:6], expected, atol=1e-9)
    np.testing.assert_allclose(mass[:3, :3], 2000.0 * np.eye(3), atol=1e-9)
    np.testing.assert_allclose(mass[3:6, 6:], (unit * inertia[:, None]).T, atol=1e-12)
    np.testing.assert_allclose(mass[6:, 6:], np.diag(inertia), atol=1e-12)
    rates = np.linspace(-300.0, 400.0, len(layout))
    v = np.concatenate([np.zeros(6), rates])
    np.testing.assert_allclose(
        model.momentum(model.home, v)[3:], (inertia * rates) @ unit, rtol=1e-9, atol=1e-9
    )
    np.testing.assert_allclose(model.momentum(model.home, v)[:3], 0.0, atol=1e-12)


def test_a_joint_of_the_urdf_can_be_the_wheel():
    description = Description(
        name="x",
        urdf="paper_sms.urdf",
        folder=URDF,
        wheel=(Wheel(name="w", joint="joint1"),),
    )
    model = build_model(description)
    assert model.wheels.names == ("joint1",)
    assert model.arm_joints.names == ("joint2", "joint3")


def test_an_arm_may_name_some_joints_and_the_rest_swings():
    arm = Arm(name="arm", joints=("joint3", "joint1"))
    model = build_model(Description(name="x", urdf="paper_sms.urdf", folder=URDF, arm=(arm,)))
    assert model.arm_joints.names == ("joint3", "joint1")
    np.testing.assert_array_equal(model.arm_joints.v, [8, 6])
    assert model.nv == 9


def test_two_arms_are_kept_apart():
    model = build_model(load_description(URDF / "two_arm_sms.toml"))
    assert list(model.arms) == ["left", "right"]
    assert model.arms["right"].names == ("right/joint1", "right/joint2", "right/joint3")
    np.testing.assert_allclose(model.joint_angles(model.home), [-0.4, -0.6, 0.9, 0.4, -0.5, 1.1])
    assert model.mass == pytest.approx(2000 + 2 * 110 + 49.6 + 70.0 + 2 * 97.2)


def test_groups_read_and_write_plain_and_continuous_joints():
    model = pin.Model()
    first = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "plain")
    second = model.addJoint(first, pin.JointModelRUBZ(), pin.SE3.Identity(), "continuous")
    group = JointGroup.of(model, [second, first])
    assert len(group) == 2 and group.names == ("continuous", "plain")
    q = set_group_angles(group, pin.neutral(model), np.array([2.5, -0.3]))
    np.testing.assert_allclose(q, [-0.3, np.cos(2.5), np.sin(2.5)])
    many = np.array([q, set_group_angles(group, q, np.array([-3.0, 7.0]))])
    np.testing.assert_allclose(group_angles(model, group, many), [[2.5, -0.3], [-3.0, 7.0]])


def test_force_at_a_point_and_at_the_thrust_point():
    description = load_description(URDF / "paper_sms.toml")
    thrust = description.thrust.model_copy(update={"point": (0.0, 0.0, -1.0)})
    model = build_model(description.model_copy(update={"thrust": thrust}))
    tau = model.body_force(np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.5, 0.0]))
    np.testing.assert_allclose(tau[:6], [1.0, 0.0, 0.0, 0.0, -0.5, 0.0])
    tau = model.body_force(np.array([0.0, 1.0, 0.0]), np.zeros(3), np.array([2.0, 0.0, 0.0]))
    np.testing.assert_allclose(tau[:6], [0.0, 1.0, 0.0, 0.0, 0.0, 2.0])


def test_springs_and_energy_of_a_displaced_slosh_mass():
    q = PAPER.home.copy()
    q[PAPER.slosh[0].q] = [0.1, -0.2, 0.3]
    v = np.zeros(PAPER.nv)
    v[PAPER.slosh[0].v] = [1.0, 2.0, 3.0]
    tau = PAPER.passive_forces(0.0, q, v)[PAPER.slosh[0].v]
    np.testing.assert_allclose(tau, [-0.041 - 0.02, 0.082 - 0.04, -0.123 - 0.06])
    assert PAPER.energy(q, v) == pytest.approx(0.5 * 49.6 * 14.0 + 0.5 * 0.41 * 0.14)


def test_slosh_on_a_named_frame_moves_with_it():
    slosh = Slosh(
        name="t", frame="link3", position=(0.5, 0.0, 0.1), mass=3.0, stiffness=(1,) * 3, damping=(0,) * 3
    )
    bare = Description(name="x", urdf="paper_sms.urdf", folder=URDF)
    model, before = build_model(bare.with_effects(slosh)), build_model(bare)
    angles = np.array([0.3, -0.4, 0.5])
    q = model.set_joint_angles(model.home, angles)
    pin.framesForwardKinematics(before.pin, before.data, before.set_joint_angles(before.home, angles))
    where = before.data.oMf[before.pin.getFrameId("link3", pin.BODY)].act(np.array([0.5, 0.0, 0.1]))
    cm = (3.0 * where + before.mass * pin.centerOfMass(before.pin, before.data, q[:10])) / (3.0 + before.mass)
    np.testing.assert_allclose(pin.centerOfMass(model.pin, model.data, q), cm, atol=1e-12)


@settings(max_examples=60, deadline=None)
@given(
    mass=st.floats(0.1, 10.0),
    cm=vectors,
    moments=st.tuples(*[st.floats(0.5, 0.9)] * 3),
    rpy=vectors,
    shift=vectors,
)
def test_moving_parameters_is_what_pinocchio_does(mass, cm, moments, rpy, shift):
    body = pin.Inertia(mass, np.array(cm), np.diag(moments))
    placement = pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(shift))
    theta = body.toDynamicParameters()
    expected = placement.act(body).toDynamicParameters()
    np.testing.assert_allclose(move_parameters(placement, theta), expected, atol=1e-10)
    assert np.linalg.eigvalsh(pseudo_inertia(theta))[0] > 0.0
    np.testing.assert_allclose(
        move_parameters(placement, theta - 2 * theta), -expected, atol=1e-10
    )  # also what no body can have
