"""Recordings as MCAP, messages of ROS 2, with the mapping that brings them back."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from smsid._files import atomic_path
from smsid.errors import require
from smsid.recording.recording import Recording
from smsid.recording.tables import labels_of, mapping_text

JOINTS = MappingProxyType(
    {
        "joint_position": "position",
        "joint_velocity": "velocity",
        "joint_torque": "effort",
        "wheel_rate": "velocity",
        "wheel_torque": "effort",
    }
)
"""The field of a JointState that a quantity goes to."""


def save_mcap(recording: Recording, path: str | os.PathLike[str]) -> Path:
    """Write a recording as one MCAP file; it appears whole or not at all.

    Every channel is a topic ``/<source>/<quantity>``: joints and wheels ``sensor_msgs/JointState`` with their
    names, all else ``std_msgs/Float64MultiArray`` in the channel's unit. Times are whole nanoseconds since
    the first sample of all.

    Raises:
        MissingDependencyError: rosbags is not installed (extra ``bags``).
    """
    require("rosbags", "bags")
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    start = min(float(recording.dataset[clock].values[0]) for clock in recording.clocks)
    with (
        atomic_path(Path(path)) as temporary,
        tempfile.TemporaryDirectory(dir=Path(temporary).parent) as folder,
    ):
        bag = Path(folder) / "bag"
        with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            rows = []
            for channel in recording.channels:
                kind = _kind(channel)
                topic = writer.add_connection(_topic(channel), kind, typestore=store)
                times = np.round((recording.time(channel) - start) * 1e9).astype(np.int64).tolist()
                values = np.ascontiguousarray(recording[channel].reshape(len(times), -1))
                make = _messages(store, recording, channel)
                rows += [(t, topic, kind, make, t, row) for t, row in zip(times, values, strict=True)]
            for t, topic, kind, make, stamp, row in sorted(rows, key=lambda r: r[0]):
                writer.write(topic, t, store.serialize_cdr(make(stamp, row), kind))
        next(bag.glob("*.mcap")).replace(temporary)
    return Path(path)


def mcap_mapping(recording: Recording) -> str:
    """Write the mapping (TOML) with which `import_recording` reads what `save_mcap` writes."""
    columns = {}
    clocks: dict[str, dict[str, str]] = {}
    for channel in recording.channels:
        source, _, quantity = channel.partition(".")
        columns[channel] = [f"{_topic(channel)}.{JOINTS.get(quantity, 'data')}"]
        clocks.setdefault(source, {"column": f"{_topic(channel)}.time", "unit": "s"})
    return mapping_text(recording, columns, {"clock": clocks})


def _kind(channel: str) -> str:
    joints = channel.partition(".")[2] in JOINTS
    return "sensor_msgs/msg/JointState" if joints else "std_msgs/msg/Float64MultiArray"


def _topic(channel: str) -> str:
    return f"/{channel.replace('.', '/')}"


def _messages(store: Any, recording: Recording, channel: str) -> Any:
    """Return what makes a message of a stamp [ns] and a row (k,)."""
    kinds = store.types
    if _kind(channel).endswith("MultiArray"):
        layout = kinds["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
        make = kinds["std_msgs/msg/Float64MultiArray"]
        return lambda stamp, row: make(layout=layout, data=row)
    field = JOINTS[channel.partition(".")[2]]
    joint, header, time = (
        kinds[name]
        for name in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    empty = dict.fromkeys(("position", "velocity", "effort"), np.zeros(0))
    size = int(np.prod(recording[channel].shape[1:]))
    names = labels_of(recording, channel) or [str(k) for k in range(size)]

    def message(stamp: int, row: np.ndarray) -> Any:
        at = header(stamp=time(sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id="")
        return joint(header=at, name=names, **{**empty, field: row})

    return message
