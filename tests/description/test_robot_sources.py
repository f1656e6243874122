"""Robots from xacro, SDF and MJCF, against the same machine built by hand in Pinocchio and MuJoCo."""

from __future__ import annotations

import json
import logging
import sys

import numpy as np
import pinocchio as pin
import pytest

from smsid._xacro_arguments import xacro_arguments
from smsid.description import Description, load_description
from smsid.errors import DescriptionError, MissingDependencyError
from smsid.model import build_model

XACRO = """<robot name="x" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:arg name="mass" default="2.0"/>
<xacro:macro name="body" params="name m">
  <link name="${name}"><inertial><origin xyz="0.1 0 0"/><mass value="${m}"/>
  <inertia ixx="0.1" iyy="0.2" izz="0.2" ixy="0" ixz="0" iyz="0"/></inertial></link>
</xacro:macro>
<xacro:body name="bus" m="20"/><xacro:body name="l1" m="$(arg mass)"/>
<joint name="j1" type="continuous"><parent link="bus"/><child link="l1"/><axis xyz="0 0 1"/></joint>
</robot>"""

SDF = """<sdf version="1.9"><model name="m">
<link name="bus"><inertial><mass>20</mass>
  <inertia><ixx>3</ixx><iyy>4</iyy><izz>5</izz></inertia></inertial></link>
<link name="l1"><pose>0.5 0 0 0 0 1.5707963267948966</pose>
  <inertial><pose>0 0.2 0 0 0 0.3</pose><mass>2</mass>
  <inertia><ixx>0.1</ixx><iyy>0.2</iyy><izz>0.25</izz><ixy>0.01</ixy></inertia></inertial>
  <visual name="v"/></link>
<joint name="j1" type="revolute"><parent>bus</parent><child>l1</child><pose>0 -0.1 0 0 0 0</pose>
  <axis><xyz expressed_in="__model__">0 1 0</xyz><limit><lower>-1</lower><upper>2</upper></limit>
  <dynamics><damping>0.3</damping></dynamics></axis></joint>
</model></sdf>"""

MJCF = """<mujoco><worldbody><body name="bus" pos="0 0 1"><freejoint/>
<inertial pos="0 0 0" mass="20" fullinertia="3 4 5 0.1 0 0"/>
<body name="l1" pos="0.5 0 0" euler="0 0 90">
  <joint name="j1" type="hinge" axis="0 1 0" pos="0.05 0 0" damping="0.2" armature="0.01"/>
  <joint name="j2" type="slide" axis="0 0 1" range="-0.2 0.3" limited="true"/>
  <inertial pos="0.1 0 0" mass="2" fullinertia="0.1 0.2 0.25 0.01 0 0"/>
  <body name="l2" pos="0.3 0 0"><joint name="j3" axis="1 0 0"/>
    <inertial pos="0 0.1 0" mass="1" diaginertia="0.02 0.03 0.04"/></body>
</body></body></worldbody></mujoco>"""


def written(path, text):
    path.write_text(text)
    return path


def test_a_xacro_takes_its_arguments(tmp_path):
    file = written(tmp_path / "arm.urdf.xacro", XACRO)
    assert build_model(load_description(file)).mass == pytest.approx(22.0)
    with xacro_arguments({"mass": "7.5"}):
        d = load_description(file)
    assert d.arguments == {"mass": "7.5"}  # what is saved says how it was expanded
    assert build_model(d).mass == pytest.approx(27.5)


def test_a_xacro_is_expanded_once_and_again_when_what_it_includes_changes(tmp_path, monkeypatch):
    xacro = pytest.importorskip("xacro", reason="needs the extra xacro")
    one = '<robot xmlns:xacro="http://x"><xacro:property name="m" value="{}"/></robot>'
    written(tmp_path / "mass.xacro", one.format(3))
    included = '<xacro:include filename="mass.xacro"/><xacro:body name="bus" m="${m}"/>'
    text = XACRO.replace('<xacro:body name="bus" m="20"/>', included)
    file, runs = written(tmp_path / "arm.urdf.xacro", text), []
    expand = xacro.process_file
    monkeypatch.setattr(xacro, "process_file", lambda *a, **k: (runs.append(a), expand(*a, **k))[1])
    model = build_model(load_description(file))
    assert model.mass == pytest.approx(5.0) and len(runs) == 1
    build_model(load_description(file))
    assert len(runs) == 1
    written(tmp_path / "mass.xacro", one.format(44))
    assert build_model(load_description(file)).mass == pytest.approx(46.0) and len(runs) == 2


def test_an_argument_that_nothing_takes_is_refused(tmp_path):
    file = written(tmp_path / "arm.xacro", XACRO)
    with xacro_arguments({"mas": "7.5"}), pytest.raises(DescriptionError, match=r"no argument 'mas'.*mass"):
        build_model(load_description(file))
    plain = tmp_path / "arm.urdf"
    plain.write_text("<robot name='x'><link name='l'/></robot>")
    with xacro_arguments({"mass": "1"}), pytest.raises(DescriptionError, match="no xacro"):
        load_description(plain)


def test_a_xacro_without_the_extra_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "xacrodoc", None)
    with pytest.raises(MissingDependencyError, match=r"smsid\[xacro\]"):
        build_model(load_description(written(tmp_path / "arm.xacro", XACRO)))


