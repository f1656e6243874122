"""Arms without a TOML: from a URDF or a robot's name, with joints that are held."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from typer.testing import CliRunner

from smsid.arm.identify import identify_arm, rigid_arm
from smsid.arm.setup import arm_description, held_joints, is_of_an_arm
from smsid.cli.app import app
from smsid.errors import DescriptionError, RecordingError
from smsid.identify.estimate import load_estimate
from smsid.recording import Recording, save_recording

LINK = (
    '<inertial><origin xyz="0 0 {z}"/><mass value="{m}"/>'
    '<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>'
)
URDF = (
    '<robot name="hand"><link name="base"/>'
    f'<link name="arm">{LINK.format(z=0.3, m=3)}</link>'
    '<joint name="swing" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>'
    '<limit lower="-3" upper="3" effort="50" velocity="5"/></joint>'
    + "".join(
        f'<link name="finger{k}">{LINK.format(z=0.05, m=0.2)}</link>'
        f'<joint name="hand_{k}" type="revolute"><parent link="arm"/><child link="finger{k}"/>'
        f'<origin xyz="0 0 0.5"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="5" velocity="5"/>'
        + ('<mimic joint="hand_0"/>' if k else "")
        + "</joint>"
        for k in range(3)
    )
    + "</robot>"
)


@pytest.fixture
def urdf(tmp_path):
    (tmp_path / "hand.urdf").write_text(URDF)
    return tmp_path / "hand.urdf"


def log(rng, fingers=(0.0, 0.0, 0.0)):
    model = pin.buildModelFromXML(URDF)
    data = model.createData()
    t = np.arange(0.0, 15.0, 0.01)
    q, v = 0.9 * np.sin(1.3 * t) + 0.5 * np.sin(2.7 * t), 1.17 * np.cos(1.3 * t) + 1.35 * np.cos(2.7 * t)
    a = -1.521 * np.sin(1.3 * t) - 3.645 * np.sin(2.7 * t)
    torque = np.array(
        [
            pin.rnea(model, data, np.array([x, *fingers]), np.array([y, 0, 0, 0]), np.array([z, 0, 0, 0]))[0]
            for x, y, z in zip(q, v, a, strict=True)
        ]
    )
    torque = torque + 0.7 * v + 0.02 * rng.normal(size=t.size)
    channels = {
        "encoder.joint_position": (q + 1e-5 * rng.normal(size=t.size))[:, None],
        "drive.joint_torque": torque[:, None],
    }
    return Recording.from_arrays(t, channels, labels={"joint": ("swing",)}, role="estimation", name="log")


def test_fingers_nobody_measured_are_named_and_can_be_held(urdf, rng):
    description = arm_description(urdf)
    with pytest.raises(RecordingError, match=r"missing 'hand_0'.*--hold 'hand_\*'"):
        identify_arm(description, log(rng))
    bent = (0.5, 0.5, 0.5)
    held = held_joints(rigid_arm(description).arm_joints.names, ["hand_*=0.5"])
    found = identify_arm(description, log(rng, bent), hold=held).estimate
    for p in found.parameters:  # links beyond held joints belong to those that carry them
        assert "finger" not in p.name
    truth = rigid_arm(description, held)
    reduced = truth.pin.inertias[1].toDynamicParameters()
    assert abs(found["arm.mz"].value - reduced[3]) < 0.05


def test_what_is_held_must_exist_and_leave_something(urdf):
    names = rigid_arm(arm_description(urdf)).arm_joints.names
    with pytest.raises(DescriptionError, match="fits no joint"):
        held_joints(names, ["thumb"])
    with pytest.raises(DescriptionError, match="no position"):
        held_joints(names, ["swing=up"])
    with pytest.raises(DescriptionError, match="nothing is left"):
        rigid_arm(arm_description(urdf), held_joints(names, ["*"]))


def test_a_joint_that_follows_one_that_moves_is_not_held(urdf):
    description = arm_description(urdf)
    with pytest.raises(DescriptionError, match=r"'hand_1'.*follows 'hand_0'") as told:
        rigid_arm(description, {"hand_1": 0.0})
    assert told.value.evidence["leader"] == "hand_0"
    rigid_arm(description, {"hand_0": 0.0, "hand_1": 0.0, "hand_2": 0.0})


def test_the_command_holds_and_adds_what_joints_usually_have(urdf, tmp_path, rng):
    save_recording(log(rng), tmp_path / "log.nc")
    shown = CliRunner().invoke(
        app,
        ["identify", str(urdf), str(tmp_path / "log.nc"), "--hold", "hand_*", "-o", str(tmp_path / "e.json")],
    )
    assert shown.exit_code == 0, shown.output
    p = load_estimate(tmp_path / "e.json")["friction_swing.viscous"]
    assert abs(p.value - 0.7) < 4.0 * p.sigma < 0.2


def test_a_robot_by_its_name(tmp_path, rng):
    try:
        description = arm_description(robot="double_pendulum")
    except Exception as error:  # not installed, or another version of the robots
        pytest.skip(str(error))
    names = rigid_arm(description).arm_joints.names
    assert description.root == "fixed" and len(names) == 2
    save_recording(log(rng), tmp_path / "log.nc")
    arguments = ["identify", "--robot", "double_pendulum", str(tmp_path / "log.nc")]
    other = CliRunner().invoke(app, [*arguments, "-o", str(tmp_path / "e.json")])
    assert "do not fit the model" in str(other.exception)  # the recording was read, and is of another arm


def test_logs_of_spacecraft_are_not_taken_for_arms(rng):
    own = log(rng)
    assert is_of_an_arm([own])
    t = own.time("encoder.joint_position")
    flown = Recording.from_arrays(t, {"imu.angular_rate": np.zeros((t.size, 3))})
    assert not is_of_an_arm([own, flown]) and not is_of_an_arm([flown])


def test_an_arm_may_have_commanded_torques_alone(rng):
    own = log(rng)
    q = np.asarray(own["encoder.joint_position"])
    channels = {"encoder.joint_position": q, "command.joint_torque": q}
    arm = Recording.from_arrays(own.time("encoder.joint_position"), channels)
    assert is_of_an_arm([arm])
    for more in ("command.wheel_torque", "command.force"):
        base = Recording.from_arrays(
            own.time("encoder.joint_position"), channels | {more: np.tile(q[:, :1], 3)}
        )
        assert not is_of_an_arm([base])
    assert not is_of_an_arm([arm.without("encoder.joint_position")])
