"""The model built equals the file checked; whatever differs is named."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from smsid.description.urdf_check import read_urdf
from smsid.description.urdf_reading import parse_urdf
from smsid.errors import DescriptionError
from smsid.model.load import check_against_urdf

URDF = """<robot name="r">
<link name="bus"><inertial><mass value="10"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
</link>
<link name="plate"><inertial><origin xyz="0.1 0.2 0.3" rpy="0.3 0.2 0.1"/><mass value="2"/>
  <inertia ixx="0.1" iyy="0.2" izz="0.25" ixy="0.01" ixz="0.02" iyz="0.03"/></inertial></link>
<link name="arm"><inertial><origin xyz="0 0 0.4"/><mass value="3"/>
  <inertia ixx="0.3" iyy="0.3" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="weld" type="fixed"><parent link="bus"/><child link="plate"/>
  <origin xyz="1 0 0" rpy="0 1 0"/></joint>
<joint name="turn" type="revolute"><parent link="plate"/><child link="arm"/>
  <origin xyz="0 1 0" rpy="1 2 3"/>
  <axis xyz="1 1 0"/><limit lower="-1" upper="2" effort="5" velocity="6"/></joint>
</robot>"""


@pytest.fixture
def built(tmp_path):
    (tmp_path / "r.urdf").write_text(URDF)
    text = read_urdf(tmp_path / "r.urdf")
    return pin.buildModelFromXML(text, pin.JointModelFreeFlyer()), parse_urdf(text, "r.urdf")


def without_link(model):
    other = pin.buildModelFromXML(
        URDF.replace('<mass value="2"/>', '<mass value="0"/>').replace('"0.1" iyy="0.2"', '"0" iyy="0"'),
        pin.JointModelFreeFlyer(),
    )
    model.inertias[1] = other.inertias[1]


HEAVIER = ["Link 'arm'", "<mass> is 3 in the file and 6"]
SPOILT = {
    "plate weighs nothing": (without_link, ["bus", "plate", "<mass> is 12 in the file and 10"]),
    "arm heavier": (lambda m: m.inertias.__setitem__(2, m.inertias[2] + m.inertias[2]), HEAVIER),
    "origin": (
        lambda m: m.jointPlacements.__setitem__(2, pin.SE3.Identity()),
        ["Joint 'turn'", "<origin>"],
    ),
    "limit": (lambda m: m.upperPositionLimit.__setitem__(7, 3.0), ["'turn'", "<limit upper> is 2"]),
    "effort": (lambda m: setattr(m, "effortLimit", m.effortLimit / 2), ["'turn'", "<limit effort> is 5"]),
    "speed": (
        lambda m: setattr(m, "velocityLimit", m.velocityLimit / 2),
        ["'turn'", "<limit velocity> is 6"],
    ),
}


def test_as_built_it_is_the_file(built):
    check_against_urdf(*built, free=True)


@pytest.mark.parametrize("case", SPOILT)
def test_what_differs_is_named(built, case):
    model, reading = built
    spoil, expected = SPOILT[case]
    spoil(model)
    with pytest.raises(DescriptionError) as caught:
        check_against_urdf(model, reading, free=True)
    for piece in expected:
        assert piece in str(caught.value)


def test_another_axis_is_named(built):
    _, reading = built
    model = pin.buildModelFromXML(URDF.replace("1 1 0", "1 1 1"), pin.JointModelFreeFlyer())
    with pytest.raises(DescriptionError, match=r"Joint 'turn'.*<axis>"):
        check_against_urdf(model, reading, free=True)


def test_moments_are_compared(built):
    model, reading = built
    theta = np.array(model.inertias[2].toDynamicParameters())
    theta[4] += 1e-6
    model.inertias[2] = pin.Inertia.FromDynamicParameters(theta)
    with pytest.raises(DescriptionError, match=r"Link 'arm'.*<inertia>"):
        check_against_urdf(model, reading, free=True)
