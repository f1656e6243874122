"""Recordings as MCAP, messages of ROS 2, with the mapping that brings them back."""

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from smsid._files import atomic_path
from smsid._signature import signed
from smsid.errors import require
from smsid.recording.channels import EXTRA, LABELLED_DIMS, quantity_of
from smsid.recording.recording import Recording

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
    lines = ["[recording]", f"name = {_quoted(recording.name)}", f'role = "{recording.role}"', ""]
    sources: dict[str, str] = {}
    for channel in recording.channels:
        sources.setdefault(channel.partition(".")[0], channel)
    for source, channel in sources.items():
        lines += [f"[clock.{source}]", f'column = "{_topic(channel)}.time"', 'unit = "s"', ""]
    for channel in recording.channels:
        quantity = quantity_of(channel, unit=recording.unit(channel))
        field = JOINTS.get(channel.partition(".")[2], "data")
        lines += [f"[channel.{_quoted(channel)}]", f'columns = ["{_topic(channel)}.{field}"]']
        if quantity.is_quaternion:
            lines += ['quaternion = "xyzw"', 'direction = "body_to_inertial"']
        else:
            lines.append(f"unit = {_quoted(recording.unit(channel))}")
        names = _names(recording, channel)
        if names:
            lines.append(f"labels = [{', '.join(map(_quoted, names))}]")
        lines.append("")
    return signed("\n".join(lines))


def _kind(channel: str) -> str:
    joints = channel.partition(".")[2] in JOINTS
    return "sensor_msgs/msg/JointState" if joints else "std_msgs/msg/Float64MultiArray"


def _topic(channel: str) -> str:
    return f"/{channel.replace('.', '/')}"


def _names(recording: Recording, channel: str) -> list[str]:
    """Return the labels of a channel's first dimension, if it has such."""
    array = recording.channel(channel)
    dims = [str(dim) for dim in array.dims[1:]]
    if channel.startswith(f"{EXTRA}.") or not dims or dims[0] not in array.coords:
        return []
    return [str(x) for x in array.coords[dims[0]].values] if dims[0].split(".")[-1] in LABELLED_DIMS else []


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
    names = _names(recording, channel) or [str(k) for k in range(size)]

    def message(stamp: int, row: np.ndarray) -> Any:
        at = header(stamp=time(sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id="")
        return joint(header=at, name=names, **{**empty, field: row})

    return message


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
