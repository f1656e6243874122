"""ROS 1 and ROS 2 bags and MCAP files, through rosbags (extra ``bags``)."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from smsid.errors import require
from smsid.recording._protobuf import is_protobuf, read_protobuf
from smsid.recording._topics import Topic, columns_of
from smsid.recording.columns import Columns, unreadable

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
