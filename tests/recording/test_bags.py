"""ROS 1 and 2 bags and MCAP, written by rosbags; Parquet, written by pyarrow."""

from __future__ import annotations

import sys
import tomllib

import numpy as np
import pytest

from smsid.errors import MissingDependencyError, RecordingError
from smsid.recording import import_recording, read_columns
from smsid.recording.inspect import inspect_file
from smsid.recording.mapping import parse_mapping

rosbags = pytest.importorskip("rosbags", reason="needs the extra bags")
from rosbags.rosbag1 import Writer as Writer1  # noqa: E402
from rosbags.rosbag2 import StoragePlugin  # noqa: E402
from rosbags.rosbag2 import Writer as Writer2  # noqa: E402
from rosbags.typesys import Stores, get_typestore  # noqa: E402

START = 1_700_000_000_000_000_000  # [ns]
N = 50


def write(path, store_name, writer, serialize, names=lambda k: ["elbow", "wrist"]):
    store = get_typestore(store_name)
    types = store.types
    with writer as bag:
        joints = bag.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        wrench = bag.add_connection("/wrench", "geometry_msgs/msg/Wrench", typestore=store)
        for k in range(N):
            when = START + k * 2_000_000
            stamp = types["builtin_interfaces/msg/Time"](sec=when // 10**9, nanosec=when % 10**9)
            seq = {"seq": k} if "seq" in types["std_msgs/msg/Header"].__dataclass_fields__ else {}
            header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="", **seq)
            state = types["sensor_msgs/msg/JointState"](
                header=header,
                name=names(k),
                position=np.array([0.1 * k, -0.2 * k]),
                velocity=np.array([1.0, 2.0]),
                effort=np.array([]),
            )
            vector = types["geometry_msgs/msg/Vector3"]
            force = types["geometry_msgs/msg/Wrench"](
                force=vector(x=1.0 * k, y=2.0, z=3.0), torque=vector(x=0.0, y=0.0, z=-1.0 * k)
            )
            late = when + 500_000
            bag.write(joints, late, serialize(store)(state, state.__msgtype__))
            if k % 2 == 0:
                bag.write(wrench, late, serialize(store)(force, force.__msgtype__))
    return path


@pytest.fixture(params=["ros1", "ros2 sqlite", "ros2 mcap"])
def bag(request, tmp_path):
    if request.param == "ros1":
        path = tmp_path / "a.bag"
        return write(path, Stores.ROS1_NOETIC, Writer1(path), lambda s: s.serialize_ros1)
    plugin = StoragePlugin.MCAP if "mcap" in request.param else StoragePlugin.SQLITE3
    path = tmp_path / "folder"
    writer = Writer2(path, version=9, storage_plugin=plugin)
    return write(path, Stores.ROS2_HUMBLE, writer, lambda s: s.serialize_cdr)


def test_topics_come_out_by_field_with_both_clocks(bag):
    columns = read_columns(bag)
    k = np.arange(N)
    np.testing.assert_allclose(columns["/joint_states.position"], np.column_stack([0.1 * k, -0.2 * k]))
    np.testing.assert_allclose(columns["/joint_states.position.wrist"], -0.2 * k)
    np.testing.assert_allclose(columns["/wrench.torque.z"], -1.0 * k[::2])
    np.testing.assert_allclose(columns["/joint_states.time"], 0.002 * k, atol=1e-9)
    np.testing.assert_allclose(columns["/joint_states.stamp"], 0.002 * k - 0.0005, atol=1e-9)
    assert "/joint_states.effort" not in columns and "/wrench.stamp" not in columns


