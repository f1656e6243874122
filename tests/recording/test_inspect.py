"""Inspecting logs: what is in them, what looks wrong, and a mapping that imports them."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
import typer
from arm.mujoco_arm import JOINTS, described, motion
from typer.testing import CliRunner

from smsid.arm import with_joint_effects
from smsid.cli.logs import inspect_command
from smsid.description import save_description
from smsid.errors import RecordingError
from smsid.recording import import_recording
from smsid.recording.inspect import inspect_file
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


def test_each_source_of_a_table_with_blank_cells_is_judged_by_itself(tmp_path):
    fast, slow = 1.764e9 + 0.02 * np.arange(600), 1.764e9 + 0.1 * np.arange(120)
    fast = np.delete(fast, np.arange(201, 240))
    rows = [(t, "1,2,3,,,") for t in fast] + [(t, ",,,1,2,3") for t in slow]
    lines = [f"{t:.6f},{cells}" for t, cells in sorted(rows)]
    head = "epoch_s,gyro_x,gyro_y,gyro_z,nav_x_m,nav_y_m,nav_z_m"
    (tmp_path / "a.csv").write_text("\n".join([head, *lines]), encoding="utf-8")
    doubts = inspect_file(tmp_path / "a.csv").suspicions
    assert [d for d in doubts if "epoch_s" in d] == [
        "'epoch_s' of 'gyro_#' has a gap of 0.8 s from t = 1764000004 s, 4 s after the start (40.0 steps)."
    ]


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


def arm(**changes):
    """Angles, rates and torques of two joints in another language, with decimal commas."""
    columns = {
        "Zeit [s]": T,
        **{f"Winkel {k} [rad]": 0.8 * np.sin(1.3 * k * T) for k in (1, 2)},
        **{f"Geschwindigkeit {k} [rad/s]": 1.04 * k * np.cos(1.3 * k * T) for k in (1, 2)},
    }
    return {**columns, **changes}


ARM = {
    "time": {"column": "Zeit [s]", "unit": "s"},
    "csv": {"delimiter": ";", "decimal": ","},
    "channel": {
        "encoder.joint_position": {"columns": ["Winkel 1 [rad]", "Winkel 2 [rad]"], "unit": "rad"},
        "encoder.joint_velocity": {
            "columns": ["Geschwindigkeit 1 [rad/s]", "Geschwindigkeit 2 [rad/s]"], "unit": "rad/s",
        },
    },
}  # fmt: skip


def test_the_wrong_sign_of_one_joint_is_found_by_its_rate(tmp_path):
    rules = parse_mapping(ARM)
    path = csv(tmp_path / "right.csv", arm(), ";", ",")
    assert inspect_file(path, rules).suspicions == ()
    turned = arm(**{"Winkel 2 [rad]": -0.8 * np.sin(2.6 * T)})
    path = csv(tmp_path / "wrong.csv", turned, ";", ",")
    (doubt,) = inspect_file(path, rules).suspicions
    assert "' joint 1 is -1 times" in doubt and "wrong sign" in doubt  # joints count from 0 without labels
    with pytest.raises(RecordingError, match="wrong sign"):
        import_recording(path, rules)


def test_degrees_of_one_joint_are_found_by_its_rate(tmp_path):
    path = csv(tmp_path / "a.csv", arm(**{"Winkel 1 [rad]": np.degrees(0.1 * np.sin(1.3 * T))}), ";", ",")
    found = inspect_file(path, parse_mapping(ARM)).suspicions
    assert any("' joint 0 is 7.162 times" in s and "'encoder.joint_position'" in s for s in found)


def test_the_draft_is_compared_too(tmp_path):
    columns = {"t": T, "joint_position_1": np.sin(T), "joint_velocity_1": -np.cos(T)}
    (doubt,) = inspect_file(csv(tmp_path / "a.csv", columns)).suspicions
    assert "wrong sign" in doubt


@pytest.mark.parametrize(("unit", "rate"), [("s", 1.0), ("ms", 1e3), ("min", 1.0 / 60.0)])
def test_a_clock_is_in_the_unit_that_the_mapping_states(tmp_path, unit, rate):
    """Whole numbers one apart are taken for milliseconds only where nobody says what they are."""
    path = csv(
        tmp_path / "a.csv",
        {
            "t": np.arange(50.0),
            **{f"gyro_{a}": np.sin(0.1 * np.arange(50.0) + k) for k, a in enumerate("xyz")},
        },
    )
    rules = f'''[time]
column = "t"
unit = "{unit}"
[channel."imu.angular_rate"]
columns = ["gyro_x", "gyro_y", "gyro_z"]
unit = "rad/s"
frame = "body"'''
    (clock,) = inspect_file(path, parse_mapping(tomllib.loads(rules))).clocks
    assert clock.unit == unit and clock.rate == pytest.approx(rate)
    assert inspect_file(path).clocks[0].unit == "ms"


def test_a_mapping_of_another_log_is_refused_by_name(tmp_path):
    path = csv(tmp_path / "a.csv", {"Zeit [s]": T, "Winkel 1 [rad]": np.sin(T)}, ";", ",")
    with pytest.raises(RecordingError, match="no 'Winkel 2"):
        inspect_file(path, parse_mapping(ARM))


@pytest.mark.parametrize("kind", ["gap", "reordered"])
def test_what_inspect_finds_import_refuses(tmp_path, kind):
    path = csv(tmp_path / "a.csv", damaged(kind))
    report = inspect_file(path)
    text = {"gap": "gap of 2", "reordered": "goes back"}[kind]
    with pytest.raises(RecordingError, match=text):
        import_recording(path, parse_mapping(tomllib.loads(report.mapping)))


def joints_log(tmp_path, torque):
    t, q, _, _ = motion()
    names = {f"q{k + 1}": q[:, k] for k in range(3)} | {f"tau{k + 1}": torque[:, k] for k in range(3)}
    (tmp_path / "m.toml").write_text(
        '[time]\ncolumn = "t"\nunit = "s"\n'
        '[channel."encoder.joint_position"]\ncolumns = ["q1", "q2", "q3"]\nunit = "rad"\n'
        'labels = ["joint1", "joint2", "joint3"]\n'
        '[channel."encoder.joint_torque"]\ncolumns = ["tau1", "tau2", "tau3"]\nunit = "N m"\n'
        'labels = ["joint1", "joint2", "joint3"]\n'
    )
    described_arm = with_joint_effects(described(), JOINTS, "joint_friction")
    save_description(described_arm, tmp_path / "arm.toml")
    return csv(tmp_path / "a.csv", {"t": t, **names})


@pytest.mark.parametrize(
    ("spoil", "text"),
    [
        (lambda x: x, "nothing suspicious"),
        (lambda x: x * [1.0, 1.0, 0.05], "joint3' is 0.05 "),
        (lambda x: x * [1.0, -1.0, 1.0], "joint2' fits the description with its torque turned round"),
    ],
    ids=["right", "current", "sign"],
)
def test_torques_are_compared_with_a_description(tmp_path, spoil, text):
    path = joints_log(tmp_path, spoil(motion()[3]))
    app = typer.Typer()
    app.command()(inspect_command)
    shown = CliRunner().invoke(
        app, [str(path), "--with", str(tmp_path / "m.toml"), "--description", str(tmp_path / "arm.toml")]
    )
    assert shown.exit_code == 0 and text in shown.output


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
