"""Logs as people publish them: each is read, drafted and imported, or refused with what to do."""

# ruff: noqa: E501 - the tables are read by row
from __future__ import annotations

import tomllib

import numpy as np
import pytest
from scipy.io import savemat

from smsid.errors import RecordingError
from smsid.recording import import_recording, read_columns
from smsid.recording.inspect import inspect_file
from smsid.recording.mapping import parse_mapping

N = 60
T = 0.01 * np.arange(N)


def table(names, columns, delimiter=",", decimal=".", before="", under=""):
    rows = [delimiter.join(cell if isinstance(cell, str) else f"{cell:.12g}".replace(".", decimal) for cell in row)
            for row in zip(*columns, strict=True)]  # fmt: skip
    header = delimiter.join(names) + "\n" if names else ""
    return before + header + under + "\n".join(rows) + "\n"


def joints(count, scale=1.0):
    return [scale * np.sin(T * (k + 1) + k) for k in range(count)]


def unit_quaternion():
    return [0.6 * np.ones(N), np.zeros(N), 0.8 * np.ones(N), np.zeros(N)]


def iso(zone="Z"):
    return [f"2024-05-01T23:59:59.{k // 100:01d}{k % 100:02d}{zone}" for k in range(0, 10 * N, 10)]


def every_second(values):
    return [f"{v:.9g}" if k % 2 == 0 else "" for k, v in enumerate(values)]