def test_a_bag_becomes_a_recording_of_several_rates(bag):
    mapping = parse_mapping(
        {
            "clock": {
                "encoder": {"column": "/joint_states.stamp", "unit": "s"},
                "hand": {"column": "/wrench.time", "unit": "s"},
            },
            "channel": {
                "encoder.joint_position": {
                    "columns": ["/joint_states.position"], "unit": "rad", "labels": ["elbow", "wrist"],
                },
                "hand.force": {"columns": [f"/wrench.force.{a}" for a in "xyz"], "unit": "N"},
            },
        }
    )  # fmt: skip
    recording = import_recording(bag, mapping)
    assert recording["hand.force"].shape == (N // 2, 3)
    assert recording.resampled(500.0)["encoder.joint_position"].shape[1] == 2
    assert len(recording.provenance["imported"]["sha256"]) == 64


def test_a_missing_topic_is_named_with_those_that_are_there(bag):
    mapping = parse_mapping(
        {
            "time": {"column": "/imu.stamp", "unit": "s"},
            "channel": {"imu.angular_rate": {"columns": ["/imu.gyro"], "unit": "rad/s"}},
        }
    )
    with pytest.raises(RecordingError, match=r"/joint_states\.position"):
        import_recording(bag, mapping)


def test_a_bag_cut_short_is_refused(tmp_path):
    path = tmp_path / "a.bag"
    write(path, Stores.ROS1_NOETIC, Writer1(path), lambda s: s.serialize_ros1)
    (tmp_path / "cut.bag").write_bytes(path.read_bytes()[:3000])
    with pytest.raises(RecordingError, match="cannot be read as a bag"):
        read_columns(tmp_path / "cut.bag")


def test_joints_that_change_order_are_read_by_name(tmp_path):
    path = tmp_path / "a.bag"
    names = lambda k: ["elbow", "wrist"] if k < 9 else ["wrist", "elbow"]  # noqa: E731
    write(path, Stores.ROS1_NOETIC, Writer1(path), lambda s: s.serialize_ros1, names)
    k = np.arange(N)
    elbow = np.where(k < 9, 0.1 * k, -0.2 * k)
    columns = read_columns(path)
    np.testing.assert_allclose(columns["/joint_states.position.elbow"], elbow)
    np.testing.assert_allclose(columns["/joint_states.position"][:, 0], elbow)


def test_publishers_that_share_a_topic_have_times_of_their_own(tmp_path):
    path = tmp_path / "a.bag"
    names = lambda k: ["left", "right"] if k % 5 == 0 else ["elbow", "wrist"]  # noqa: E731
    write(path, Stores.ROS1_NOETIC, Writer1(path), lambda s: s.serialize_ros1, names)
    k = np.arange(N)
    arm, hand = k[k % 5 > 0], k[k % 5 == 0]
    columns = read_columns(path)
    np.testing.assert_allclose(columns["/joint_states.elbow.position.wrist"], -0.2 * arm)
    np.testing.assert_allclose(columns["/joint_states.elbow.stamp"], 0.002 * arm - 0.0005, atol=1e-9)
    np.testing.assert_allclose(columns["/joint_states.left.position"][:, 0], 0.1 * hand)
    np.testing.assert_allclose(columns["/joint_states.left.time"], 0.002 * hand, atol=1e-9)
    recording = import_recording(path, parse_mapping(tomllib.loads(inspect_file(path).mapping)))
    assert len(recording.clocks) == 3  # and the wrench's


@pytest.mark.parametrize(
    ("suffix", "module", "extra"), [(".bag", "rosbags", "bags"), (".parquet", "pyarrow.parquet", "parquet")]
)
def test_a_missing_extra_is_named(tmp_path, monkeypatch, suffix, module, extra):
    monkeypatch.setitem(sys.modules, module, None)
    (tmp_path / f"a{suffix}").write_bytes(b"x")
    with pytest.raises(MissingDependencyError, match=rf"smsid\[{extra}\]"):
        read_columns(tmp_path / f"a{suffix}")


def test_parquet_columns_structures_lists_and_times(tmp_path):
    pa = pytest.importorskip("pyarrow", reason="needs the extra parquet")
    parquet = pytest.importorskip("pyarrow.parquet")
    table = pa.table(
        {
            "t": pa.array(np.array([0, 10**7, 3 * 10**7], dtype="datetime64[ns]")),
            "acc": pa.array([{"x": 1.0, "y": 2}, {"x": 3.0, "y": 4}, {"x": 5.0, "y": 6}]),
            "q": pa.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]),
            "n": pa.array([1, None, 3]),
            "mode": ["a", "b", None],
        }
    )
    parquet.write_table(table, tmp_path / "a.parquet")
    columns = read_columns(tmp_path / "a.parquet")
    np.testing.assert_allclose(columns["t"], [0.0, 0.01, 0.03])
    np.testing.assert_allclose(columns["acc.y"], [2.0, 4.0, 6.0])
    assert columns["q"].shape == (3, 2)
    np.testing.assert_array_equal(columns["n"], [1.0, np.nan, 3.0])
    assert columns["mode"].tolist() == ["a", "b", ""]
    (tmp_path / "cut.parquet").write_bytes((tmp_path / "a.parquet").read_bytes()[:-20])
    with pytest.raises(RecordingError, match="cannot be read as Parquet"):
        read_columns(tmp_path / "cut.parquet")
