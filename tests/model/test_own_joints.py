"""Joints of the craft's own URDF: welded by `fixed`, and wheels whose link has no inertia."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.description import Arm, Description, Wheel
from smsid.errors import DescriptionError
from smsid.model import build_model

URDF = """<robot name="r">
<link name="bus"><inertial><mass value="10"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="disc"/>
<link name="arm"><inertial><origin xyz="1 0 0"/><mass value="2"/>
  <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="spin" type="continuous"><parent link="bus"/><child link="disc"/><axis xyz="0 1 0"/></joint>
<joint name="turn" type="revolute"><parent link="bus"/><child link="arm"/><axis xyz="0 0 1"/>
  <limit lower="-2" upper="2" effort="5" velocity="6"/><dynamics damping="1"/></joint>
</robot>"""


def craft(tmp_path, **tables):
    (tmp_path / "r.urdf").write_text(URDF)
    return Description(name="r", urdf="r.urdf", folder=tmp_path, **tables)


def test_a_wheel_without_inertia_is_given_one(tmp_path):
    model = build_model(craft(tmp_path, wheel=(Wheel(name="w", joint="spin", inertia=0.02),)))
    inertia = model.pin.inertias[int(model.wheels.joints[0])]
    np.testing.assert_allclose(inertia.inertia, np.diag([0.0, 0.02, 0.0]), atol=1e-15)
    assert model.wheels.names == ("spin",)


def test_a_wheel_that_has_inertia_is_not_given_another(tmp_path):
    with pytest.raises(DescriptionError, match=r"'turn' a spin inertia of 2\.1 kg m\^2 already"):
        build_model(craft(tmp_path, wheel=(Wheel(name="w", joint="turn", inertia=0.02),)))


def test_own_joints_are_welded_at_home(tmp_path):
    wheel = (Wheel(name="w", joint="spin", inertia=0.02),)
    arm = Arm(name="arm", fixed=("turn",), home={"turn": np.pi / 2})
    model = build_model(craft(tmp_path, wheel=wheel, arm=(arm,)))
    assert len(model.arm_joints) == 0 and model.mass == pytest.approx(12.0)
    np.testing.assert_allclose(model.pin.inertias[1].lever, [0.0, 2.0 / 12.0, 0.0], atol=1e-12)
    assert not model.description.effect  # the friction of a welded joint is gone with it


def test_a_joint_is_not_both_moved_and_fixed(tmp_path):
    with pytest.raises(ValueError, match="both `joints` and `fixed`"):
        Arm(name="arm", joints=("turn",), fixed=("turn",))
