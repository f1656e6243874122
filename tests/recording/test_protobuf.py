"""MCAP files of protobuf messages, written by the format's own libraries."""

from __future__ import annotations

import sys
import tomllib

import numpy as np
import pytest

from smsid.errors import MissingDependencyError, RecordingError
from smsid.recording import import_recording, read_columns
from smsid.recording.inspect import inspect_file
from smsid.recording.mapping import parse_mapping

START = 1_700_000_000_000_000_000  # [ns]


def message_types():
    """Return the classes of a robot's state and a wrench, as a .proto would make them."""
    descriptor_pb2 = pytest.importorskip("google.protobuf.descriptor_pb2", reason="needs the extra protobuf")
    from google.protobuf import descriptor_pool, message_factory, timestamp_pb2

    own = descriptor_pb2.FieldDescriptorProto
    file = descriptor_pb2.FileDescriptorProto(name="robot.proto", package="robot", syntax="proto3")
    file.dependency.append("google/protobuf/timestamp.proto")

    def add(name, *fields):
        made = file.message_type.add(name=name)
        for number, (field, kind, repeated) in enumerate(fields, start=1):
            label = own.LABEL_REPEATED if repeated else own.LABEL_OPTIONAL
            named = kind if isinstance(kind, str) else None
            made.field.add(name=field, number=number, label=label, type_name=named,
                           type=own.TYPE_MESSAGE if named else kind)  # fmt: skip

    add("Joint", ("name", own.TYPE_STRING, False), ("position", own.TYPE_DOUBLE, False))
    add("Vector", *((axis, own.TYPE_DOUBLE, False) for axis in "xyz"))
    add("State", ("timestamp", ".google.protobuf.Timestamp", False), ("joints", ".robot.Joint", True),
        ("temperatures", own.TYPE_FLOAT, True), ("mode", own.TYPE_STRING, False))  # fmt: skip
    add("Wrench", ("force", ".robot.Vector", False))
    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(timestamp_pb2.DESCRIPTOR.serialized_pb)
    pool.Add(file)
    found = message_factory.GetMessageClassesForFiles(["robot.proto"], pool)
    return found["robot.State"], found["robot.Wrench"]


@pytest.fixture
def log(tmp_path):
    writer = pytest.importorskip("mcap_protobuf.writer", reason="needs the extra protobuf")
    state, wrench = message_types()
    with (tmp_path / "a.mcap").open("wb") as stream, writer.Writer(stream) as mcap:
        for k in range(60):
            now = START + k * 10_000_000
            message = state(temperatures=[20.0, 21.0], mode="run")
            message.timestamp.seconds, message.timestamp.nanos = now // 10**9, now % 10**9
            for name, value in (("elbow", np.sin(0.1 * k)), ("wrist", np.cos(0.1 * k))):
                message.joints.add(name=name, position=value)
            mcap.write_message("/joints", message, now + 2_000_000, now + 2_000_000)
            if k % 2 == 0:
                one = wrench()
                one.force.x = 0.5 * k
                mcap.write_message("/wrench", one, now + 2_000_000, now + 2_000_000)
    return tmp_path / "a.mcap"


def test_messages_come_out_by_field_joints_by_name(log):
    columns, k = read_columns(log), np.arange(60)
    np.testing.assert_allclose(columns["/joints.position.wrist"], np.cos(0.1 * k))
    np.testing.assert_allclose(columns["/joints.stamp"], 0.01 * k - 0.002, atol=1e-9)
    np.testing.assert_allclose(columns["/joints.temperatures"], np.tile([20.0, 21.0], (60, 1)))
    np.testing.assert_allclose(columns["/wrench.force.x"], 0.5 * k[::2])  # zeros, which are not written, too
    assert "/joints.mode" not in columns


def test_its_draft_imports(log):
    recording = import_recording(log, parse_mapping(tomllib.loads(inspect_file(log).mapping)))
    assert any(name.endswith("joint_position") for name in recording.channels)
    assert any(name.endswith(".force") for name in recording.channels)


def test_one_cut_short_is_refused(log):
    log.write_bytes(log.read_bytes()[:900])
    with pytest.raises(RecordingError, match=r"cannot be read as (MCAP|a bag)"):
        read_columns(log)


def test_the_missing_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mcap.reader", None)
    (tmp_path / "a.mcap").write_bytes(b"\x89MCAP0\r\n" + b"\x08\x00\x00\x00protobuf")
    with pytest.raises(MissingDependencyError, match=r"smsid\[protobuf\]"):
        read_columns(tmp_path / "a.mcap")
