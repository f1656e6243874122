"""A URDF alone: a machine on the ground where its root has no mass, else a spacecraft."""

from pathlib import Path

import pytest

from smsid.cli import main
from smsid.description import load_description

LINK = """<link name="{name}"><inertial><mass value="2"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="j1" type="{kind}"><parent link="base"/><child link="l1"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" effort="10" velocity="2"/></joint>"""


def urdf(folder: Path, base: str, kind: str = "revolute") -> Path:
    path = folder / "arm.urdf"
    path.write_text(f'<robot name="arm">{base}{LINK.format(name="l1")}{JOINT.format(kind=kind)}</robot>')
    return path


@pytest.mark.parametrize(
    ("base", "kind", "root"),
    [
        ('<link name="base"/>', "revolute", "fixed"),
        (LINK.format(name="base"), "revolute", "free"),
        ('<link name="base"/>', "prismatic", "free"),  # may slide over a table: refused with its advice
    ],
)
def test_where_a_urdf_alone_stands(tmp_path, base, kind, root):
    assert load_description(urdf(tmp_path, base, kind)).root == root


@pytest.mark.parametrize("command", ["check", "show"])
def test_commands_take_an_arm_without_a_toml(command, tmp_path, monkeypatch, capsys):
    """They said that the bus has no mass, of what `smsid identify` takes."""
    path = urdf(tmp_path, '<link name="base"/>')
    monkeypatch.setattr("sys.argv", ["smsid", command, str(path)])
    main()
    assert "no mass" not in capsys.readouterr().out
