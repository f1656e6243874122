"""A log in several files, and joints that its columns name: one recording from the draft as it stands."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

from smsid.cli.app import app
from smsid.errors import RecordingError
from smsid.recording import import_recording, load_recording
from smsid.recording._guess import joint_name
from smsid.recording.inspect import inspect_file

JOINTS = ("torso_lift_joint", "arm_1_joint", "arm_2_joint")


@pytest.fixture
def files(tmp_path):
    t = np.arange(0.0, 8.0, 0.01)
    angle = np.column_stack([0.1 * k * np.sin(0.8 * k * t) for k in (1, 2, 3)])
    rate = np.column_stack([0.08 * k**2 * np.cos(0.8 * k * t) for k in (1, 2, 3)])
    made = []
    for word, values in (("position", angle), ("velocity", rate), ("effort", 3.0 * rate + angle)):
        path = tmp_path / f"{word}.csv"
        header = ",".join(["t", *(f"- {j}_{word}" for j in JOINTS)])
        np.savetxt(path, np.column_stack([t, values]), delimiter=",", header=header, comments="")
        made.append(path)
    return made


def test_the_draft_of_three_files_imports_with_joints_by_name(files, tmp_path):
    first, *others = files
    also = [x for f in others for x in ("--also", f)]
    for command in (
        ["inspect", first, *also, "--map", tmp_path / "map.toml"],
        ["import", first, *also, "--map", tmp_path / "map.toml", "-o", tmp_path / "log.nc"],
    ):
        shown = CliRunner().invoke(app, [str(x) for x in command])
        assert shown.exit_code == 0, shown.output
    log = load_recording(tmp_path / "log.nc")
    assert log.labels["joint"] == JOINTS
    quantities = {name.partition(".")[2]: log[name] for name in log.channels}
    assert set(quantities) == {"joint_position", "joint_velocity", "joint_torque"}
    t = log.time(log.channels[0])
    np.testing.assert_allclose(quantities["joint_position"][:, 2], 0.3 * np.sin(2.4 * t), atol=1e-9)


def test_files_of_other_clocks_are_not_joined(files, tmp_path):
    first, second, _ = files
    lines = second.read_text().splitlines()
    (tmp_path / "cut.csv").write_text("\n".join(lines[:-5]))
    with pytest.raises(RecordingError, match=r"'t' of .*cut.csv is not that of"):
        inspect_file(first, also=[tmp_path / "cut.csv"])
    mapping = tmp_path / "map.toml"
    mapping.write_text(inspect_file(first, also=[second]).mapping)
    with pytest.raises(RecordingError, match=r"'t' of .*cut.csv is not that of"):
        import_recording(first, mapping, also=[tmp_path / "cut.csv"])


@pytest.mark.parametrize(
    ("column", "name"),
    [
        ("- torso_lift_joint_position", "torso_lift_joint"),
        ("elbow.torque [N m]", "elbow"),
        ("q_shoulder_pan", "shoulder_pan"),
        ("tau_wrist", "wrist"),
        ("q1", ""),
        ("position", ""),
        ("effort_3", ""),
    ],
)
def test_the_joint_of_a_column(column, name):
    assert joint_name(column) == name