SIX = [f"actual_q_{k}" for k in range(6)]
LOGS = {
    "ur rtde": (table(["timestamp", *SIX, *(f"actual_qd_{k}" for k in range(6))], [T, *joints(12)]), 100.0,
                {"log.joint_position": 6, "log.joint_velocity": 6}),
    "ur target": (table(["timestamp", *(f"target_q_{k}" for k in range(6)), *SIX], [T, *joints(12)]), 100.0,
                  {"command.joint_position": 6, "log.joint_position": 6}),
    "franka": (table(["time", *(f"q[{k}]" for k in range(7)), *(f"tau_J[{k}]" for k in range(7))],
                     [T, *joints(14)]), 100.0, {"log.joint_position": 7, "log.joint_torque": 7}),
    "tiago rostopic": (table(['"%time"', *(f'"- arm_{k}_joint_position"' for k in range(1, 8))],
                             [1.7e18 + 1e7 * np.arange(N), *joints(7)]), 100.0, {"log.joint_position": 7}),
    "kinova degrees": (table(["time_ms", *(f"joint{k}_velocity_degs" for k in range(1, 8))],
                             [1e3 * T, *joints(7)]), 100.0, {"log.joint_velocity": 7}),
    "wheels in rpm": (table(["t [s]", *(f"motor_speed_{k}_rpm" for k in range(4))], [T, *joints(4, 100.0)]),
                      100.0, {"log.joint_velocity": 4}),
    "wrench": (table(["Time", "Fx_N", "Fy_N", "Fz_N", "Tx_Nm", "Ty_Nm", "Tz_Nm"], [T, *joints(6)]), 100.0,
               {"log.force": 3, "extra.t": 3}),
    "phone imu": (table(["time", "seconds_elapsed", "z", "y", "x"], [1.7e18 + 1e7 * np.arange(N), T, *joints(3)]),
                  100.0, {"log.position": 3}),
    "imu in camel case": (table(["timeStamp", "accX", "accY", "accZ", "gyroX", "gyroY", "gyroZ"], [T, *joints(6)]),
                          100.0, {"log.acceleration": 3, "log.angular_rate": 3}),
    "deg per second": (table(["t", "wx [deg/s]", "wy [deg/s]", "wz [deg/s]"], [T, *joints(3)]), 100.0,
                       {"log.angular_rate": 3}),
    "scalar first": (table(["t", "qw", "qx", "qy", "qz"], [T, *unit_quaternion()]), 100.0, {"log.attitude": 4}),
    "quaternion by number": (table(["t", "q0", "q1", "q2", "q3"], [T, *unit_quaternion()]), 100.0,
                             {"log.attitude": 4}),
    "px4": (table(["timestamp", "q[0]", "q[1]", "q[2]", "q[3]", "xyz[0]", "xyz[1]", "xyz[2]"],
                  [1e6 + 1e4 * np.arange(N), *unit_quaternion(), *joints(3)]), 100.0, {"log.attitude": 4}),
    "pandas index": (table(["", "time", "tau_1", "tau_2"], [np.arange(N), T, *joints(2)]), 100.0,
                     {"log.joint_torque": 2}),
    "sequence": (table(["seq", "header_stamp_sec", "header_stamp_nanosec", "q1", "q2"],
                       [np.arange(N), np.full(N, 1_700_000_000), 1e7 * np.arange(N), *joints(2)]), 100.0,
                 {"log.joint_position": 2}),
    "iso": (table(["timestamp", "q1", "q2"], [iso(), *joints(2)]), 100.0, {"log.joint_position": 2}),
    "iso with zone": (table(["timestamp", "q1", "q2"], [iso("+02:00"), *joints(2)]), 100.0,
                      {"log.joint_position": 2}),
    "day of year": (table(["SCET", "time", "RW1_speed_rpm", "RW2_speed_rpm"],
                          [[f"2024-122T10:00:0{k // 10}.{k % 10}" for k in range(N)], 0.1 * np.arange(N),
                           *joints(2, 50.0)]), 10.0, {"log.joint_velocity": 2}),
    "time of day over midnight": (table(["time", "q1"], [[("23:59:59" if k < 50 else "00:00:00") +
                                  f".{(50 + k) % 100:02d}" for k in range(N)], *joints(1)]), 100.0,
                                  {"log.joint_position": 1}),
    "date and time": (table(["Date", "Time", "q1"], [["2024-05-01"] * N,
                            [f"10:00:00.{k:02d}" for k in range(N)], *joints(1)]), 100.0,
                      {"log.joint_position": 1}),
    "row of units": (table(["time", "q1", "q2"], [1e3 * T, *joints(2, 50.0)], under="ms,deg,deg\n"), 100.0,
                     {"log.joint_position": 2}),
    "german logger": (table(["Zeit [s]", "Winkel1", "Winkel2"], [T, *joints(2)], ";", ",",
                            "Logger: X12\nDate;2024\nRate 100 Hz\n"), 100.0, {"log.joint_position": 2}),
    "blank cells": (table(["t", "q1", "q2", "tau1", "tau2"], [T, *joints(2), *map(every_second, joints(2))]),
                    100.0, {"log.joint_position": 2, "log2.joint_torque": 2}),
    "text between": (table(["t", "mode", "q1", "q2"], [T, ["idle"] * N, *joints(2)]), 100.0,
                     {"log.joint_position": 2}),
    "one value": (table(["t", "velocity"], [T, *joints(1)]), 100.0, {"extra.velocity": 1}),
    "six positions": (table(["t", *(f"/joint_states/position[{k}]" for k in range(6))], [T, *joints(6)]), 100.0,
                      {"log.joint_position": 6}),
}  # fmt: skip


@pytest.mark.parametrize("kind", LOGS)
def test_the_draft_of_a_public_log_imports(kind, tmp_path):
    text, rate, expected = LOGS[kind]
    path = tmp_path / "log.csv"
    path.write_text(text, encoding="utf-8")
    report = inspect_file(path)
    recording = import_recording(path, parse_mapping(tomllib.loads(report.mapping)))
    found = {name: recording[name].reshape(len(recording[name]), -1).shape[1] for name in recording.channels}
    assert expected.items() <= found.items(), report.mapping
    times = recording.time(next(iter(expected)))
    assert (times.size - 1) / (times[-1] - times[0]) == pytest.approx(rate, rel=1e-4)
    assert times.size == N


def drafted(tmp_path, kind):
    path = tmp_path / "log.csv"
    path.write_text(LOGS[kind][0], encoding="utf-8")
    return import_recording(path, parse_mapping(tomllib.loads(inspect_file(path).mapping)))


