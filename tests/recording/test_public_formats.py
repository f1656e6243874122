"""Logs in binary formats as programs write them: each is read, drafted and imported, or refused by name."""

# ruff: noqa: E501 - the tables are read by row
from __future__ import annotations

import tomllib

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from smsid.recording import import_recording
from smsid.recording.inspect import inspect_file
from smsid.recording.mapping import parse_mapping

from .test_matlab_objects import version_7_3

N, RATE = 60, 100.0
T = np.arange(N) / RATE
Q = np.column_stack([np.sin(T + k) for k in range(3)])
TURN = np.column_stack([np.zeros(N), np.zeros(N), np.sin(T / 2), np.cos(T / 2)])  # xyzw
GYRO = np.tile([0.0, 0.0, 1.0], (N, 1))
START = 1_700_000_000_000_000_000  # [ns]


def mat(tree):
    def write(folder):
        savemat(folder / "log.mat", tree)
        return folder / "log.mat"

    return write


def mat_7_3(folder):
    version_7_3(folder / "log.mat", {}, {"t": T, "joint_position": Q.T})
    return folder / "log.mat"


def npz(folder):
    np.savez(folder / "log.npz", t=T, joint_position=Q, gyro=GYRO)
    return folder / "log.npz"


def hdf5(folder):
    with h5py.File(folder / "log.h5", "w") as file:
        file["imu/timestamp_ns"] = START + (1e9 * T).astype(np.int64)
        file["imu/gyro"], file["arm/t"], file["arm/joint_velocity"] = GYRO, T, Q
    return folder / "log.h5"


def parquet(folder):
    pa = pytest.importorskip("pyarrow", reason="needs the extra parquet")
    table = pa.table(
        {"time": (START + 1e9 * T).astype("datetime64[ns]"), "joint_position": [list(row) for row in Q]}
    )
    pytest.importorskip("pyarrow.parquet").write_table(table, folder / "log.parquet")
    return folder / "log.parquet"


