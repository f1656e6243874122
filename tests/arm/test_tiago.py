"""TIAGo, from three published tables and its URDF alone: no column, gain or sign by hand."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from smsid.cli.app import app
from smsid.identify.estimate import load_estimate
from smsid.recording import load_recording, save_recording

TOLD = {"arm_2_joint": 13.6, "arm_3_joint": -8.7, "arm_4_joint": -8.7}
"""Published gains [N m/A], reduction times torque constant, of joints whose links' torque shows."""


def run(*arguments):
    shown = CliRunner().invoke(app, [str(a) for a in arguments])
    assert shown.exit_code == 0, shown.output
    return shown.output


@pytest.mark.slow
def test_the_draft_of_three_tables_identifies_the_arm(tmp_path):
    folder = Path(os.environ.get("SMSID_DATA", "")) / "tiago"
    if not (folder / "tiago.urdf").is_file():
        pytest.skip("SMSID_DATA has no copy of tiago")
    first, *others = (folder / f"tiago_{n}.csv.gz" for n in ("position", "velocity", "effort"))
    also = [x for f in others for x in ("--also", f)]
    run("inspect", first, *also, "--map", tmp_path / "map.toml")
    run("import", first, *also, "--map", tmp_path / "map.toml", "-o", tmp_path / "all.nc")
    log = load_recording(tmp_path / "all.nc")
    # the measured rate is 0.2 s late, which the draft says and leaves out
    assert {n.partition(".")[2] for n in log.channels} == {"joint_position", "joint_torque"}
    save_recording(log.window(9.0, 50.0).with_role("estimation").with_name("train"), tmp_path / "train.nc")
    save_recording(log.window(50.0, 68.0).with_role("validation").with_name("held"), tmp_path / "held.nc")
    held = [x for p in ("wheel_*", "head_*", "hand_*") for x in ("--hold", p)]
    files = (folder / "tiago.urdf", tmp_path / "train.nc", tmp_path / "held.nc")
    shown = run("identify", *files, "--gains", *held, "-o", tmp_path / "e.json")
    lines = [line for line in shown.splitlines() if "N m per unit of signal" in line]
    gains = {line.split(":")[0]: float(line.split()[1]) for line in lines}
    assert set(gains) == set(TOLD)
    shares = [gains[joint] / published for joint, published in TOLD.items()]
    assert min(shares) > 1.0 and max(shares) < 1.4  # signs, and sizes to a third; the links are the URDF's
    assert max(shares) / min(shares) < 1.2  # ratios
    row = next(line for line in shown.splitlines() if "validation" in line)
    assert float(row.split()[2]) < 0.094  # least squares by hand
    # two halves agree: at most 8 % of the parameters differ by more than their 95 %
    for end in (50.0, 68.0):
        middle, halves = 0.5 * (9.0 + end), []
        for name, begin, stop in (("one", 9.0, middle), ("two", middle, end)):
            half = log.window(begin, stop).with_role("estimation").with_name(name)
            save_recording(half, tmp_path / f"{name}.nc")
            run("identify", files[0], tmp_path / f"{name}.nc", "--gains", *held, "-o", tmp_path / "half.json")
            halves.append(load_estimate(tmp_path / "half.json"))
        one, two = halves
        pairs = [(p, two[p.name]) for p in one.parameters]
        z = np.array([(p.value - q.value) / np.hypot(p.sigma, q.sigma) for p, q in pairs])
        assert np.sum(np.abs(z) > 1.96) <= 0.08 * np.sum(np.isfinite(z))
