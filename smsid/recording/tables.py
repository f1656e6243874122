"""Recordings as tables for other programs: CSV and Parquet, with the mapping that brings them back."""

from __future__ import annotations

import csv
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from smsid._files import atomic_path, signed
from smsid.errors import RecordingError, require
from smsid.recording.channels import EXTRA, LABELLED_DIMS, quantity_of
from smsid.recording.columns import Columns
from smsid.recording.recording import Recording

TIME = "time [s]"
FORMATS = (".csv", ".parquet")


def table_columns(recording: Recording) -> Columns:
    """Lay a recording out in columns (M,), one row per time at which any clock has a sample.

    Columns are called ``imu.acceleration.x [m/s^2]``. Where a clock has no sample the cell is blank, see
    `Columns.blank`; times are exact.
    """
    clocks = [recording.dataset[clock].values for clock in recording.clocks]
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
    return signed(tomli_w.dumps({"recording": head, **clocks, "channel": channels}))


def labels_of(recording: Recording, channel: str) -> list[str]:
    """Return the labels of a channel's joints, wheels, modes or stations; none where it has none."""
    array = recording.channel(channel)
    dim = str(array.dims[1]) if array.ndim > 1 and not channel.startswith(f"{EXTRA}.") else ""
    labelled = dim.rpartition(".")[2] in LABELLED_DIMS and dim in array.coords
    return [str(x) for x in array.coords[dim].values] if labelled else []


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
    array = recording.channel(channel)
    labels = [
        [str(label) for label in array.coords[dim].values]
        if dim in array.coords
        else list(map(str, range(size)))
        for dim, size in zip(array.dims[1:], array.shape[1:], strict=True)
    ]
    names = [channel]
    for choices in labels:
        names = [f"{name}.{choice}" for name in names for choice in choices]
    return [f"{name} [{recording.unit(channel)}]" for name in names]
