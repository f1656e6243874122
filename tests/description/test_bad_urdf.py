"""Every bad URDF gives a DescriptionError whose message names the place and the mend."""

from __future__ import annotations

import pytest

from smsid.description import load_description
from smsid.errors import DescriptionError
from smsid.model import build_model

from .pieces import ARM, BUS, HEAD

INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
URDF_CASES = {
    "negative mass": (('mass value="2"', 'mass value="-2"'), ["'upper'", "-2 kg", "positive"]),
    "NaN mass": (('mass value="2"', 'mass value="nan"'), ["mass of link 'upper'", "nan", "finite"]),
    "mass in words": (('mass value="2"', 'mass value="two"'), ["mass of link 'upper'", "'two'"]),
    "triangle inequality": (('izz="0.1"', 'izz="0.3"'), ["'upper'", "0.1, 0.1, 0.3", 'inertias = "trusted"']),
    "negative moment": (
        (
            'ixy="0" ixz="0" iyz="0"/></inertial></link>\n  <joint name="mount"',
            'ixy="0.3" ixz="0" iyz="0"/></inertial></link>\n  <joint name="mount"',
        ),
        ["'upper'", "-0.2", "signs of the products"],
    ),
    "no mass": (('<mass value="2"/>', ""), ["'upper'", "Give both"]),
    "infinite inertia": (('izz="0.1"', 'izz="inf"'), ["'upper'", "izz", "finite"]),
    "bus without mass": (('<mass value="100"/>', '<mass value="0"/>'), ["bus", "no mass", "<inertial>"]),
    "arm without mass": (
        (
            '<mass value="2"/>\n    <inertia ixx="0.1" iyy="0.1" izz="0.1"',
            '<mass value="0"/>\n    <inertia ixx="0" iyy="0" izz="0"',
        ),
        ["'shoulder'", "takes no inertia", "<inertial>"],
    ),
    "missing mesh": (
        (
            '<link name="arm_mount"/>',
            '<link name="arm_mount"><visual><geometry><mesh filename="package://a/b.stl"/></geometry>'
            "</visual></link>",
        ),
        ["'package://a/b.stl'", "'arm_mount'", "package_dirs", "ignored"],
    ),
    "cut short": (('<link name="arm_mount"/>\n</robot>', "<link na"), ["bus.urdf", "cut short", "line"]),
    "not XML": ((BUS, "hello"), ["bus.urdf", "not well-formed"]),
    "empty": ((BUS, ""), ["bus.urdf", "not well-formed"]),
    "another XML": ((BUS, "<html/>"), ["no URDF"]),
    "joint to nowhere": (
        ('<child link="upper"/>', '<child link="uper"/>'),
        ["'shoulder'", "'uper'", "exist"],
    ),
    "two links of a name": (('<link name="arm_mount"/>', '<link name="upper"/>'), ["links", "'upper'"]),
    "two roots": (("</robot>", '<link name="lost"/></robot>'), ["no tree", "bus, lost", "exactly one joint"]),
    "joint without limit": (
        ('<limit lower="-3" upper="3" velocity="1" effort="1"/>', ""),
        ["'shoulder'", "<limit>", "continuous"],
    ),
    "decimal comma": (
        ('<mass value="2"/>', '<origin xyz="0,5 0 0"/><mass value="2"/>'),
        ["<origin>", "'upper'", "0,5 0 0", "three finite numbers"],
    ),
    "centre of two numbers": (
        ('<mass value="2"/>', '<origin xyz="0.5 0"/><mass value="2"/>'),
        ["<origin>", "'upper'", "three finite numbers"],
    ),
    "missing moment": (('izz="0.1" ', ""), ["'upper'", "izz", "'missing'"]),
    "missing product": (('izz="0.1" ixy="0" ixz="0"', 'izz="0.1" ixy="0"'), ["'upper'", "ixz", "'missing'"]),
    "two inertials": (
        (
            '<link name="arm_mount"/>',
            '<link name="arm_mount">' + 2 * INERTIAL + "</link>",
        ),
        ["'arm_mount'", "2 <inertial>", "Keep one"],
    ),
    "two masses": (
        ('<mass value="2"/>', '<mass value="2"/><mass value="5"/>'),
        ["<inertial> of link 'upper'", "2 <mass>"],
    ),
    "two limits": (
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/>'),
        ["'shoulder'", "2 <limit>", "Keep one"],
    ),
    "two axes": (
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 1"/><axis xyz="1 0 0"/>'),
        ["'shoulder'", "2 <axis>"],
    ),
    "axis of no length": (('<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>'), ["<axis>", "'shoulder'", "0 0 0"]),
    "limits upside down": (('lower="-3" upper="3"', 'lower="3" upper="-3"'), ["'shoulder'", "upside down"]),
    "limit in words": (('upper="3"', 'upper="three"'), ["'shoulder'", "upper", "'three'"]),
    "a limit beyond numbers": (('velocity="1"', 'velocity="1e400"'), ["'shoulder'", "velocity", "1e400"]),
    "negative velocity": (('velocity="1"', 'velocity="-1"'), ["'shoulder'", "velocity", "-1"]),
    "friction that drives": (
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 1"/><dynamics damping="-1"/>'),
        ["'shoulder'", "damping", "-1"],
    ),
    "closed loop": (
        (
            "</robot>",
            '<joint name="again" type="fixed"><parent link="arm_mount"/><child link="upper"/></joint>'
            "</robot>",
        ),
        ["'upper'", "2 parents", "'shoulder', 'again'", "closed loop"],
    ),
    "substitution": (('value="2"', 'value="${m}"'), ["xacro cannot expand", "'m'"]),
    "joint of no type": (('type="revolute"', 'type="hinge"'), ["'shoulder'", "'hinge'", "revolute"]),
    "floating arm": (('type="revolute"', 'type="floating"'), ["'shoulder'", "6 degrees of freedom"]),
}


