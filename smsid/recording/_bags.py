"""ROS 1 and ROS 2 bags and MCAP files, through rosbags (extra ``bags``)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smsid.errors import require
from smsid.recording._columns import Columns, unreadable, without_samples

DAMAGED_BAG = (
    "It is cut short or damaged (try `rosbag reindex` or `ros2 bag reindex`), or its messages are of a type "
    "it does not define."
)


def is_bag_folder(path: Path) -> bool:
    """Tell whether a path is the folder of a ROS 2 bag."""
    return path.is_dir() and (path / "metadata.yaml").is_file()


def read_bag(path: Path) -> Columns:
    """Read the numbers of every topic of a bag; every topic has its own clocks.

    An MCAP of protobuf is read by `read_protobuf`.

    Columns are called ``<topic>.<field>.<field>``, as in ``/imu.linear_acceleration.x``; an array of fixed
    length makes (N, length). ``<topic>.time`` is when each message was recorded, ``<topic>.stamp`` what its
    header says, both in seconds since the bag's first message. Joints come by name as well:
    ``/joint_states.position.elbow``, whatever their order in each message; sets of joints that
    share a topic get columns and times apart, under the name of their first, as in
    ``/joint_states.finger.position``. Arrays whose length varies and messages of more numbers
    than a signal has are left out.

    Raises:
        MissingDependencyError: rosbags is not installed.
        RecordingError: no bag, cut short, damaged, without messages.
    """
    if is_protobuf(path):
        return read_protobuf(path)
    require("rosbags", "bags")
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    topics: dict[str, Topic] = {}
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            start = reader.start_time
            for connection, when, raw in reader.messages():
                topic = topics.setdefault(connection.topic, Topic(connection.topic))
                if not topic.skipped:
                    message = reader.deserialize(raw, connection.msgtype)
                    values: dict[str, Any] = {}
                    _walk("", message, values)
                    topic.add((when - start) * 1e-9, _stamp(message, start), values, _names(message))
    except Exception as error:  # rosbags raises its own, struct.error, KeyError, ... depending on the place
        raise unreadable(path, "a bag", error, DAMAGED_BAG) from error
    return columns_of(topics.values(), path)


def _walk(prefix: str, message: Any, into: dict[str, Any]) -> None:
    # fields() leaves out the constants of a message's definition, which are no signals.
    for field in fields(message):
        key = field.name
        if key in ("header", "__msgtype__"):
            continue
        value = getattr(message, key)
        name = f"{prefix}{key}"
        if isinstance(value, bool | int | float | np.number):
            into[name] = float(value)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
            into[name] = value.astype(np.float64)
        elif is_dataclass(value):
            _walk(f"{name}.", value, into)


def _stamp(message: Any, start: int) -> float | None:
    header = getattr(message, "header", None)
    if header is None:
        return None
    return (int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec) - start) * 1e-9


def _names(message: Any) -> tuple[str, ...]:
    names = getattr(message, "name", ())
    texts = isinstance(names, list | tuple) and all(isinstance(n, str) for n in names)
    return tuple(names) if texts else ()


CLOCKS = (".time", ".stamp")
LARGEST_MESSAGE = 4096
"""Numbers of a message beyond which it is no signal: images, point clouds."""


def columns_of(topics: Iterable[Topic], path: Path) -> Columns:
    """Return the columns of all topics of a file; raises `RecordingError` if there are none."""
    columns = Columns()
    for topic in topics:
        columns.update(topic.columns())
    if not columns:
        raise without_samples(path, "messages with numbers", "Is it the right bag?")
    columns.units.update({name: "s" for name in columns if name.endswith(CLOCKS)})
    return columns


class Topic:
    """The messages of one topic, gathered field by field."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.fields: dict[str, list[Any]] = {}
        self.times: list[float] = []
        self.stamps: list[float] = []
        self.by_name: dict[str, list[tuple[float, float, tuple[str, ...], Any]]] = {}
        self.skipped = False

    def add(
        self, time: float, stamp: float | None, values: dict[str, Any], names: tuple[str, ...] = ()
    ) -> None:
        """Add the numbers of a message that was recorded at a time and has a stamp of its own, or none [s].

        ``names`` are those of the elements of arrays as long.
        """
        if sum(np.size(v) for v in values.values()) > LARGEST_MESSAGE:
            self.skipped = True
            return
        own = time if stamp is None else stamp
        if stamp is not None:
            self.stamps.append(stamp)
        self.times.append(time)
        for key, value in values.items():
            if names and np.shape(value) == (len(names),):
                self.by_name.setdefault(key, []).append((time, own, names, value))
            else:
                self.fields.setdefault(key, []).append(value)

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return the columns of the topic, (N,) each, empty if its messages are no signals."""
        if self.skipped or not self.times:
            return {}
        found: dict[str, NDArray[Any]] = {}
        # the headers' stamps are times where every message has one and they are not left at zero
        messages = len(self.times)
        stamped = len(self.stamps) == messages and (messages < 2 or len(set(self.stamps)) > 1)
        sets: dict[frozenset[str], tuple[str, ...]] = {}  # one order of each, the first
        for _, _, names, _ in (row for rows in self.by_name.values() for row in rows):
            sets.setdefault(frozenset(names), names)
        groups = list(sets.values())
        if len(groups) < 2:
            found[f"{self.name}.time"] = np.array(self.times)
            if stamped:
                found[f"{self.name}.stamp"] = np.array(self.stamps)
        for members in groups:
            # Several publishers: each set of names has times of its own.
            where = self.name if len(groups) == 1 else f"{self.name}.{members[0]}"
            found |= self._columns_of_names(where, members, stamped)
        for key, values in self.fields.items():
            if len(values) != len(self.times) or len({np.shape(v) for v in values}) != 1:
                continue
            array = np.array(values, dtype=np.float64)
            if array.size:
                found[f"{self.name}.{key}"] = array
        return found

    def _columns_of_names(
        self, where: str, members: tuple[str, ...], stamped: bool
    ) -> dict[str, NDArray[Any]]:
        """Give the arrays of one set of names, (N, names) in the order of its first message."""
        found: dict[str, NDArray[Any]] = {}
        for key, rows in self.by_name.items():
            own = [row for row in rows if set(row[2]) == set(members)]
            if not own:
                continue
            if f"{where}.time" not in found and where != self.name:
                found[f"{where}.time"] = np.array([row[0] for row in own])
                if stamped:
                    found[f"{where}.stamp"] = np.array([row[1] for row in own])
            array = np.array([[row[3][row[2].index(name)] for name in members] for row in own])
            times = len(self.times) if where == self.name else found[f"{where}.time"].size
            if array.shape[0] != times:
                continue  # a field that only some messages fill
            found[f"{where}.{key}"] = array
            found |= {f"{where}.{key}.{name}": array[:, k] for k, name in enumerate(members)}
        return found


TAIL = 1 << 16
"""Bytes at either end of a file in which the encodings of its schemas stand."""


def is_protobuf(path: Path) -> bool:
    """Tell whether the messages of an MCAP file are protobuf."""
    if path.suffix != ".mcap" or not path.is_file():
        return False
    with path.open("rb") as stream:
        ends = stream.read(TAIL)
        stream.seek(max(path.stat().st_size - TAIL, 0))
        ends += stream.read()
    return b"\x08\x00\x00\x00protobuf" in ends and b"\x07\x00\x00\x00ros2msg" not in ends


def read_protobuf(path: Path) -> Columns:
    """Read the numbers of every topic of an MCAP file of protobuf messages; columns are called as in bags.

    A field of type Timestamp is the message's own time, ``<topic>.stamp``. Elements of a repeated message
    that have a ``name`` come by it, as ``/joints.position.elbow``.

    Raises:
        MissingDependencyError: mcap or mcap-protobuf-support is not installed.
        RecordingError: cut short, damaged, without messages.
    """
    reader = require("mcap.reader", "protobuf")
    decoder = require("mcap_protobuf.decoder", "protobuf")
    topics: dict[str, Topic] = {}
    start: int | None = None
    try:
        with path.open("rb") as stream:
            file = reader.make_reader(stream, decoder_factories=[decoder.DecoderFactory()])
            for _, channel, message, content in file.iter_decoded_messages():
                begin = int(message.log_time) if start is None else start
                start = begin
                topic = topics.setdefault(channel.topic, Topic(channel.topic))
                if not topic.skipped:
                    values: dict[str, Any] = {}
                    stamp, names = _walk_protobuf("", content, values)
                    own = None if stamp is None else (stamp - begin) * 1e-9
                    topic.add((message.log_time - begin) * 1e-9, own, values, names)
    except Exception as error:  # mcap raises its own errors, struct.error, DecodeError, ...
        raise unreadable(path, "MCAP", error, "It is cut short or damaged (try `mcap recover`).") from error
    return columns_of(topics.values(), path)


def _walk_protobuf(prefix: str, message: Any, into: dict[str, Any]) -> tuple[int | None, tuple[str, ...]]:
    """Add the numbers of a message by dotted name; return its stamp [ns] and the names of array elements."""
    stamp: int | None = None
    names: tuple[str, ...] = ()
    for field in message.DESCRIPTOR.fields:
        value: Any = getattr(message, field.name)
        name = f"{prefix}{field.name}"
        if not isinstance(value, int | float | bool | str | bytes) and hasattr(value, "append"):
            rows: list[Any] = list(value)
            if rows and field.message_type is not None:
                each: list[dict[str, Any]] = [{} for _ in rows]
                for row, own in zip(rows, each, strict=True):
                    _walk_protobuf("", row, own)
                if all(isinstance(getattr(row, "name", None), str) for row in rows):
                    names = tuple(row.name for row in rows)
                into |= {f"{prefix}{k}" if names else f"{name}.{k}": np.array([own[k] for own in each])
                         for k in each[0] if all(k in own for own in each)}  # fmt: skip
            elif rows and isinstance(rows[0], str):
                names = tuple(map(str, rows)) if field.name in ("name", "names") else names
            elif rows and isinstance(rows[0], int | float | bool):
                into[name] = np.array(rows, dtype=np.float64)
        elif field.message_type is not None:
            if field.message_type.full_name == "google.protobuf.Timestamp":
                if message.HasField(field.name) and stamp is None:
                    stamp = int(value.seconds) * 10**9 + int(value.nanos)
            else:
                inner, _ = _walk_protobuf(f"{name}.", value, into)
                stamp = inner if stamp is None else stamp
        elif isinstance(value, int | float | bool) and field.enum_type is None:
            into[name] = float(value)
    return stamp, names