def bag(kind, topic, content, ros=2, plugin="SQLITE3"):
    """Write a bag of one topic; ``content`` makes the fields of message k of a type but for its header."""

    def write(folder):
        names = ("rosbag1", "rosbag2", "typesys")
        one, two, typesys = (
            pytest.importorskip(f"rosbags.{n}", reason="needs the extra bags") for n in names
        )
        store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE if ros == 2 else typesys.Stores.ROS1_NOETIC)
        make = {k.rpartition("/")[2]: v for k, v in store.types.items() if k.split("/")[0] in
                ("geometry_msgs", "sensor_msgs", "nav_msgs", "std_msgs")}  # fmt: skip
        make["Time"] = store.types["builtin_interfaces/msg/Time"]
        path = folder / ("log" if ros == 2 else "log.bag")
        writer = (
            two.Writer(path, version=9, storage_plugin=two.StoragePlugin[plugin])
            if ros == 2
            else one.Writer(path)
        )
        serialize = store.serialize_cdr if ros == 2 else store.serialize_ros1
        with writer as out:
            connection = out.add_connection(topic, kind, typestore=store)
            for k in range(N):
                now = START + k * 10_000_000
                stamp = make["Time"](sec=now // 10**9, nanosec=now % 10**9)
                header = make["Header"](stamp=stamp, frame_id="", **({"seq": k} if ros == 1 else {}))
                message = store.types[kind](header=header, **content(make, k))
                out.write(connection, now + 300_000, serialize(message, kind))
        return path

    return write


def vector(make, row, kind="Vector3"):
    return make[kind](*(float(x) for x in row))


def pose(make, k):
    return make["Pose"](position=vector(make, Q[k], "Point"), orientation=vector(make, TURN[k], "Quaternion"))


def imu(make, k):
    still = {
        f"{name}_covariance": np.zeros(9)
        for name in ("orientation", "angular_velocity", "linear_acceleration")
    }
    return {"orientation": vector(make, TURN[k], "Quaternion"), "angular_velocity": vector(make, GYRO[k]),
            "linear_acceleration": vector(make, Q[k]), **still}  # fmt: skip


def odometry(make, k):
    twist = make["Twist"](linear=vector(make, 0 * Q[k]), angular=vector(make, GYRO[k]))
    return {"child_frame_id": "base", "pose": make["PoseWithCovariance"](pose(make, k), np.zeros(36)),
            "twist": make["TwistWithCovariance"](twist, np.zeros(36))}  # fmt: skip


def wrench(make, k):
    return {"wrench": make["Wrench"](force=vector(make, 10 * Q[k]), torque=vector(make, Q[k]))}


def joints(make, k):
    return {"name": ["a", "b", "c"], "position": Q[k], "velocity": np.array([]), "effort": 5 * Q[k]}


def temperature(make, k):
    return {"temperature": 20.0 + 0.01 * k, "variance": 0.0}


SIMULINK = {"logsout": {"time": T, "signals": [{"values": Q, "label": "joint_position", "dimensions": 3.0},
                                               {"values": GYRO, "label": "gyro", "dimensions": 3.0}]}}  # fmt: skip
RUNS = {"run": np.array([(T, Q), (T, 2 * Q)], dtype=[("t", object), ("joint_position", object)])}
FORMATS = {
    "MAT of vectors": (mat({"t": T, "q1": Q[:, 0], "q2": Q[:, 1]}), {"joint_position": 2}),
    "MAT of a structure": (mat({"data": {"time": T, "gyro": GYRO, "comment": "run 7"}}), {"angular_rate": 3}),
    "MAT of an array of structures": (mat(RUNS), {"joint_position": 3}),
    "structure with time of Simulink": (mat(SIMULINK), {"joint_position": 3, "angular_rate": 3}),
    "MAT 7.3": (mat_7_3, {"joint_position": 3}),
    "NPZ": (npz, {"joint_position": 3, "angular_rate": 3}),
    "HDF5 of two clocks": (hdf5, {"angular_rate": 3, "joint_velocity": 3}),
    "Parquet of lists": (parquet, {"joint_position": 3}),
    "JointState, ROS 2": (bag("sensor_msgs/msg/JointState", "/joint_states", joints), {"joint_position": 3, "joint_torque": 3}),
    "JointState, ROS 1": (bag("sensor_msgs/msg/JointState", "/joint_states", joints, 1), {"joint_position": 3, "joint_torque": 3}),
    "Imu, MCAP": (bag("sensor_msgs/msg/Imu", "/imu/data", imu, 2, "MCAP"), {"angular_rate": 3, "attitude": 4}),
    "Odometry": (bag("nav_msgs/msg/Odometry", "/odom", odometry), {"position": 3, "attitude": 4, "angular_rate": 3}),
    "PoseStamped": (bag("geometry_msgs/msg/PoseStamped", "/vicon/base", lambda m, k: {"pose": pose(m, k)}), {"position": 3, "attitude": 4}),
    "WrenchStamped": (bag("geometry_msgs/msg/WrenchStamped", "/ft", wrench), {"force": 3}),
    "a kind without a quantity": (bag("sensor_msgs/msg/Temperature", "/tank/temperature", temperature), {}),
}  # fmt: skip


@pytest.mark.parametrize("kind", FORMATS)
def test_the_draft_imports_with_its_channels(kind, tmp_path):
    write, expected = FORMATS[kind]
    path = write(tmp_path)
    report = inspect_file(path)
    recording = import_recording(path, parse_mapping(tomllib.loads(report.mapping)))
    found = {}
    for name in recording.channels:
        found.setdefault(name.rpartition(".")[2], recording[name].reshape(len(recording[name]), -1).shape[1])
        times = recording.time(name)
        assert (times.size - 1) / (times[-1] - times[0]) == pytest.approx(RATE, rel=1e-4), report.mapping
        assert times.size == N
    assert expected.items() <= found.items(), report.mapping
    assert found
    if "joint_position" in expected:
        name = next(n for n in recording.channels if n.endswith("joint_position"))
        np.testing.assert_allclose(recording[name], Q[:, : expected["joint_position"]], atol=1e-12)
