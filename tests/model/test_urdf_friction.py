"""<dynamics> of a URDF is friction of the model; exports say the same."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.description import load_description
from smsid.effects import JointFriction
from smsid.export import export_folder
from smsid.model import build_model, rebuild

URDF = """<robot name="r">
<link name="bus"><inertial><mass value="10"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
</link>
<link name="arm"><inertial><origin xyz="0 0 0.4"/><mass value="3"/>
  <inertia ixx="0.3" iyy="0.3" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="revolute"><parent link="bus"/><child link="arm"/><origin xyz="0 1 0"/>
  <axis xyz="1 0 0"/><limit lower="-1" upper="2" effort="5" velocity="6"/>
  <dynamics damping="2.0" friction="0.5"/></joint>
</robot>"""


@pytest.fixture
def craft(tmp_path):
    (tmp_path / "r.urdf").write_text(URDF)
    return load_description(tmp_path / "r.urdf")


def test_friction_acts_as_written(craft):
    model = build_model(craft)
    v = np.zeros(model.nv)
    v[6] = 0.3
    expected = -2.0 * 0.3 - 0.5 * np.tanh(0.3 / 0.005)
    assert model.passive_forces(0.0, model.home, v)[6] == pytest.approx(expected, rel=1e-12)
    assert rebuild(model, craft).passive_forces(0.0, model.home, v)[6] == pytest.approx(expected, rel=1e-12)


def test_friction_of_the_description_stands_instead(craft):
    mine = JointFriction(name="mine", joint="turn", viscous=0.1)
    model = build_model(craft.with_effects(mine))
    assert [e.name for e in model.description.effect] == ["mine"]
    v = np.zeros(model.nv)
    v[6] = 0.3
    assert model.passive_forces(0.0, model.home, v)[6] == pytest.approx(-0.03)


@pytest.mark.parametrize("given", [None, JointFriction(name="mine", joint="turn", viscous=0.1, coulomb=0.2)])
def test_exports_agree(craft, tmp_path, given):
    mujoco = pytest.importorskip("mujoco")
    craft = craft if given is None else craft.with_effects(given)
    export_folder(craft, tmp_path / "out")
    again = build_model(load_description(tmp_path / "out" / "r.toml"))
    bare = build_model(load_description(tmp_path / "out" / "r.urdf"))
    xml = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "r.xml"))
    urdf = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "r.urdf"))
    viscous, coulomb = (2.0, 0.5) if given is None else (0.1, 0.2)
    for engine in (xml, urdf):
        assert engine.dof_damping[-1] == viscous
        assert engine.dof_frictionloss[-1] == coulomb
    v = np.zeros(again.nv)
    v[6] = 0.3
    forces = [m.passive_forces(0.0, m.home, v)[6] for m in (build_model(craft), again, bare)]
    assert forces[0] == forces[1] == forces[2] != 0.0
