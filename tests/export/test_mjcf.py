"""The exported MuJoCo XML moves as smsid's model does."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from smsid.description import Description
from smsid.effects import JointCable, JointFriction, ModalAppendage, Mode, MotorCoupling, Servo
from smsid.errors import DescriptionError
from smsid.export import write_mjcf
from smsid.export._mjcf import counterparts
from smsid.model import build_model

from .machines import MACHINES, URDF, random_state, to_mujoco


def both(description):
    model = build_model(description)
    mj = mujoco.MjModel.from_xml_string(write_mjcf(model))
    return model, mj, mujoco.MjData(mj)


@pytest.mark.parametrize("name", MACHINES)
def test_accelerations_at_random_states_under_motors_and_thrust(name):
    model, mj, data = both(MACHINES[name]())
    rng = np.random.default_rng(3)
    worst = 0.0
    for _ in range(50):
        q, v = random_state(model, rng)
        tau = np.zeros(model.nv)
        data.qpos[:], data.qvel[:] = to_mujoco(model, mj, q, v)
        data.ctrl[:] = 0.0
        groups = (model.wheels, model.arm_joints)
        for joint, k in [pair for g in groups for pair in zip(g.names, g.v, strict=True)]:
            tau[k] = rng.uniform(-1.0, 1.0)
            data.ctrl[mj.actuator(joint).id] = tau[k]
        if model.free:
            force, torque = rng.normal(size=(2, 3))
            tau += model.body_force(force, torque)
            for axis, x in zip(("x", "y", "z", "rx", "ry", "rz"), [*force, *torque], strict=True):
                data.ctrl[mj.actuator(f"thrust.{axis}").id] = x
        mujoco.mj_forward(mj, data)
        _, expected = to_mujoco(model, mj, q, v, model.acceleration(0.0, q, v, tau))
        worst = max(worst, float(np.abs(data.qacc - expected).max() / np.abs(expected).max()))
    assert worst < 1e-9, worst


@pytest.mark.parametrize("name", ["paper_sms", "two_arm_sms"])
def test_mass_and_home(name):
    model, mj, data = both(MACHINES[name]())
    assert mj.body_mass.sum() == pytest.approx(model.mass, rel=1e-12)
    mujoco.mj_resetDataKeyframe(mj, data, 0)
    expected, _ = to_mujoco(model, mj, model.home, np.zeros(model.nv))
    np.testing.assert_allclose(data.qpos, expected, atol=1e-12)


def arm_with(*effects):
    return Description(name="arm", urdf="arm3.urdf", root="fixed", folder=URDF, effect=effects)


def test_a_coupled_motor_is_a_tendon():
    model, mj, data = both(
        arm_with(MotorCoupling(name="wrist", joints=("joint2", "joint3"), inertia=3.0, viscous=2.0))
    )
    rng = np.random.default_rng(0)
    for _ in range(10):
        q, v = random_state(model, rng)
        data.qpos[:], data.qvel[:] = to_mujoco(model, mj, q, v)
        mujoco.mj_forward(mj, data)
        _, expected = to_mujoco(model, mj, q, v, model.acceleration(0.0, q, v, np.zeros(model.nv)))
        np.testing.assert_allclose(data.qacc, expected, rtol=1e-9)


@pytest.mark.parametrize("command", [0.4, 9.0])
def test_a_cable_is_a_spring_with_an_angle_of_rest_and_a_servo_a_position_actuator(command):
    """A servo gives at most its limit, here of 5 N m."""
    servo = Servo(name="servo", joint="joint2", stiffness=40.0, damping=3.0, limit=5.0)
    cable = JointCable(name="hose", joint="joint3", stiffness=700.0, rest=0.2)
    model, mj, data = both(arm_with(servo, cable))
    q, v = random_state(model, np.random.default_rng(1))
    data.qpos[:], data.qvel[:] = to_mujoco(model, mj, q, v)
    at = float(model.joint_angles(q)[1])
    data.ctrl[:], data.ctrl[mj.actuator("joint2").id] = 0.0, at + command
    mujoco.mj_forward(mj, data)
    tau = np.array([0.0, min(40.0 * command - 3.0 * v[1], 5.0), 0.0])
    _, expected = to_mujoco(model, mj, q, v, model.acceleration(0.0, q, v, tau))
    np.testing.assert_allclose(data.qacc, expected, rtol=1e-9)


def test_coulomb_friction_is_dry_friction_at_speed():
    model, mj, data = both(arm_with(JointFriction(name="rub", joint="joint3", coulomb=1.5)))
    q, v = model.home, np.array([0.0, 0.0, 2.0])
    data.qpos[:], data.qvel[:] = to_mujoco(model, mj, q, v)
    mujoco.mj_forward(mj, data)
    _, expected = to_mujoco(model, mj, q, v, model.acceleration(0.0, q, v, np.zeros(3)))
    np.testing.assert_allclose(data.qacc, expected, rtol=1e-6)


def test_friction_of_another_law_becomes_the_closest_with_a_note():
    """Least squares over all rates of the joint: by hand for a term that is flat, and for a falling one."""
    high = JointFriction(name="rub", joint="joint3", coulomb=1.5, stribeck=0.5, stribeck_rate=1e3)
    model = build_model(arm_with(high))
    own = counterparts(model)["rub"]
    assert own.dry == pytest.approx(2.0, rel=1e-3) and abs(own.damping) < 1e-3
    text = write_mjcf(model)
    assert own.note in text and "'rub' has stribeck" in own.note
    square = JointFriction(name="rub", joint="joint3", coulomb=1.5, quadratic=0.6, viscous=0.2)
    top = float(model.pin.velocityLimit[2])
    top = top if np.isfinite(top) and 0.0 < top < 1e3 else 1.0
    near = counterparts(build_model(arm_with(square)))["rub"]
    # x^2 on (0, 1) is closest to x - 1/6
    assert near.damping == pytest.approx(0.6 * top, rel=2e-2)
    assert near.dry == pytest.approx(1.5 - 0.1 * top**2 if 0.1 * top**2 < 1.5 else 0.0, abs=0.02 * top**2)
    spec = mujoco.MjModel.from_xml_string(write_mjcf(build_model(arm_with(square))))
    assert spec.dof_damping[2] == pytest.approx(0.2 + near.damping)


def test_friction_by_load_is_left_out_with_a_note_and_friction_that_begins_is_refused():
    loaded = JointFriction(name="rub", joint="joint3", coulomb=1.5, load=0.1)
    own = counterparts(build_model(arm_with(loaded)))["rub"]
    assert own.dry == pytest.approx(1.5) and "without its part by load" in own.note
    late = JointFriction(name="rub", joint="joint3", coulomb=1.5, start=3.0)
    with pytest.raises(DescriptionError, match=r"'rub'.*start.*--no-mujoco"):
        write_mjcf(build_model(arm_with(late)))


def test_a_mode_that_twists_and_bends_is_refused_by_name():
    mode = Mode(frequency=1.0, damping=0.01, translation=(0.0, 0.0, 1.0), rotation=(0.0, -1.0, 0.3))
    panel = ModalAppendage(
        name="skew", position=(1.0, 0.0, 0.0), mass=10.0, center_of_mass=(1.0, 0.0, 0.0),
        inertia=(5.0, 0.0, 15.0, 0.0, 0.0, 18.0), mode=(mode,),
    )  # fmt: skip
    description = Description(name="sms", urdf="paper_sms.urdf", folder=URDF, effect=(panel,))
    with pytest.raises(DescriptionError, match=r"skew\.mode1.*--no-mujoco"):
        write_mjcf(build_model(description))


def test_joints_that_turn_about_a_point_stand_on_one_body(tmp_path):
    inertia = '<inertia ixx="0.3" iyy="0.4" izz="0.5" ixy="0" ixz="0" iyz="0"/>'
    link = '<link name="{}"><inertial><origin xyz="0.1 0.02 0"/><mass value="{}"/>'
    link += f"{inertia}</inertial></link>"
    joint = '<joint name="{}" type="revolute"><parent link="{}"/><child link="{}"/>'
    joint += '<origin xyz="{}" rpy="0.2 0 0.1"/><axis xyz="{}"/>'
    joint += '<limit lower="-9" upper="9" effort="1" velocity="1"/></joint>'
    text = link.format("bus", 20) + '<link name="v1"/><link name="v2"/>' + link.format("leg", 2)
    text += joint.format("yaw", "bus", "v1", "0.5 0 0.1", "0 0 1") + joint.format(
        "roll", "v1", "v2", "0 0.05 0", "1 0 0"
    )
    text += joint.format("pitch", "v2", "leg", "0 0 -0.1", "0 1 0")
    (tmp_path / "hip.urdf").write_text(f'<robot name="hip">{text}</robot>')
    model, mj, data = both(Description(name="hip", urdf="hip.urdf", folder=tmp_path))
    assert mj.nbody == 3 and [mj.joint(k).name for k in range(1, 4)] == ["yaw", "roll", "pitch"]
    rng = np.random.default_rng(1)
    for _ in range(5):
        q, v = random_state(model, rng)
        data.qpos[:], data.qvel[:] = to_mujoco(model, mj, q, v)
        mujoco.mj_forward(mj, data)
        _, expected = to_mujoco(model, mj, q, v, model.acceleration(0.0, q, v, np.zeros(model.nv)))
        assert data.qacc == pytest.approx(expected, rel=1e-9, abs=1e-9)


def _leg(tmp_path, *inertials):
    """A bus and a chain of links that turn about x, y, ...; ``inertials``: place, mass, moments of each."""
    link = (
        '<link name="l{}"><inertial><origin xyz="{}"/><mass value="{}"/><inertia ixx="{}" iyy="{}" izz="{}"'
    )
    link += ' ixy="0" ixz="0" iyz="0"/></inertial></link>'
    text = link.format(0, "0 0 0", 20, 3, 4, 5)
    for k, (at, mass, moments) in enumerate(inertials, start=1):
        text += link.format(k, at, mass, *moments)
        text += f'<joint name="j{k}" type="revolute"><parent link="l{k - 1}"/><child link="l{k}"/>'
        text += f'<origin xyz="0.1 0 -0.2" rpy="0.1 0 0.2"/><axis xyz="{k % 2} {(k + 1) % 2} 0"/>'
        text += '<limit lower="-9" upper="9" effort="1" velocity="1"/></joint>'
    (tmp_path / "leg.urdf").write_text(f'<robot name="leg">{text}</robot>')
    return Description(name="leg", urdf="leg.urdf", folder=tmp_path, inertias="trusted")


@pytest.mark.parametrize(
    "inertials",
    [
        # a leg of point masses, one of them on its axis, as iCub is published
        [("0 0 0", 0.8, (0, 0, 0)), ("0 0 -0.1", 0.5, (0, 0, 0)), ("0.05 0 -0.1", 2, (0, 0, 0)),
         ("0 0.01 -0.1", 1, (0.01, 0.01, 0.01))],
        # moments about the axis above the others' sum: what lacks acts across the axis alone
        [("0.02 0.03 -0.1", 5, (0.06, 0.03, 0.02)), ("0 0.1 -0.1", 1, (0.002, 0.006, 0.003))],
    ],
)  # fmt: skip
def test_what_a_body_lacks_and_its_joint_does_not_feel_is_lent(inertials, tmp_path):
    model, mj, data = both(_leg(tmp_path, *inertials))
    assert mj.body_mass.sum() == pytest.approx(model.mass, rel=1e-12)
    rng = np.random.default_rng(1)
    for _ in range(10):
        q, v = random_state(model, rng)
        data.qpos[:], data.qvel[:] = to_mujoco(model, mj, q, v)
        mujoco.mj_forward(mj, data)
        _, expected = to_mujoco(model, mj, q, v, model.acceleration(0.0, q, v, np.zeros(model.nv)))
        np.testing.assert_allclose(data.qacc, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_moments_that_no_body_can_have_across_its_axis_are_refused_by_name(tmp_path):
    sound, impossible = ("0 0 0", 1, (0.1, 0.1, 0.1)), ("0 0 -0.1", 1, (0.1, 0.1, 0.3))
    with pytest.raises(DescriptionError, match=r"joint 'j2'.*no rigid body can have.*--no-mujoco"):
        write_mjcf(build_model(_leg(tmp_path, sound, impossible)))