def test_an_sdf_is_the_machine_its_poses_say(tmp_path, caplog):
    model = build_model(load_description(written(tmp_path / "m.sdf", SDF)))
    assert "1 visuals" in caplog.text
    by_hand = pin.Model()
    base = by_hand.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
    by_hand.appendBodyToJoint(
        base, pin.Inertia(20.0, np.zeros(3), np.diag([3.0, 4.0, 5.0])), pin.SE3.Identity()
    )
    turn = pin.utils.rotate("z", np.pi / 2)
    # joint frame: 0.1 along -y of the link, which is x of the model; axis y of the model is x of the joint
    at = pin.SE3(turn, np.array([0.6, 0.0, 0.0]))
    joint = by_hand.addJoint(base, pin.JointModelRX(), at, "j1")
    about = np.array([[0.1, 0.01, 0.0], [0.01, 0.2, 0.0], [0.0, 0.0, 0.25]])
    place = pin.SE3(pin.utils.rotate("z", 0.3), np.array([0.0, 0.3, 0.0]))
    by_hand.appendBodyToJoint(joint, pin.Inertia(2.0, np.zeros(3), about), place)
    by_hand.gravity.setZero()
    q, v = pin.neutral(by_hand), np.arange(1.0, 8.0) / 7.0
    q[7] = 0.4
    wanted = pin.rnea(by_hand, by_hand.createData(), q, v, np.ones(7))
    found = pin.rnea(model.pin, model.pin.createData(), q, v, np.ones(7))
    assert found == pytest.approx(wanted, abs=1e-12)
    assert model.pin.upperPositionLimit[7] == 2.0
    assert [e.viscous for e in model.description.effect] == [0.3]


def test_an_mjcf_moves_as_in_mujoco_and_what_is_lost_is_named(tmp_path, caplog):
    mujoco = pytest.importorskip("mujoco")
    file = written(tmp_path / "m.xml", MJCF.replace(' armature="0.01"', "").replace(' damping="0.2"', ""))
    model = build_model(load_description(file))
    m = mujoco.MjModel.from_xml_path(str(file))
    m.opt.gravity[:] = 0.0
    m.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data = mujoco.MjData(m)
    data.qpos[7:] = angles = [0.3, 0.1, -0.5]
    data.qvel[6:] = rates = np.array([0.4, -0.2, 0.7])
    mujoco.mj_forward(m, data)
    q, v = pin.neutral(model.pin), np.zeros(9)
    q[7], q[9 if model.pin.joints[2].nq == 2 else 8] = angles[0], angles[1]
    order = [model.pin.getJointId(n) for n in ("j1", "j2", "j3")]
    for j, angle, rate in zip(order, angles, rates, strict=True):
        k = model.pin.joints[j].idx_q
        wide = model.pin.joints[j].nq == 2
        q[k : k + 1 + wide] = [np.cos(angle), np.sin(angle)] if wide else [angle]
        v[model.pin.joints[j].idx_v] = rate
    model.pin.gravity.setZero()
    found = pin.aba(model.pin, model.pin.createData(), q, v, np.zeros(9))
    assert found[6:] == pytest.approx(data.qacc[6:], rel=1e-9)
    written(file, MJCF)
    with caplog.at_level(logging.WARNING):
        again = build_model(load_description(file))
    assert "armature of j1" in caplog.text
    assert [(e.joint, e.viscous) for e in again.description.effect] == [("j1", 0.2)]


def test_what_no_urdf_has_is_refused_by_name(tmp_path):
    pytest.importorskip("mujoco")
    ball = MJCF.replace('<joint name="j3" axis="1 0 0"/>', '<joint name="j3" type="ball"/>')
    with pytest.raises(DescriptionError, match=r"'j3'.*ball"):
        build_model(load_description(written(tmp_path / "b.xml", ball)))
    with pytest.raises(DescriptionError, match=r"'j1'.*universal"):
        build_model(load_description(written(tmp_path / "u.sdf", SDF.replace("revolute", "universal"))))


LINK = """<link name="{}"><inertial><mass value="{}"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>"""


def test_a_world_link_with_a_floating_root_is_no_body(tmp_path):
    text = f'<robot name="r"><link name="world"/>{LINK.format("bus", 10)}{LINK.format("l", 1)}'
    text += JOINT.format("float", "floating", "world", "bus") + JOINT.format("j", "revolute", "bus", "l")
    model = build_model(load_description(written(tmp_path / "r.urdf", f"{text}</robot>")))
    assert model.nv == 7 and model.mass == pytest.approx(11.0)
    assert model.pin.inertias[1].mass == pytest.approx(10.0)


def test_joints_beyond_which_are_only_frames_are_welded_unless_they_are_named(tmp_path, caplog):
    text = (
        f'<robot name="r">{LINK.format("bus", 10)}{LINK.format("l", 1)}<link name="w"/><link name="lidar"/>'
    )
    text += JOINT.format("j", "revolute", "bus", "l") + JOINT.format("spin", "continuous", "l", "lidar")
    text += JOINT.format("wheel", "continuous", "bus", "w")
    written(tmp_path / "r.urdf", f"{text}</robot>")
    wheel = {"name": "w1", "joint": "wheel", "inertia": 0.01}
    model = build_model(Description(name="r", urdf="r.urdf", folder=tmp_path, wheel=[wheel]))
    assert sorted(model.pin.names[2:]) == ["j", "wheel"]
    assert "joints spin" in caplog.text and "wheel," not in caplog.text
    with pytest.raises(DescriptionError, match="spin"):  # asked for by name, it has to be able to move
        arm = {"name": "a", "joints": ["j", "spin"]}
        build_model(Description(name="r", urdf="r.urdf", folder=tmp_path, wheel=[wheel], arm=[arm]))


def test_arguments_stand_on_the_command_line(tmp_path, monkeypatch, capsys):
    from smsid.cli import main

    file = written(tmp_path / "arm.urdf.xacro", XACRO)
    monkeypatch.setattr(sys, "argv", ["smsid", "show", str(file), "mass:=7", "--json"])
    main()
    assert json.loads(capsys.readouterr().out)["description"]["mass"]["value"] == pytest.approx(27.0)
