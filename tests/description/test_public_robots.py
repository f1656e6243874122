"""Robots as people publish them: each is loaded and its masses counted, or refused with what to do."""

# ruff: noqa: E501 - the tables are read by row
from __future__ import annotations

import pytest

from smsid.description import load_description
from smsid.errors import DescriptionError
from smsid.model import build_model

LINK = """<link name="{0}"><inertial><origin xyz="{3}"/><mass value="{1}"/>
<inertia ixx="{2}" iyy="{2}" izz="{2}" ixy="0" ixz="0" iyz="0"/></inertial>{4}</link>"""
JOINT = """<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/>
<axis xyz="{4}"/><limit lower="-1" upper="1" effort="1" velocity="1"/>{5}</joint>"""


def link(name, mass=1, moment=0.1, at="0.1 0 0", more=""):
    return LINK.format(name, mass, moment, at, more)


def joint(name, parent, child, kind="revolute", axis="0 0 1", more=""):
    return JOINT.format(name, kind, parent, child, axis, more)


def robot(*parts, head="", name="r"):
    return f'{head}<robot name="{name}">{"".join(parts)}</robot>'


BUS, L1 = link("bus", 20, 2), link("l1")
J1 = joint("j1", "bus", "l1")
MESH = '<visual><geometry><mesh filename="{}"/></geometry></visual>'
GAZEBO = (
    '<gazebo reference="l1"><material>Gazebo/Red</material></gazebo><transmission name="t"><type>x</type>'
)
GAZEBO += '<joint name="j1"/><actuator name="m"><mechanicalReduction>1</mechanicalReduction></actuator></transmission>'
NAMESPACE = ' xmlns:xacro="http://www.ros.org/wiki/xacro"'
XACRO = f"""<robot name="x"{NAMESPACE}><xacro:property name="m" value="${{2*0.5}}"/>
<xacro:macro name="arm" params="k"><link name="l${{k}}"><inertial><mass value="${{m}}"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link></xacro:macro>{BUS}
<xacro:arm k="1"/>{J1}</robot>"""
SDF = """<sdf version="1.7"><model name="m"><link name="bus"><inertial><mass>20</mass>
<inertia><ixx>2</ixx><iyy>2</iyy><izz>2</izz></inertia></inertial></link><link name="l1"><pose>0.5 0 0 0 0 0</pose>
<inertial><mass>1</mass><inertia><ixx>0.1</ixx><iyy>0.1</iyy><izz>0.1</izz></inertia></inertial></link>
<joint name="j1" type="revolute"><parent>bus</parent><child>l1</child><axis><xyz>0 0 1</xyz></axis></joint>
</model></sdf>"""
MJCF = """<mujoco><worldbody><body name="bus"><freejoint/><inertial pos="0 0 0" mass="20" diaginertia="2 2 2"/>
<body name="l1" pos="0.5 0 0"><joint name="j1" axis="0 0 1"/>
<inertial pos="0.1 0 0" mass="1" diaginertia="0.1 0.1 0.1"/></body></body></worldbody></mujoco>"""
FINGERS = link("l1") + link("l2") + joint("j1", "bus", "l1", "prismatic", "1 0 0")

