"""Inspecting logs: what is in them, what looks wrong, and a mapping that imports them."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from smsid.recording import import_recording
from smsid.recording.inspect import inspect_command, inspect_file
from smsid.recording.mapping import parse_mapping

T = np.arange(0.0, 4.0, 0.01)


def csv(path, columns, delimiter=",", decimal="."):
    rows = [delimiter.join(columns)]
    for row in zip(*columns.values(), strict=True):
        rows.append(delimiter.join(f"{x:.9g}".replace(".", decimal) for x in row))
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


def gyro(scale=1.0):
    return {f"gyro_{a}": scale * np.sin(T + k) for k, a in enumerate("xyz")}


def test_the_draft_imports_the_log(tmp_path):
    acc = {f"acc {a} [m/s2]": np.cos(T + k) for k, a in enumerate("xyz")}
    path = csv(tmp_path / "a.csv", {"time [s]": T, **gyro(), **acc})
    report = inspect_file(path)
    assert report.suspicions == ()
    assert report.clocks[0].rate == pytest.approx(100.0)
    recording = import_recording(path, parse_mapping(tomllib.loads(report.mapping)))
    np.testing.assert_allclose(recording["log.angular_rate"][:, 2], np.sin(T + 2), atol=1e-8)
    np.testing.assert_allclose(recording["log.acceleration"][:, 0], np.cos(T), atol=1e-8)


def test_another_language_and_decimal_commas(tmp_path):
    angles = {f"Winkel {k}": 0.5 * np.sin(T * k) for k in (1, 2)}
    torques = {f"Drehmoment {k} [Nm]": np.cos(T * k) for k in (1, 2)}
    path = csv(tmp_path / "a.csv", {"Zeit [ms]": 1e3 * T, **angles, **torques}, ";", ",")
    report = inspect_file(path)
    assert (report.clocks[0].unit, round(report.clocks[0].rate)) == ("ms", 100)
    recording = import_recording(path, parse_mapping(tomllib.loads(report.mapping)))
    np.testing.assert_allclose(recording["log.joint_position"][:, 1], 0.5 * np.sin(2 * T), atol=1e-8)
    assert recording.unit("log.joint_torque") == "N m"


def damaged(kind):
    t = T.copy()
    columns = gyro()
    if kind == "gap":
        keep = (t < 1.0) | (t > 3.0)
        t, columns = t[keep], {k: v[keep] for k, v in columns.items()}
    elif kind == "duplicates":
        order = np.sort(np.append(np.arange(t.size), [7, 8]))
        t, columns = t[order], {k: v[order] for k, v in columns.items()}
    elif kind == "reordered":
        order = np.arange(t.size)
        order[[50, 51]] = [51, 50]
        t, columns = t[order], {k: v[order] for k, v in columns.items()}
    elif kind == "jitter":
        t = t + 0.002 * np.random.default_rng(0).uniform(-1, 1, t.size)
    elif kind == "degrees":
        columns = gyro(60.0)
    elif kind == "gravities":
        columns = {f"acc_{a}": s + 0 * t for a, s in zip("xyz", (0.0, 0.1, -0.99), strict=True)}
    elif kind == "milli gravities":
        columns = {f"acc_{a}": s + 0 * t for a, s in zip("xyz", (0.0, 100.0, -990.0), strict=True)}
    elif kind == "motor angles":
        columns = {"q1": 50.0 * np.sin(t), "q2": np.cos(t)}
    elif kind == "current":
        columns = {"motor current 1 [A]": np.sin(t), "motor current 2 [A]": np.cos(t)}
    elif kind == "quaternion":
        columns = {f"quat_{a}": np.full(t.size, 0.7) for a in "xyzw"}
    elif kind == "nan":
        columns["gyro_x"] = np.where(t > 3.9, np.nan, columns["gyro_x"])
    return {"t": t, **columns}


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        ("gap", "'t' has a gap of 2.0"),
        ("duplicates", "'t' repeats 2 times"),
        ("reordered", "'t' goes back 1 times"),
        ("jitter", "'t' jitters"),
        ("degrees", "degrees per second or rpm"),
        ("gravities", "in units of gravity"),
        ("milli gravities", "in thousandths of gravity"),
        ("motor angles", "motor angles before a gear"),
        ("current", "a torque only through a gain"),
        ("quaternion", "no unit quaternion"),
        ("nan", "samples that are not finite"),
    ],
)
def test_bad_input_is_found_and_nothing_else(tmp_path, kind, text):
    report = inspect_file(csv(tmp_path / "a.csv", damaged(kind)))
    assert len(report.suspicions) == 1 and text in report.suspicions[0]


def test_a_log_without_times_says_so_and_still_drafts(tmp_path):
    report = inspect_file(csv(tmp_path / "a.csv", gyro()))
    assert "No column looks like times" in report.suspicions[0]
    assert "log.angular_rate" in parse_mapping(tomllib.loads(report.mapping)).channel


def test_names_that_say_nothing_stay_extra(tmp_path):
    report = inspect_file(csv(tmp_path / "a.csv", {"t": T, "V1": np.sin(T), "V2": np.cos(T)}))
    assert list(parse_mapping(tomllib.loads(report.mapping)).channel) == ["extra.v"]


def test_the_command_prints_and_writes_the_mapping(tmp_path):
    app = typer.Typer()
    app.command()(inspect_command)
    path = csv(tmp_path / "a.csv", damaged("gap"))
    shown = CliRunner().invoke(app, [str(path)])
    assert shown.exit_code == 0 and "suspicious" in shown.output and "[time]" in shown.output
    written = CliRunner().invoke(app, [str(path), "--map", str(tmp_path / "m.toml")])
    assert written.exit_code == 0
    parse_mapping(tomllib.loads((tmp_path / "m.toml").read_text()))
