"""ULog files of PX4, through pyulog (extra ``px4``)."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from smsid.errors import require
from smsid.recording.columns import Columns, unreadable, without_samples


def read_ulog(path: Path) -> Columns:
    """Read the topics of a ULog; every topic has its own clock.

    Columns are called ``vehicle_attitude.q`` (arrays (N, k)) and ``vehicle_local_position.vx``; further
    instances of a topic ``sensor_gyro.1.x``. ``<topic>.time`` is in seconds since the log's start.

    Raises:
        MissingDependencyError: pyulog is not installed.
        RecordingError: no ULog, cut short, or without data.
    """
    pyulog = require("pyulog", "px4")
    try:
        log = pyulog.ULog(str(path))
    except Exception as error:  # pyulog raises TypeError, struct.error, KeyError, ... depending on the place
        raise unreadable(path, "ULog", error) from error
    columns = Columns()
    for topic in sorted(log.data_list, key=lambda d: (d.name, d.multi_id)):
        where = topic.name if topic.multi_id == 0 else f"{topic.name}.{topic.multi_id}"
        times = np.asarray(topic.data["timestamp"], dtype=np.int64)
        columns[f"{where}.time"] = (times - int(log.start_timestamp)) * 1e-6
        columns.units[f"{where}.time"] = "s"
        parts: dict[str, list[str]] = {}
        for name in topic.data:
            parts.setdefault(re.sub(r"\[\d+\]$", "", name), []).append(name)
        for name, members in parts.items():
            if name == "timestamp":
                continue
            # pyulog keeps the order of the message, so members count up.
            arrays = [np.asarray(topic.data[m], dtype=np.float64) for m in members]
            array = np.stack(arrays, axis=1) if members != [name] else arrays[0]
            columns[f"{where}.{name}"] = array
    if not columns:
        raise without_samples(path, "data", "Was anything logged?")
    return columns
