"""Every command on the crafts that the benchmark writes after public reports."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

for package in ("mujoco", "xacrodoc", "pyarrow", "rosbags", "pythonfmu3"):
    pytest.importorskip(package)
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cube", "servicer", "gantry"])
def test_every_command_works_on_a_public_style_robot(name, tmp_path):
    from every_command import COMMANDS, walked

    found = walked(name, tmp_path / name)
    assert set(found["commands"]) == set(COMMANDS)
    assert not {what: row["said"] for what, row in found["commands"].items() if not row["well"]}
    assert max(found["exports"].values()) < 1e-9
    assert found["estimate"]["inside 95 %"] >= 0.85 * found["estimate"]["parameters"]


def test_every_command_of_smsid_is_called():
    from every_command import COMMANDS

    from smsid.cli.app import app

    named = {info.name or info.callback.__name__.strip("_") for info in app.registered_commands}
    elsewhere = {"demo", "new", "version", "lab"}  # need no robot, write their own, or take laboratory tests
    assert named - {words.split()[0] for words in COMMANDS.values()} <= elsewhere
