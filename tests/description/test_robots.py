"""Robots of example-robot-data on a bus: named, mounted, simulated in free floating."""

from __future__ import annotations

import importlib.util
import xml.etree.ElementTree as ElementTree
from importlib import metadata
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from smsid.description import Arm, Description, Mount, robots
from smsid.description.robots import robot_files, robot_urdf
from smsid.effects import JointFriction
from smsid.errors import DescriptionError, MissingDependencyError
from smsid.model import build_model
from smsid.simulate import Inputs, simulate

ROOT = Path(__file__).resolve().parents[2]
spec = importlib.util.spec_from_file_location("mount_any_arm", ROOT / "examples" / "02_mount_any_arm.py")
assert spec is not None and spec.loader is not None
example = importlib.util.module_from_spec(spec)
spec.loader.exec_module(example)

try:
    robots.robots_folder()
    installed = True
except MissingDependencyError:
    installed = False
needs_robots = pytest.mark.skipif(not installed, reason="example-robot-data is not installed")


def bus_with(robot: str, frame: str | None = "left_base", **arm) -> Description:
    pose = {"xyz": (0.1, -0.2, 0.3), "rpy": (0.2, -0.4, 0.7)}
    mounted = Arm(name="arm", robot=robot, mount=Mount(frame=frame, **pose), **arm)
    return Description(name=robot, urdf="bus.urdf", folder=ROOT / "urdf", arm=(mounted,))


SLOW = ("tiago_pro", "talos_full_v2", "talos_reduced")  # many joints, of kinds that the others have, too


@needs_robots
@pytest.mark.parametrize(
    "robot", [pytest.param(r, marks=[pytest.mark.slow] if r in SLOW else []) for r in example.ROBOTS]
)
def test_momentum_and_energy_close_in_free_floating(robot):
    model = example.mount(robot)
    torque = example.random_torques(model, np.random.default_rng(1))
    trajectory = simulate(model, Inputs(joint_torque=torque), 1.0)
    audit = trajectory.audit()
    assert audit.energy_scale > 0.0
    assert audit.momentum_drift < 1e-9 * audit.momentum_scale
    # what dry friction takes is summed over implicit steps, and holds joints where torques are small
    dry = [isinstance(e, JointFriction) and e.coulomb > 0.0 for e in model.description.effect]
    assert audit.energy_drift < (1e-6 if any(dry) else 1e-9) * audit.energy_scale
    states = trajectory.states(np.linspace(0.0, 1.0, 31))
    moved = np.ptp(model.joint_angles(states.q), axis=0)
    held = {e.joint for e in model.description.effect if isinstance(e, JointFriction)}
    f = model.followers
    for pair in zip(f.names, f.leaders, strict=True) if f is not None else ():
        held |= set(pair)  # one friction holds all that move together
    free = [n not in held for n in model.arm_joints.names]
    assert moved[free].min(initial=np.inf) > 1e-3 and moved.min() > 0.0


@needs_robots
@pytest.mark.parametrize("robot", ["ur5", "kinova", "tiago_pro", "talos_reduced"])
def test_mass_is_that_of_the_bus_and_of_every_link_of_the_file(robot):
    path, _ = robot_urdf(robot)
    masses = [
        float(m.get("value", "nan")) for m in ElementTree.parse(path).getroot().iterfind(".//inertial/mass")
    ]
    assert build_model(bus_with(robot)).mass == pytest.approx(2000.0 + sum(masses), rel=1e-12)


