"""Spacecraft and arms of every kind that the kernel takes."""

from __future__ import annotations

import pytest

from smsid.description import load_description
from smsid.kernel.jit import SWITCH, numba
from smsid.model import SpacecraftModel, build_model
from smsid.paths import urdf_folder

LINK = """<link name="{name}"><inertial><origin xyz="0.3 0.02 -0.01" rpy="0.1 0.2 0.3"/><mass value="{mass}"/>
<inertia ixx="0.5" iyy="0.7" izz="0.6" ixy="0.02" ixz="-0.01" iyz="0.03"/></inertial></link>"""
JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="0.4 -0.1 0.2" rpy="0.3 -0.2 0.5"/><axis xyz="{axis}"/>
<limit lower="-3" upper="3" effort="100" velocity="10"/></joint>"""
CHAIN = (
    ("slide", "prismatic", "base", "a", "0.6 0 0.8"),
    ("turn", "revolute", "a", "b", "0 1 0"),
    ("endless", "continuous", "b", "c", "0 0 1"),
    ("branch", "revolute", "a", "d", "0.48 0.6 0.64"),
    ("far", "prismatic", "c", "e", "1 0 0"),
)
TANK = """[[effect]]
kind = "slosh"
name = "tank"
frame = "b"
position = [0.1, 0.2, 0.3]
mass = 3.0
stiffness = [4.0, 5.0, 6.0]
damping = [0.1, 0.2, 0.3]
"""


@pytest.fixture(scope="session")
def crafts(tmp_path_factory) -> dict[str, SpacecraftModel]:
    """By name: the paper's, a satellite, two arms; an arm of sliding and endless joints, free and welded."""
    folder = tmp_path_factory.mktemp("kernel")
    links = LINK.format(name="base", mass=300.0) + "".join(
        LINK.format(name=child, mass=20.0) for *_, child, _ in CHAIN
    )
    joints = "".join(JOINT.format(name=n, kind=k, parent=p, child=c, axis=x) for n, k, p, c, x in CHAIN)
    (folder / "arm.urdf").write_text(f'<robot name="arm">{links}{joints}</robot>')
    (folder / "bus.urdf").write_text(f'<robot name="bus">{LINK.format(name="base", mass=300.0)}</robot>')
    names = ", ".join(f'"{n}"' for n, *_ in CHAIN)
    for root in ("free", "fixed"):
        (folder / f"{root}.toml").write_text(
            f'schema = 1\nname = "{root}"\nurdf = "arm.urdf"\nroot = "{root}"\ngravity = [0.3, -1.0, -9.0]\n'
            f'[[arm]]\nname = "arm"\njoints = [{names}]\n{TANK}'
        )
    (folder / "satellite.toml").write_text('schema = 1\nname = "satellite"\nurdf = "bus.urdf"\n')
    own = {"sliding": "free", "welded": "fixed", "satellite": "satellite"}
    files = {name: folder / f"{file}.toml" for name, file in own.items()}
    files |= {"paper": urdf_folder() / "paper_sms.toml", "two arms": urdf_folder() / "two_arm_sms.toml"}
    return {name: build_model(load_description(file)) for name, file in files.items()}


@pytest.fixture(params=["paper", "satellite", "two arms", "sliding", "welded"])
def craft(request, crafts) -> SpacecraftModel:
    return crafts[request.param]


@pytest.fixture
def both_ways(monkeypatch):
    """Return a function that runs another compiled, then plain, and returns both results."""
    if numba is None:
        pytest.skip("numba is not installed")

    def run(function):
        found = []
        for switch in ("1", "0"):
            monkeypatch.setenv(SWITCH, switch)
            found.append(function())
        return found

    return run
