"""ROS 1 and ROS 2 bags and MCAP files, through rosbags (extra ``bags``)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smsid.errors import RecordingError, SmsidError, require

LARGEST_MESSAGE = 4096
"""Numbers of a message beyond which it is no signal: images, point clouds."""


def is_bag_folder(path: Path) -> bool:
    """Tell whether a path is the folder of a ROS 2 bag."""
    return path.is_dir() and (path / "metadata.yaml").is_file()


def read_bag(path: Path) -> dict[str, NDArray[Any]]:
    """Read the numbers of every topic of a bag; every topic has its own clocks.

    Columns are called ``<topic>.<field>.<field>``, as in ``/imu.linear_acceleration.x``; an array of fixed
    length makes (N, length). ``<topic>.time`` is when each message was recorded, ``<topic>.stamp`` what its
    header says, both in seconds since the bag's first message. Joints come by name as well:
    ``/joint_states.position.elbow``. Arrays whose length varies and messages of more than `LARGEST_MESSAGE`
    numbers are left out.

    Raises:
        MissingDependencyError: rosbags is not installed.
        RecordingError: no bag, cut short or damaged, without messages, or a topic whose names of joints
        change.
    """
    require("rosbags", "bags")
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    topics: dict[str, _Topic] = {}
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            start = reader.start_time
            for connection, when, raw in reader.messages():
                topic = topics.setdefault(connection.topic, _Topic(connection.topic))
                if not topic.skipped:
                    topic.add((when - start) * 1e-9, start, reader.deserialize(raw, connection.msgtype))
    except SmsidError:
        raise
    except (
        Exception
    ) as error:  # rosbags raises its own errors, struct.error, KeyError, ... depending on the place
        size = path.stat().st_size if path.is_file() else 0
        raise RecordingError(
            f"{path} ({size} bytes) cannot be read as a bag: {error}.",
            advice="It is cut short or damaged (try `rosbag reindex` or `ros2 bag reindex`), or its "
            "messages are of "
            "a type it does not define.",
            path=str(path),
        ) from error
    columns: dict[str, NDArray[Any]] = {}
    for topic in topics.values():
        columns |= topic.columns()
    if not columns:
        raise RecordingError(
            f"{path} has no messages with numbers.", advice="Is it the right bag?", path=str(path)
        )
    return columns


class _Topic:
    """The messages of one topic, gathered field by field."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.fields: dict[str, list[Any]] = {}
        self.times: list[float] = []
        self.stamps: list[float] = []
        self.labels: tuple[str, ...] | None = None
        self.skipped = False

    def add(self, time: float, start: int, message: Any) -> None:
        values: dict[str, Any] = {}
        _walk("", message, values)
        if sum(np.size(v) for v in values.values()) > LARGEST_MESSAGE:
            self.skipped = True
            return
        header = getattr(message, "header", None)
        if header is not None:
            stamp = header.stamp
            self.stamps.append((int(stamp.sec) * 10**9 + int(stamp.nanosec) - start) * 1e-9)
        labels = _names(message)
        if self.labels is None:
            self.labels = labels
        elif labels != self.labels:
            raise RecordingError(
                f"Topic '{self.name}' names {', '.join(labels)} at {time:.6g} s, and "
                f"{', '.join(self.labels)} before.",
                advice="Record each set of joints on a topic of its own.",
                topic=self.name,
                time=time,
            )
        self.times.append(time)
        for key, value in values.items():
            self.fields.setdefault(key, []).append(value)

    def columns(self) -> dict[str, NDArray[Any]]:
        if self.skipped or not self.times:
            return {}
        found: dict[str, NDArray[Any]] = {f"{self.name}.time": np.array(self.times)}
        if len(self.stamps) == len(self.times):
            found[f"{self.name}.stamp"] = np.array(self.stamps)
        for key, values in self.fields.items():
            if len(values) != len(self.times) or len({np.shape(v) for v in values}) != 1:
                continue
            array = np.array(values, dtype=np.float64)
            if array.size == 0:
                continue
            found[f"{self.name}.{key}"] = array
            if array.ndim == 2 and self.labels and array.shape[1] == len(self.labels):
                found |= {f"{self.name}.{key}.{n}": array[:, k] for k, n in enumerate(self.labels)}
        return found


def _walk(prefix: str, message: Any, into: dict[str, Any]) -> None:
    for key in getattr(message, "__dataclass_fields__", {}):
        if key in ("header", "__msgtype__"):
            continue
        value = getattr(message, key)
        name = f"{prefix}{key}"
        if isinstance(value, bool | int | float | np.number):
            into[name] = float(value)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
            into[name] = value.astype(np.float64)
        elif hasattr(value, "__dataclass_fields__"):
            _walk(f"{name}.", value, into)


def _names(message: Any) -> tuple[str, ...]:
    names = getattr(message, "name", ())
    texts = isinstance(names, list | tuple) and all(isinstance(n, str) for n in names)
    return tuple(names) if texts else ()