def test_units_in_names_and_rows_are_converted(tmp_path):
    np.testing.assert_allclose(drafted(tmp_path, "wheels in rpm")["log.joint_velocity"][:, 1],
                               joints(2, 100.0)[1] * np.pi / 30, atol=1e-9)  # fmt: skip
    np.testing.assert_allclose(drafted(tmp_path, "kinova degrees")["log.joint_velocity"][:, 0],
                               np.radians(joints(1)[0]), atol=1e-9)  # fmt: skip
    np.testing.assert_allclose(drafted(tmp_path, "row of units")["log.joint_position"][:, 1],
                               np.radians(joints(2, 50.0)[1]), atol=1e-9)  # fmt: skip


@pytest.mark.parametrize("kind", ["scalar first", "quaternion by number", "px4"])
def test_the_scalar_of_a_quaternion_is_where_its_name_says(kind, tmp_path):
    np.testing.assert_allclose(drafted(tmp_path, kind)["log.attitude"][0], [0.0, 0.8, 0.0, 0.6])


def test_blank_cells_are_no_samples(tmp_path):
    recording = drafted(tmp_path, "blank cells")
    np.testing.assert_allclose(recording.time("log2"), T[::2])
    np.testing.assert_allclose(recording["log2.joint_torque"][:, 1], joints(2)[1][::2], atol=1e-8)


def test_channels_of_a_source_that_are_blank_in_other_rows_are_refused_with_the_mend(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(LOGS["blank cells"][0], encoding="utf-8")
    one = {name: {"columns": [c], "unit": u} for name, c, u in
           (("arm.joint_position", "q1", "rad"), ("arm.joint_torque", "tau1", "N m"))}  # fmt: skip
    with pytest.raises(RecordingError, match=r"different rows.*arm2\.joint_torque"):
        import_recording(path, parse_mapping({"time": {"column": "t", "unit": "s"}, "channel": one}))


@pytest.mark.parametrize("name", ["wheel_angle", "pos_x", "seq", "count", "V1"])
def test_what_rises_steadily_is_no_clock_unless_so_named(name, tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(table([name, "gyro_x", "gyro_y", "gyro_z"], [0.2 * np.arange(N), *joints(3)]))
    report = inspect_file(path)
    assert report.clocks == ()
    assert "rate = 100.0 # [Hz] guess" in report.mapping
    import_recording(path, parse_mapping(tomllib.loads(report.mapping)))


def test_many_gaps_are_one_sentence(tmp_path):
    path = tmp_path / "log.csv"
    t = T + np.arange(N) // 10
    path.write_text(table(["t", "q1"], [t, *joints(1)]))
    (doubt,) = inspect_file(path).suspicions
    assert doubt.startswith("'t' has 5 gaps; the longest is 1.01 s")


def test_held_samples_are_told(tmp_path):
    path = tmp_path / "log.csv"
    t = 0.01 * np.arange(400)
    path.write_text(table(["t", "q1"], [t, np.sin(np.floor(t * 10 + 1e-9) / 3)]))
    (doubt,) = inspect_file(path).suspicions
    assert "changes only every 10 samples: 10 Hz data in a 100 Hz log" in doubt


def test_structures_of_simulink_and_arrays_of_structures(tmp_path):
    signals = [{"values": np.column_stack(joints(3)), "label": "gyro"}, {"values": joints(1)[0], "label": ""}]
    tree = {"out": {"time": T, "signals": signals}, "run": [{"q": joints(1)[0]}, {"q": joints(2)[1]}]}
    savemat(tmp_path / "log.mat", tree)
    columns = read_columns(tmp_path / "log.mat")
    np.testing.assert_allclose(columns["out.gyro"], np.column_stack(joints(3)))
    np.testing.assert_allclose(columns["run.2.q"].ravel(), joints(2)[1])
    report = inspect_file(tmp_path / "log.mat")
    recording = import_recording(tmp_path / "log.mat", parse_mapping(tomllib.loads(report.mapping)))
    np.testing.assert_allclose(recording["out.angular_rate"], np.column_stack(joints(3)))
