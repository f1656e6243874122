"""Ready maps and readers against logs written here, byte by byte or with the format's own library."""

from __future__ import annotations

import struct
import sys
import tomllib

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

from smsid.cli.app import app
from smsid.errors import MissingDependencyError, RecordingError
from smsid.recording import import_recording
from smsid.recording.inspect import inspect_file
from smsid.recording.mapping import bundled_mappings, load_mapping, parse_mapping
from smsid.recording.readers import read_columns

from .samples import recording


def ulog(path, topics):
    """Write a ULog: ``topics`` gives [us] and fields (name, C type, length, array) by topic."""

    def block(kind, data):
        return struct.pack("<HB", len(data), ord(kind)) + data

    out = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1_000_000)
    out += block("B", bytes(40))
    for name, (_, fields) in topics.items():
        members = [f"{kind}{f'[{n}]' if n > 1 else ''} {field};" for field, kind, n, _ in fields]
        out += block("F", f"{name}:uint64_t timestamp;{''.join(members)}".encode())
    rows = []
    for k, (name, (times, fields)) in enumerate(topics.items()):
        out += block("A", struct.pack("<BH", 0, k) + name.encode())
        for i, t in enumerate(times):
            data = b"".join(np.asarray(values[i], "<f4").tobytes() for *_, values in fields)
            rows.append((t, block("D", struct.pack("<HQ", k, t) + data)))
    path.write_bytes(out + b"".join(raw for _, raw in sorted(rows)))
    return path


def flight(path):
    fast, slow = np.arange(1_500_000, 3_500_000, 5_000), np.arange(1_500_000, 3_500_000, 20_000)
    turn = 0.3 * (slow - slow[0]) * 1e-6
    q = np.column_stack([np.cos(turn / 2), 0 * turn, 0 * turn, np.sin(turn / 2)])
    rate = np.tile([0.0, 0.0, 0.3], (fast.size, 1))
    z = np.linspace(-1.0, -2.0, slow.size)
    local = [(name, "float", 1, z if name == "z" else 0 * z) for name in ("x", "y", "z", "vx", "vy", "vz")]
    return ulog(
        path,
        {
            "vehicle_attitude": (slow, [("q", "float", 4, q)]),
            "vehicle_angular_velocity": (fast, [("xyz", "float", 3, rate)]),
            "vehicle_local_position": (slow, local),
        },
    )


def test_a_ulog_of_px4_by_its_ready_map(tmp_path):
    pytest.importorskip("pyulog", reason="needs the extra px4")
    found = import_recording(flight(tmp_path / "a.ulg"), "px4", check=False)
    assert found["gyro.angular_rate"].shape == (400, 3) and found["estimate.position"][-1, 2] == -2.0
    assert found.time("gyro")[:2] == pytest.approx([0.5, 0.505])
    last = 0.3 * 1.98 / 2
    assert found["pose.attitude"][-1] == pytest.approx([0, 0, np.sin(last), np.cos(last)], abs=1e-6)
    assert "imu.acceleration" not in found  # this log has none


def test_a_ulog_cut_short_and_the_missing_extra_are_named(tmp_path, monkeypatch):
    (tmp_path / "bad.ulg").write_bytes(b"ULog but no log")
    with pytest.raises(RecordingError, match="ULog"):
        read_columns(tmp_path / "bad.ulg")
    monkeypatch.setitem(sys.modules, "pyulog", None)
    with pytest.raises(MissingDependencyError, match=r"smsid\[px4\]"):
        read_columns(tmp_path / "bad.ulg")


@pytest.mark.parametrize("delimiter", [" ", ","])
def test_rtde_of_universal_robots(delimiter, tmp_path):
    t = np.arange(0.0, 1.0, 0.008)
    names = ["timestamp"] + [
        f"{what}_{k}" for what in ("actual_q", "actual_qd", "actual_current") for k in range(6)
    ]
    q = np.column_stack([np.sin(t + k) for k in range(6)])
    rate = np.column_stack([np.cos(t + k) for k in range(6)])
    table = np.column_stack([t, q, rate, 0.1 * q])
    lines = [delimiter.join(names), *(delimiter.join(f"{x:.9f}" for x in row) for row in table)]
    (tmp_path / "ur.csv").write_text("\n".join(lines) + "\n")
    found = import_recording(tmp_path / "ur.csv", "ur_rtde")
    assert found.labels["joint"][2] == "elbow_joint"
    assert found["joints.joint_velocity"] == pytest.approx(rate, abs=1e-8)
    assert found.unit("extra.motor_current") == "A" and "extra.target_moment" not in found