@needs_robots
@pytest.mark.parametrize("robot", ["ur5", "double_pendulum_continuous", "talos_left_arm"])
@pytest.mark.parametrize("frame", ["right_base", None])
def test_mounted_frames_are_where_bus_mount_and_robot_put_them(robot, frame):
    model = build_model(bus_with(robot, frame))
    path, _ = robot_urdf(robot)
    alone = pin.buildModelFromXML(path.read_text())
    bus = pin.SE3(np.eye(3), np.array([-1.0, -1.0, 1.0]) if frame else np.zeros(3))
    mount = bus * pin.SE3(pin.rpy.rpyToMatrix(0.2, -0.4, 0.7), np.array([0.1, -0.2, 0.3]))
    rng = np.random.default_rng(3)
    angles = rng.uniform(-1.0, 1.0, len(model.arm_joints))
    q = model.set_joint_angles(model.home, angles)
    data, own = model.pin.createData(), alone.createData()
    pin.framesForwardKinematics(model.pin, data, q)
    pin.framesForwardKinematics(alone, own, q[7:])
    np.testing.assert_allclose(model.joint_angles(q), angles, atol=1e-14)
    for k, link in enumerate(alone.frames):
        if link.type != pin.FrameType.BODY or link.name == "universe":
            continue
        found = data.oMf[model.pin.getFrameId(f"arm/{link.name}", pin.BODY)]
        np.testing.assert_allclose(found.homogeneous, (mount * own.oMf[k]).homogeneous, atol=1e-12)


@needs_robots
def test_a_robot_welded_to_the_ground_bus_moves_as_on_its_own():
    description = bus_with("ur5").model_copy(update={"root": "fixed"})
    model = build_model(description)
    alone = pin.buildModelFromXML(robot_urdf("ur5")[0].read_text())
    rng = np.random.default_rng(0)
    q, v, tau = (rng.standard_normal(6) for _ in range(3))
    mass = pin.crba(alone, alone.createData(), q)
    np.testing.assert_allclose(pin.crba(model.pin, model.data, q), mass, atol=1e-12)
    np.testing.assert_allclose(
        model.pin.gravity.linear, 0.0, atol=0.0
    )  # the arm's model came with gravity, the spacecraft has none
    alone.gravity = pin.Motion.Zero()
    expected = pin.aba(alone, alone.createData(), q, v, tau)
    np.testing.assert_allclose(model.acceleration(0.0, q, v, tau), expected, rtol=1e-9, atol=1e-9)


@needs_robots
def test_home_takes_names_without_prefix_and_continuous_joints():
    home = {"j2s6s200_joint_1": 0.5, "j2s6s200_joint_2": 2.9}
    model = build_model(bus_with("kinova", home=home))
    assert model.nq - 1 > model.nv  # continuous joints are stored as (cos, sin)
    named = dict(zip(model.arm_joints.names, model.joint_angles(model.home), strict=True))
    assert named["arm/j2s6s200_joint_1"] == pytest.approx(0.5, abs=1e-14)
    assert named["arm/j2s6s200_joint_2"] == pytest.approx(2.9, abs=1e-14)


@needs_robots
def test_impossible_inertias_are_refused_with_the_way_out_and_taken_when_trusted():
    with pytest.raises(DescriptionError) as caught:
        build_model(bus_with("tiago_no_hand"))
    text = str(caught.value)
    assert "base_antenna_left_link" in text and "[[arm]] 'arm'" in text
    assert 'inertias = "trusted"' in text
    assert build_model(bus_with("tiago_no_hand", inertias="trusted")).mass > 2060.0


@needs_robots
def test_a_joint_that_moves_no_mass_is_named():
    with pytest.raises(DescriptionError, match=r"'arm/.*' takes no inertia"):
        build_model(bus_with("icub"))


