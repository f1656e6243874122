"""ROS 1 and ROS 2 bags and MCAP files, through rosbags (extra ``bags``)."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smsid.errors import RecordingError, require
from smsid.recording.columns import Columns

CLOCKS = (".time", ".stamp")
LARGEST_MESSAGE = 4096
"""Numbers of a message beyond which it is no signal: images, point clouds."""


def is_bag_folder(path: Path) -> bool:
    """Tell whether a path is the folder of a ROS 2 bag."""
    return path.is_dir() and (path / "metadata.yaml").is_file()


def read_bag(path: Path) -> Columns:
    """Read the numbers of every topic of a bag; every topic has its own clocks.

    Columns are called ``<topic>.<field>.<field>``, as in ``/imu.linear_acceleration.x``; an array of fixed
    length makes (N, length). ``<topic>.time`` is when each message was recorded, ``<topic>.stamp`` what its
    header says, both in seconds since the bag's first message. Joints come by name as well:
    ``/joint_states.position.elbow``, whatever their order in each message; sets of joints that
    share a topic get columns and times apart, under the name of their first, as in
    ``/joint_states.finger.position``. Arrays whose length varies and messages of more than `LARGEST_MESSAGE`
    numbers are left out.

    Raises:
        MissingDependencyError: rosbags is not installed.
        RecordingError: no bag, cut short, damaged, without messages.
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
    columns = Columns()
    for topic in topics.values():
        columns.update(topic.columns())
    if not columns:
        raise RecordingError(
            f"{path} has no messages with numbers.", advice="Is it the right bag?", path=str(path)
        )
    columns.units.update({name: "s" for name in columns if name.endswith(CLOCKS)})
    return columns


class _Topic:
    """The messages of one topic, gathered field by field."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.fields: dict[str, list[Any]] = {}
        self.times: list[float] = []
        self.stamps: list[float] = []
        self.by_name: dict[str, list[tuple[float, float, tuple[str, ...], Any]]] = {}
        self.skipped = False

    def add(self, time: float, start: int, message: Any) -> None:
        values: dict[str, Any] = {}
        _walk("", message, values)
        if sum(np.size(v) for v in values.values()) > LARGEST_MESSAGE:
            self.skipped = True
            return
        own = time
        header = getattr(message, "header", None)
        if header is not None:
            stamp = header.stamp
            own = (int(stamp.sec) * 10**9 + int(stamp.nanosec) - start) * 1e-9
            self.stamps.append(own)
        self.times.append(time)
        names = _names(message)
        for key, value in values.items():
            if names and np.shape(value) == (len(names),):
                self.by_name.setdefault(key, []).append((time, own, names, value))
            else:
                self.fields.setdefault(key, []).append(value)

    def columns(self) -> dict[str, NDArray[Any]]:
        if self.skipped or not self.times:
            return {}
        found: dict[str, NDArray[Any]] = {}
        stamped = _stamps_count(self.stamps, len(self.times))
        sets = list(dict.fromkeys(names for rows in self.by_name.values() for _, _, names, _ in rows))
        groups = _sets_of_names(sets)
        if len(groups) < 2:
            found[f"{self.name}.time"] = np.array(self.times)
            if stamped:
                found[f"{self.name}.stamp"] = np.array(self.stamps)
        for members in groups:
            # Several publishers: each set of names has times of its own.
            where = self.name if len(groups) == 1 else f"{self.name}.{members[0]}"
            found |= self._named(where, members, stamped)
        for key, values in self.fields.items():
            if len(values) != len(self.times) or len({np.shape(v) for v in values}) != 1:
                continue
            array = np.array(values, dtype=np.float64)
            if array.size:
                found[f"{self.name}.{key}"] = array
        return found

    def _named(self, where: str, members: tuple[str, ...], stamped: bool) -> dict[str, NDArray[Any]]:
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


def _stamps_count(stamps: list[float], messages: int) -> bool:
    """Tell whether the headers' stamps are times: one for every message, and not left at zero."""
    return len(stamps) == messages and (messages < 2 or len(set(stamps)) > 1)


def _sets_of_names(listed: list[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Keep one order of each set of names, the first."""
    found: dict[frozenset[str], tuple[str, ...]] = {}
    for names in listed:
        found.setdefault(frozenset(names), names)
    return list(found.values())


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


def _names(message: Any) -> tuple[str, ...]:
    names = getattr(message, "name", ())
    texts = isinstance(names, list | tuple) and all(isinstance(n, str) for n in names)
    return tuple(names) if texts else ()
