"""A light wrist with dry friction: as stiff as joints come."""

from __future__ import annotations

import pytest

from smsid.description import load_description
from smsid.effects import JointFriction
from smsid.model import build_model

INERTIA, COULOMB, SMOOTHING = 1e-4, 1.0, 0.005  # settles within 5e-7 s
URDF = f"""<robot name="light"><link name="base"/><link name="hand"><inertial><mass value="0.01"/>
<inertia ixx="{INERTIA}" iyy="{INERTIA}" izz="{INERTIA}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="wrist" type="continuous"><parent link="base"/><child link="hand"/><axis xyz="0 0 1"/></joint>
</robot>"""


@pytest.fixture(scope="module")
def light(tmp_path_factory):
    folder = tmp_path_factory.mktemp("light")
    (folder / "light.urdf").write_text(URDF)
    (folder / "light.toml").write_text(
        'schema = 1\nname = "light"\nurdf = "light.urdf"\nroot = "fixed"\ngravity = [0.0, 0.0, 0.0]\n'
        '[[arm]]\nname = "arm"\njoints = ["wrist"]\n'
    )
    friction = JointFriction(name="dry", joint="wrist", coulomb=COULOMB, smoothing=SMOOTHING)
    return build_model(load_description(folder / "light.toml").with_effects(friction))
