"""Recordings as files of other programs, CSV, Parquet and MCAP, with the mapping that brings them back."""

from __future__ import annotations

import csv
import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import tomli_w

from smsid._files import atomic_path, with_sum
from smsid.errors import RecordingError, require
from smsid.recording._columns import Columns
from smsid.recording.channels import EXTRA, LABELLED_DIMS, quantity_of
from smsid.recording.recording import Recording

TIME = "time [s]"
FORMATS = (".csv", ".parquet")


def table_columns(recording: Recording) -> Columns:
    """Lay a recording out in columns (M,), one row per time at which any clock has a sample.

    Columns are called ``imu.acceleration.x [m/s^2]``. Where a clock has no sample the cell is blank, see
    `Columns.blank`; times are exact.
    """
    clocks = list(recording.times().values())
    times = np.unique(np.concatenate(clocks))
    columns = Columns({TIME: times})
    for channel in recording.channels:
        own = recording.time(channel)
        values = recording[channel].reshape(own.size, -1)
        rows = np.searchsorted(times, own)
        for name, column in zip(_names(recording, channel), values.T, strict=True):
            laid = np.full(times.size, np.nan)
            laid[rows] = column
            columns[name] = laid
            blank = np.ones(times.size, dtype=bool)
            blank[rows] = False
            if blank.any():
                columns.blank[name] = blank
    return columns


def table_mapping(recording: Recording) -> str:
    """Write the mapping (TOML) with which `import_recording` reads the table of `table_columns`."""
    columns = {channel: _names(recording, channel) for channel in recording.channels}
    return mapping_text(recording, columns, {"time": {"column": TIME, "unit": "s"}})


def mapping_text(
    recording: Recording, columns: Mapping[str, Sequence[str]], clocks: Mapping[str, Any]
) -> str:
    """Write the mapping (TOML) of a recording whose channels stand in ``columns``, by ``clocks``' tables."""
    channels = {}
    for channel, names in columns.items():
        unit = recording.unit(channel)
        quaternion = quantity_of(channel, unit=unit).is_quaternion
        table: dict[str, Any] = {"columns": list(names)}
        table |= {"quaternion": "xyzw", "direction": "body_to_inertial"} if quaternion else {"unit": unit}
        if known := labels_of(recording, channel):
            table["labels"] = known
        channels[channel] = table
    head = {"name": recording.name, "role": recording.role}
    if (inputs := recording.provenance.get("inputs")) in ("held", "linear"):
        head["inputs"] = inputs
    return with_sum(tomli_w.dumps({"recording": head, **clocks, "channel": channels}))


def labels_of(recording: Recording, channel: str) -> list[str]:
    """Return the labels of a channel's joints, wheels, modes or stations; none where it has none."""
    columns = {} if channel.startswith(f"{EXTRA}.") else recording.columns(channel)
    dim, labels = next(iter(columns.items()), ("", ()))
    return list(labels) if dim.rpartition(".")[2] in LABELLED_DIMS else []


def save_table(recording: Recording, path: str | os.PathLike[str]) -> Path:
    """Write a recording as CSV or Parquet, by the suffix; the file appears whole or not at all.

    Raises:
        RecordingError: another suffix, or clocks that do not increase.
        MissingDependencyError: Parquet needs pyarrow (extra ``parquet``).
    """
    file = Path(path)
    if file.suffix.lower() not in FORMATS:
        raise RecordingError(
            f"No table can be written to {path}.",
            advice=f"Choose a suffix of {', '.join(FORMATS)}.",
            path=str(path),
        )
    columns = table_columns(recording)
    with atomic_path(file) as temporary:
        if file.suffix.lower() == ".csv":
            cells = [
                [
                    "" if empty else repr(x)
                    for x, empty in zip(values.tolist(), columns.missing(name), strict=True)
                ]
                for name, values in columns.items()
            ]
            with Path(temporary).open("w", encoding="utf-8", newline="") as stream:
                csv.writer(stream).writerows([list(columns), *zip(*cells, strict=True)])
        else:
            pyarrow, parquet = require("pyarrow", "parquet"), require("pyarrow.parquet", "parquet")
            arrays = {
                name: pyarrow.array(values, mask=columns.missing(name)) for name, values in columns.items()
            }
            parquet.write_table(pyarrow.table(arrays), temporary)
    return file


def _names(recording: Recording, channel: str) -> list[str]:
    sizes = recording[channel].shape[1:]
    own = zip(recording.columns(channel).values(), sizes, strict=True)
    labels = [list(names) or list(map(str, range(size))) for names, size in own]
    names = [channel]
    for choices in labels:
        names = [f"{name}.{choice}" for name in names for choice in choices]
    return [f"{name} [{recording.unit(channel)}]" for name in names]


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
    start = min(float(times[0]) for times in recording.times().values())
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