@pytest.mark.parametrize("case", URDF_CASES)
def test_bad_urdf(fails, case):
    (old, new), expected = URDF_CASES[case]
    assert old in BUS
    text = fails(HEAD, BUS.replace(old, new, 1))
    for piece in expected:
        assert piece in text


def test_bad_arm_urdf_names_the_arm(fails, tmp_path):
    (tmp_path / "arm.urdf").write_text(BUS.replace('izz="0.1"', 'izz="0.3"'))
    text = fails(HEAD + ARM + 'urdf = "arm.urdf"\n')
    assert "[[arm]] 'arm'" in text and "`inertias = \"trusted\"` in [[arm]] 'arm'" in text


def test_trusted_inertias_are_taken(tmp_path):
    (tmp_path / "bus.urdf").write_text(BUS.replace('izz="0.1"', 'izz="0.3"'))
    (tmp_path / "x.toml").write_text(HEAD + 'inertias = "trusted"\n')
    model = build_model(load_description(tmp_path / "x.toml"))
    assert model.pin.inertias[2].inertia[2, 2] == pytest.approx(0.3)


def test_urdf_missing(fails, tmp_path):
    assert "nowhere.urdf" in fails(HEAD.replace("bus.urdf", "nowhere.urdf"))
    with pytest.raises(DescriptionError, match="Known by name are paper_sms and two_arm_sms"):
        load_description("panda")
    with pytest.raises(DescriptionError, match="does not exist"):
        load_description(tmp_path / "nowhere.urdf")
    with pytest.raises(DescriptionError, match="does not exist"):
        load_description(tmp_path / "nowhere.toml")


def test_not_text(tmp_path):
    (tmp_path / "x.toml").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "x.urdf").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DescriptionError, match="no UTF-8 text"):
        load_description(tmp_path / "x.toml")
    with pytest.raises(DescriptionError, match="not well-formed"):
        build_model(load_description(tmp_path / "x.urdf"))