def joint_states(path, topic, names):
    rosbag2, typesys = (
        pytest.importorskip(f"rosbags.{n}", reason="needs the extra bags") for n in ("rosbag2", "typesys")
    )
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    kind = "sensor_msgs/msg/JointState"
    make, header, time = (
        store.types[n] for n in (kind, "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    with rosbag2.Writer(path, version=9) as writer:
        connection = writer.add_connection(topic, kind, typestore=store)
        for k in range(50):
            stamp = 1_700_000_000_000_000_000 + k * 10_000_000
            at = header(stamp=time(sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id="")
            q = np.sin(0.01 * k + np.arange(len(names)))
            rate = np.cos(0.01 * k + np.arange(len(names)))
            message = make(header=at, name=names, position=q, velocity=rate, effort=0 * q)
            writer.write(connection, stamp, store.serialize_cdr(message, kind))
    return path


@pytest.mark.parametrize(
    ("name", "topic", "joints"),
    [
        ("tiago", "/joint_states", ["head_1_joint", *(f"arm_{k}_joint" for k in range(1, 8))]),
        ("kinova", "/my_gen3/joint_states", [f"joint_{k}" for k in range(1, 8)]),
        ("joint_states", "/joint_states", ["a", "b"]),
    ],
)
def test_bags_of_joint_states(name, topic, joints, tmp_path):
    found = import_recording(joint_states(tmp_path / "bag", topic, joints), name)
    first = joints.index("arm_1_joint") if name == "tiago" else 0
    assert found["joints.joint_position"][0, 0] == pytest.approx(np.sin(first))
    assert found.time("joints")[1] == pytest.approx(0.01)


def test_a_bag_of_franka_ros(tmp_path):
    rosbag1, typesys = (
        pytest.importorskip(f"rosbags.{n}", reason="needs the extra bags") for n in ("rosbag1", "typesys")
    )
    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC)
    kind = "franka_msgs/msg/FrankaState"
    definition = "std_msgs/Header header\nfloat64[6] cartesian_collision\nfloat64[7] q\nfloat64[7] dq\n"
    definition += (
        "float64[7] tau_J\nfloat64[16] O_T_EE\nfloat64 control_command_success_rate\nuint8 robot_mode\n"
    )
    store.register(typesys.get_types_from_msg(definition, kind))
    make, header, time = (
        store.types[n] for n in (kind, "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    with rosbag1.Writer(tmp_path / "a.bag") as writer:
        connection = writer.add_connection("/franka_state_controller/franka_states", kind, typestore=store)
        for k in range(60):
            stamp = 1_700_000_000_000_000_000 + k * 1_000_000
            at = header(seq=k, stamp=time(sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id="")
            q, rate = np.sin(0.001 * k + np.arange(7.0)), np.cos(0.001 * k + np.arange(7.0))
            message = make(at, np.zeros(6), q, rate, 10 * q, np.eye(4).ravel(), 1.0, 2)
            writer.write(connection, stamp + 200_000, store.serialize_ros1(message, kind))
    found = import_recording(tmp_path / "a.bag", "franka")
    assert found.labels["joint"] == tuple(f"panda_joint{k}" for k in range(1, 8))
    assert found["joints.joint_torque"][5] == pytest.approx(10 * np.sin(0.005 + np.arange(7.0)))
    assert found.time("joints")[1] - found.time("joints")[0] == pytest.approx(1e-3)


def test_every_ready_map_loads_and_is_offered():
    shown = " ".join(CliRunner().invoke(app, ["import", "--help"]).output.split())
    for name in bundled_mappings():
        load_mapping(name)
        assert name in shown
    with pytest.raises(RecordingError, match=r"px4.*tiago.*ur_rtde"):
        load_mapping("nothing")


def test_a_csv_without_header_has_numbered_columns(tmp_path, caplog):
    rows = [f"{0.01 * k:.2f},{np.sin(k):.6f},{np.cos(k):.6f}" for k in range(50)]
    (tmp_path / "bare.csv").write_text("\n".join(rows) + "\n")
    columns = read_columns(tmp_path / "bare.csv")
    assert list(columns) == ["column1", "column2", "column3"] and columns["column2"].size == 50
    assert "no header" in caplog.text


def test_simulink_logs_and_arrays_of_structures_in_mat_7_3(tmp_path):
    path = tmp_path / "log.mat"
    t = np.arange(0.0, 1.0, 0.1)
    with h5py.File(path, "w", userblock_size=512) as file:
        file["out/time"] = t[None, :]
        refs = file.create_group("#refs#")
        for k, label in enumerate(("torque", "angle")):
            refs[f"v{k}"] = np.vstack([t, (k + 2) * t])
            refs[f"l{k}"] = np.array([[ord(c)] for c in label], dtype=np.uint16)
            refs[f"l{k}"].attrs["MATLAB_class"] = np.bytes_("char")
        for field, letter in (("values", "v"), ("label", "l")):
            file.create_dataset(f"out/signals/{field}", (2, 1), dtype=h5py.ref_dtype)
            for k in range(2):
                file[f"out/signals/{field}"][k, 0] = refs[f"{letter}{k}"].ref
    with path.open("rb+") as stream:
        stream.write(b"MATLAB 7.3 MAT-file, made for a test".ljust(124) + b"\x00\x02IM")
    columns = read_columns(path)
    assert sorted(columns) == ["out.angle", "out.time", "out.torque"]
    assert columns["out.angle"] == pytest.approx(np.column_stack([t, 3 * t]))


def test_an_mcap_comes_back_to_the_nanosecond(tmp_path):
    pytest.importorskip("rosbags", reason="needs the extra bags")
    from smsid.recording.tables import mcap_mapping, save_mcap

    t = np.arange(0.0, 0.5, 0.005)
    before = recording(51).with_channels({"hand.force": (t, np.column_stack([t, t**2, -t]))})
    save_mcap(before, tmp_path / "a.mcap")
    after = import_recording(
        tmp_path / "a.mcap", parse_mapping(tomllib.loads(mcap_mapping(before))), check=False
    )
    assert set(after.channels) == set(before.channels) and after.labels["joint"] == before.labels["joint"]
    first = min(before.time(name)[0] for name in before.channels)
    for name in before.channels:
        assert after.time(name) + first == pytest.approx(before.time(name), abs=1e-9)
        np.testing.assert_array_equal(after[name].reshape(before[name].shape), before[name])


def test_a_telemetry_table_with_calendar_times_and_blank_cells_needs_no_map(tmp_path):
    rates = [f"/SAT/ADCS/gyro_rate_{axis}" for axis in "xyz"]
    lines = ["\t".join(["Generation Time", *rates, "/SAT/EPS/volts", "/SAT/MODE"])]
    for k in range(100):
        volts = f"{28 + 0.01 * k:.2f}" if k % 10 == 0 else ""
        lines.append(f"2026-03-01T12:00:{0.1 * k:06.3f}Z\t{0.01 * k:.4f}\t0\t0.05\t{volts}\tNOMINAL")
    (tmp_path / "tm.tsv").write_text("\n".join(lines) + "\n")
    drafted = inspect_file(tmp_path / "tm.tsv").mapping
    found = import_recording(tmp_path / "tm.tsv", parse_mapping(tomllib.loads(drafted)))
    assert found["log.angular_rate"].shape == (100, 3) and found.time("log")[-1] == pytest.approx(9.9)
    (volts,) = (name for name in found.channels if "volts" in name)
    assert found[volts].shape == (10,) and found.time(volts)[1] == pytest.approx(1.0)


def test_dates_are_seconds_whatever_a_mapping_says(tmp_path):
    rows = "".join(f"2026-11-27T01:00:{k // 10:02d}.{k % 10}00Z,{0.1 * k}\n" for k in range(60))
    (tmp_path / "log.csv").write_text(f"UTC,x\n{rows}")
    text = '[time]\ncolumn = "UTC"\nunit = "{}"\n[channel."extra.x"]\ncolumns = ["x"]\nunit = "1"\n'
    (tmp_path / "s.toml").write_text(text.format("s"))
    (tmp_path / "ms.toml").write_text(text.format("ms"))
    (tmp_path / "second.toml").write_text(text.format("second"))
    import_recording(tmp_path / "log.csv", tmp_path / "second.toml")
    found = import_recording(tmp_path / "log.csv", tmp_path / "s.toml")
    assert np.ptp(found.time()) == pytest.approx(5.9)
    with pytest.raises(RecordingError, match="read in s, not in ms"):
        import_recording(tmp_path / "log.csv", tmp_path / "ms.toml")