LOADED = {
    "plain": (robot(BUS, L1, J1), ".urdf", 21.0, 1),
    "latin-1, as it declares": (robot(BUS, L1, J1, head='<?xml version="1.0" encoding="iso-8859-1"?><!--Größe-->'),
                                ".urdf", 21.0, 1),
    "a byte order mark": ("\ufeff" + robot(BUS, L1, J1), ".urdf", 21.0, 1),
    "numbers between blanks": (robot(link("bus", " 20\t", 2), L1, J1), ".urdf", 21.0, 1),
    "a world that floats": (robot('<link name="world"/>', BUS, L1, J1, joint("f", "world", "bus", "floating")),
                            ".urdf", 21.0, 1),
    "frames without mass": (robot(BUS, L1, J1, '<link name="camera"/>', joint("c", "l1", "camera", "fixed")),
                            ".urdf", 21.0, 1),
    "a lidar that spins without mass": (robot(BUS, L1, J1, '<link name="lidar"/>',
                                              joint("spin", "l1", "lidar", "continuous")), ".urdf", 21.0, 1),
    "mass on a welded tool": (robot(BUS, L1, J1, link("tool", 2), joint("t", "l1", "tool", "fixed")), ".urdf", 23.0, 1),
    "a continuous joint": (robot(BUS, L1, joint("j1", "bus", "l1", "continuous")), ".urdf", 21.0, 1),
    "a rail": (robot(BUS, L1, joint("j1", "bus", "l1", "prismatic", "1 0 0")), ".urdf", 21.0, 1),
    "fingers that mimic": (robot(BUS, FINGERS, joint("j2", "bus", "l2", "prismatic", "-1 0 0",
                                                     '<mimic joint="j1" multiplier="1"/>')), ".urdf", 22.0, 2),
    "damping and friction": (robot(BUS, L1, joint("j1", "bus", "l1", more='<dynamics damping="0.2" friction="0.1"/>')),
                             ".urdf", 21.0, 1),
    "tags of Gazebo": (robot(BUS, L1, J1, GAZEBO), ".urdf", 21.0, 1),
    "an axis of length two": (robot(BUS, L1, joint("j1", "bus", "l1", axis="0 0 2")), ".urdf", 21.0, 1),
    "a thin rod": (robot(BUS, L1.replace('ixx="0.1"', 'ixx="0.0"'), J1), ".urdf", 21.0, 1),
    "a link named like its joint": (robot(BUS, link("j1"), joint("j1", "bus", "j1")), ".urdf", 21.0, 1),
    "xacro": (XACRO, ".urdf.xacro", 21.0, 1),
    "xacro that is called a URDF": (XACRO, ".urdf", 21.0, 1),
    "SDF": (SDF, ".sdf", 21.0, 1),
    "a mesh of a package nobody has": (robot(BUS, link("l1", more=MESH.format("package://arm/l1.stl")), J1), ".urdf", 21.0, 1),
    "MJCF": (MJCF, ".xml", 21.0, 1),
}  # fmt: skip
REFUSED = {
    "decimal commas": (robot(BUS, link("l1", at="0,1 0 0"), J1), ".urdf", r"link 'l1'.*decimals"),
    "a closed loop": (robot(BUS, L1, link("l2"), J1, joint("j2", "bus", "l2"), joint("j3", "l1", "l2")), ".urdf",
                      r"Link 'l2'.*'j2', 'j3': a closed loop"),
    "two roots": (robot(BUS, L1, J1, link("loose")), ".urdf", r"2 have no parent \(bus, loose\)"),
    "an axis without direction": (robot(BUS, L1, joint("j1", "bus", "l1", axis="0 0 0")), ".urdf", r"'j1'.*no direction"),
    "a link twice": (robot(BUS, L1, L1, J1), ".urdf", r"links.*'l1'"),
    "a joint without limits": (robot(BUS, L1, J1.replace("<limit", "<bound")), ".urdf", r"'j1'.*no <limit>"),
    "limits upside down": (robot(BUS, L1, J1.replace('"-1"', '"3"')), ".urdf", r"'j1'.*upside down"),
    "moments of no body": (robot(BUS, L1.replace('izz="0.1"', 'izz="0.9"'), J1), ".urdf", r"link 'l1'.*trusted"),
    "a negative mass": (robot(BUS, link("l1", -1), J1), ".urdf", r"[Ll]ink 'l1'.*mass -1"),
    "no masses": (robot('<link name="bus"/><link name="l1"/>', J1), ".urdf", r"no mass|no inertia"),
    "a link that is not there": (robot(BUS, J1), ".urdf", r"'j1'.*'l1', which does not exist"),
    "xacro without its namespace": (XACRO.replace(NAMESPACE, ""), ".urdf.xacro", r"unbound prefix.*xmlns:xacro.*expand it with xacro first"),
    "cut short": (robot(BUS, L1, J1)[:-40], ".urdf", r"not well-formed.*cut short"),
    "a joint of ball": (MJCF.replace('axis="0 0 1"', 'type="ball"'), ".xml", r"'j1'.*ball"),
    "a web page": ("<html><body>404</body></html>", ".urdf", r"no URDF"),
}  # fmt: skip


def written(folder, text, suffix):
    path = folder / f"r{suffix}"
    path.write_bytes(text.encode("latin-1" if "iso-8859-1" in text else "utf-8"))
    return path


@pytest.mark.parametrize("kind", LOADED)
def test_it_loads_with_every_mass_and_joint(kind, tmp_path):
    text, suffix, mass, joints = LOADED[kind]
    if suffix == ".xml":
        pytest.importorskip("mujoco")
    if text is XACRO:
        pytest.importorskip("xacrodoc", reason="needs the extra xacro")
    model = build_model(load_description(written(tmp_path, text, suffix)))
    assert model.mass == pytest.approx(mass, rel=1e-12)
    assert len(model.arm_joints) == joints and model.nv == 6 + joints


@pytest.mark.parametrize("kind", REFUSED)
def test_it_is_refused_with_what_to_do(kind, tmp_path):
    text, suffix, words = REFUSED[kind]
    if suffix == ".xml":
        pytest.importorskip("mujoco")
    with pytest.raises(DescriptionError, match=words) as caught:
        build_model(load_description(written(tmp_path, text, suffix)), visuals=True)
    assert caught.value.advice
