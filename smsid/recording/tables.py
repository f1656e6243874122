"""Recordings as tables for other programs: CSV and Parquet, with the mapping that brings them back."""

from __future__ import annotations

import csv
import json
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from smsid._files import atomic_path
from smsid._signature import signed
from smsid.errors import RecordingError, require
from smsid.recording.channels import EXTRA, quantity_of
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
    lines = ["[recording]", f"name = {_quoted(recording.name)}", f'role = "{recording.role}"', ""]
    lines += ["[time]", f'column = "{TIME}"', 'unit = "s"', ""]
    labels = recording.labels
    for channel in recording.channels:
        names = ", ".join(map(_quoted, _names(recording, channel)))
        lines += [f"[channel.{_quoted(channel)}]", f"columns = [{names}]"]
        source = channel.partition(".")[0]
        quantity = quantity_of(channel, unit=recording.unit(channel))
        if quantity.is_quaternion:
            lines += ['quaternion = "xyzw"', 'direction = "body_to_inertial"']
        else:
            lines.append(f"unit = {_quoted(recording.unit(channel))}")
        dims = [dim.rpartition(".")[2] for dim in map(str, recording.channel(channel).dims[1:])]
        for dim in dims if source != EXTRA else []:
            known = labels.get(f"{source}.{dim}", labels.get(dim))
            if known:
                lines.append(f"labels = [{', '.join(map(_quoted, known))}]")
        lines.append("")
    return signed("\n".join(lines))


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
            _write_csv(columns, Path(temporary))
        else:
            pyarrow, parquet = require("pyarrow", "parquet"), require("pyarrow.parquet", "parquet")
            arrays = {
                name: pyarrow.array(values, mask=columns.missing(name)) for name, values in columns.items()
            }
            parquet.write_table(pyarrow.table(arrays), temporary)
    return file


def _write_csv(columns: Columns, path: Path) -> None:
    cells = [_cells(values, columns.missing(name)) for name, values in columns.items()]
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(columns)
        writer.writerows(zip(*cells, strict=True))


def _cells(values: NDArray[np.float64], blank: NDArray[np.bool_]) -> list[str]:
    return ["" if empty else repr(float(value)) for value, empty in zip(values, blank, strict=True)]


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


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