@needs_robots
@pytest.mark.parametrize("visuals", [False, True])
def test_fixed_joints_are_welded_at_home(visuals):
    home = {"panda_joint2": -0.5, "panda_joint4": -1.5, "panda_finger_joint1": 0.03}
    fixed = ("panda_finger_joint1", "panda_finger_joint2", "panda_joint4")
    whole = build_model(bus_with("panda", home=home))
    model = build_model(bus_with("panda", home=home, fixed=fixed), visuals=visuals)
    assert len(model.arm_joints) == len(whole.arm_joints) - 3
    assert not set(model.arm_joints.names) & {f"arm/{n}" for n in fixed}
    assert model.mass == pytest.approx(whole.mass, rel=1e-12)
    full = np.triu(pin.crba(whole.pin, whole.data, whole.home))
    kept = [*range(6), *(whole.pin.joints[whole.pin.getJointId(n)].idx_v for n in model.arm_joints.names)]
    mass = np.triu(pin.crba(model.pin, model.data, model.home))
    np.testing.assert_allclose(mass, full[np.ix_(kept, kept)], atol=1e-9)
    for one, q in ((model, model.home), (whole, whole.home)):
        pin.framesForwardKinematics(one.pin, one.data, q)
    ends = [m.data.oMf[m.pin.getFrameId("arm/panda_leftfinger", pin.BODY)] for m in (model, whole)]
    np.testing.assert_allclose(ends[0].homogeneous, ends[1].homogeneous, atol=1e-12)


@needs_robots
def test_icub_moves_once_a_joint_of_its_neck_is_fixed():
    """Its head is a point mass: of three axes through the neck, two can move it."""
    model = build_model(bus_with("icub", fixed=("neck_yaw",)))
    audit = simulate(model, Inputs(joint_torque=example.random_torques(model, np.random.default_rng(0))), 1.0)
    drift = audit.audit()
    assert drift.momentum_drift < 1e-9 * drift.momentum_scale


@needs_robots
def test_the_second_finger_follows_the_first():
    model = build_model(bus_with("panda", home={"panda_finger_joint1": 0.03}))
    assert model.joint_angles(model.home)[-2:] == pytest.approx([0.03, 0.03])


@needs_robots
def test_an_unknown_robot_is_answered_with_the_nearest():
    with pytest.raises(DescriptionError, match=r"no robot 'pnada'.*names: panda(, \S+){4}\.$"):
        build_model(bus_with("pnada"))


@needs_robots
def test_visuals_of_bus_and_robot_come_along():
    model = build_model(bus_with("ur5"), visuals=True)
    assert model.visual is not None
    names = [g.name for g in model.visual.geometryObjects]
    assert any(n.startswith("arm/") for n in names) and any(n.startswith("bus") for n in names)


def test_names_from_files(tmp_path):
    for name in ("ur_description/urdf/ur3.urdf", "ur_description/urdf/ur3_robot.urdf",
                 "a_b_description/urdf/any.urdf", "a_c_description/urdf/any.urdf",
                 "xarm_description/urdf/xarm7.urdf"):  # fmt: skip
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    found = {name: path.relative_to(tmp_path).as_posix() for name, path in robot_files(tmp_path).items()}
    assert found == {
        "ur3": "ur_description/urdf/ur3_robot.urdf",
        "ur/ur3": "ur_description/urdf/ur3.urdf",
        "a_b/any": "a_b_description/urdf/any.urdf",
        "a_c/any": "a_c_description/urdf/any.urdf",
        "a_b": "a_b_description/urdf/any.urdf",
        "a_c": "a_c_description/urdf/any.urdf",
        "xarm7": "xarm_description/urdf/xarm7.urdf",
        "xarm": "xarm_description/urdf/xarm7.urdf",
    }


def test_without_example_robot_data_the_pip_line_is_told(monkeypatch, tmp_path):
    def missing(name: str) -> None:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(robots.metadata, "distribution", missing)
    monkeypatch.setattr(robots, "FOLDER", Path(tmp_path.name) / "nowhere")
    with pytest.raises(MissingDependencyError, match=r"pip install 'smsid\[robots\]'"):
        build_model(bus_with("ur5"))


@needs_robots
def test_the_example_prints_its_table(capsys, tmp_path):
    example.main(tmp_path, ("ur3", "talos_left_arm"))
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split()[0] == "robot"
    assert [line.split()[0] for line in lines[1:]] == ["ur3", "talos_left_arm"]
