"""Readers of log files: each gives the columns or arrays of a file by name.

A column of a CSV file in which every cell is a number is float64; any other keeps its text, so that columns
nobody maps do no harm.
"""

from __future__ import annotations

import csv
import logging
import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smsid._listing import some_of
from smsid.errors import RecordingError, require
from smsid.recording._bags import is_bag_folder, read_bag
from smsid.recording._columns import Columns, unreadable, without_samples
from smsid.recording._csv import CsvFormat, parse_number, read_csv
from smsid.recording._hdf5 import MatlabObject, mend, opaque_class, read_hdf5, read_matlab_hdf5
from smsid.recording._times import read_times

__all__ = [
    "READERS",
    "Columns",
    "CsvFormat",
    "parse_number",
    "read_columns",
    "read_csv",
    "read_joined",
    "read_mat",
    "read_npz",
]

logger = logging.getLogger(__name__)

Reader = Callable[[Path, CsvFormat], dict[str, NDArray[Any]]]


def read_columns(path: str | os.PathLike[str], csv_format: CsvFormat | None = None) -> Columns:
    """Read the columns of a file with the reader of its suffix; times written as text become seconds.

    Raises:
        RecordingError: no such file, no reader for the suffix, or what the reader finds wrong.
        MissingDependencyError: the reader needs an extra: ``bags``, ``parquet`` or ``px4``.
    """
    file = Path(path)
    if is_bag_folder(file):
        return read_bag(file)
    if not file.is_file():
        raise RecordingError(f"There is no file {path}.", advice="Check the path.", path=str(path))
    for suffix, reader in READERS.items():
        if file.name.lower().endswith(suffix):
            try:
                found = reader(file, csv_format or CsvFormat())
            except csv.Error as error:  # a cell longer than any number, a NUL
                raise unreadable(file, "CSV", error) from error
            return read_times(found if isinstance(found, Columns) else Columns(found))
    raise RecordingError(
        f"No reader for {path}.",
        advice=f"Known suffixes: {', '.join(READERS)}.",
        path=str(path),
        known=tuple(READERS),
    )


def read_joined(
    file: str | os.PathLike[str], also: Sequence[str | os.PathLike[str]], csv_format: CsvFormat | None = None
) -> Columns:
    """Return the columns of a file and of others that go on with it.

    A column that several files have, such as their clock, must hold the same in all of them.

    Raises:
        RecordingError: as `read_columns`, or a column of the same name differs.
    """
    joined = read_columns(file, csv_format)
    for other in also:
        more = read_columns(other, csv_format)
        for name in sorted(set(joined) & set(more)):
            a, b = joined[name], more[name]
            if a.dtype.kind != b.dtype.kind or not np.array_equal(a, b, equal_nan=a.dtype.kind == "f"):
                raise RecordingError(
                    f"'{name}' of {other} is not that of {file}: {a.shape} and {b.shape} samples, or other "
                    "values.",
                    advice="Files are joined that share their clock; import the others by themselves.",
                    column=name,
                )
        blank, units = {**more.blank, **joined.blank}, {**more.units, **joined.units}
        joined = Columns(
            {**joined, **{n: x for n, x in more.items() if n not in joined}},
            blank=blank,
            units=units,
            times=joined.times | more.times,
        )
    return joined


def read_npz(path: Path, csv_format: CsvFormat) -> Columns:
    """Read the arrays of an NPZ file by name; raise `RecordingError` if it is cut short or holds objects."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            return Columns({name: archive[name] for name in archive.files})
    except Exception as error:  # zipfile, zlib, EOFError, ValueError, depending on where it breaks
        raise unreadable(path, "NPZ", error) from error


def read_mat(path: Path, csv_format: CsvFormat) -> Columns:
    """Read the arrays of a MATLAB file, version 4 to 7.3; fields of structures are called ``data.imu.acc``.

    Elements of arrays of structures are counted from 1, as in ``data.2.acc``. Logs of Simulink (structure
    with time) and other structures with ``signals`` are called by the label of the signal.

    Objects such as timeseries are left out, with a warning that says how to write them.

    Raises:
        RecordingError: no MATLAB file, cut short, or holding objects only.
    """
    from scipy.io import loadmat

    try:
        tree = loadmat(path, simplify_cells=True)
    except NotImplementedError:  # version 7.3 is HDF5
        tree = read_matlab_hdf5(path)
    except Exception as error:  # MatReadError, ValueError, TypeError, zlib.error, ...
        raise unreadable(path, "MATLAB", error) from error
    kept = {name: value for name, value in tree.items() if not name.startswith("__")}
    objects: list[MatlabObject] = []
    columns = Columns(dict(_leaves("", kept, objects)))
    listed = some_of([str(one) for one in objects])
    if not columns:
        holds = f"objects only, which are not written in a public form: {listed}" if objects else "no arrays"
        raise RecordingError(
            f"{path} holds {holds}.",
            advice=mend(objects) if objects else "Save the arrays of numbers.",
            path=str(path),
            objects=tuple(objects),
        )
    if objects:
        logger.warning("%s: objects are left out: %s. %s", path, listed, mend(objects))
    return columns


READERS: MappingProxyType[str, Reader] = MappingProxyType(
    {
        ".csv": read_csv,
        ".csv.gz": read_csv,
        ".tsv": read_csv,
        ".txt": read_csv,
        ".dat": read_csv,
        ".asc": read_csv,
        ".log": read_csv,
        ".npz": read_npz,
        ".mat": read_mat,
        ".h5": lambda path, _: read_hdf5(path),
        ".hdf5": lambda path, _: read_hdf5(path),
        ".nc": lambda path, _: read_hdf5(path),
        ".parquet": lambda path, _: read_parquet(path),
        ".bag": lambda path, _: read_bag(path),
        ".db3": lambda path, _: read_bag(path),
        ".mcap": lambda path, _: read_bag(path),
        ".ulg": lambda path, _: read_ulog(path),
    }
)
"""Readers by suffix."""


def _leaves(prefix: str, tree: dict[str, Any], objects: list[MatlabObject]) -> list[tuple[str, NDArray[Any]]]:
    """Give the arrays of a tree by dotted name; objects in it are added to ``objects``."""
    found: list[tuple[str, NDArray[Any]]] = []
    for key, value in tree.items():
        name = f"{prefix}{key}"
        if isinstance(value, MatlabObject):
            objects.append(MatlabObject(name, value.kind))
            continue
        if opaque := opaque_class(value):
            objects.append(MatlabObject(opaque[0] or name, opaque[1]))
            continue
        if isinstance(value, dict) and "signals" in value and "time" in value:
            value = _simulink(value)
        if isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object):
            rows = list(np.ravel(np.asarray(value, dtype=object)))
            if any(isinstance(row, dict | np.ndarray | MatlabObject) for row in rows):
                value = {str(k): row for k, row in enumerate(rows, start=1)}
        if isinstance(value, dict):
            found += _leaves(f"{name}.", value, objects)
        elif not isinstance(value, np.void) and np.asarray(value).dtype.kind in "fiubUS":
            found.append((name, np.asarray(value)))
    return found


def _simulink(log: dict[str, Any]) -> dict[str, Any]:
    """Give a structure with time as ``time`` and one array per signal, by its label; time first."""
    signals = log["signals"]
    listed = [signals] if isinstance(signals, dict) else list(np.ravel(np.asarray(signals, dtype=object)))
    found: dict[str, Any] = {"time": log["time"]}
    for k, signal in enumerate(listed, start=1):
        if not isinstance(signal, dict) or "values" not in signal:
            return log
        text = signal.get("label")
        label = text.strip() if isinstance(text, str) and text.strip() else f"signal{k}"
        name = label if label not in found else f"{label}.{k}"
        values = np.asarray(signal["values"])
        samples = np.size(log["time"])
        # Simulink puts time last where a signal is a matrix.
        found[name] = (
            np.moveaxis(values, -1, 0) if values.ndim == 3 and values.shape[-1] == samples else values
        )
    return found


def read_parquet(path: Path) -> Columns:
    """Read the columns of a Parquet file by name; fields of structures are called ``imu.acc.x``.

    Numbers and truth values become float64 (N,), missing ones NaN; lists of one length (N, length); times of
    day and dates seconds since the column's first; text stays text.

    Raises:
        MissingDependencyError: pyarrow is not installed.
        RecordingError: no Parquet file, cut short, or without rows.
    """
    parquet = require("pyarrow.parquet", "parquet")
    try:
        table = parquet.read_table(path)
        while any(str(field.type).startswith("struct") for field in table.schema):
            table = table.flatten()
    except Exception as error:  # pyarrow raises ArrowInvalid, OSError, ...
        raise unreadable(path, "Parquet", error) from error
    if table.num_rows == 0:
        raise without_samples(path, "rows")
    columns = Columns({name: _parquet_array(table.column(name)) for name in table.column_names})
    for name in table.column_names:
        missing = np.asarray(table.column(name).is_null().to_numpy(zero_copy_only=False), dtype=bool)
        if missing.any():
            columns.blank[name] = missing
    return columns


def _parquet_array(column: Any) -> NDArray[Any]:
    kind = str(column.type)
    if kind.startswith(("timestamp", "date", "time", "duration")):
        times = column.to_numpy().astype(
            "datetime64[ns]" if not kind.startswith("duration") else "timedelta64[ns]"
        )
        return (times - times[0]) / np.timedelta64(1, "s")
    if kind.startswith(("list", "large_list", "fixed_size_list")):
        rows = column.to_pylist()
        if len({None if row is None else len(row) for row in rows}) == 1 and rows[0] is not None:
            return np.array(rows, dtype=np.float64)
        return np.array([str(row) for row in rows])
    values = column.to_numpy()
    if values.dtype.kind in "fiub":
        return values.astype(np.float64)
    numbers = [np.nan if v is None else v for v in values.tolist()]
    if all(isinstance(v, bool | int | float) for v in numbers):
        return np.array(numbers, dtype=np.float64)
    return np.array(["" if v is None else str(v) for v in values.tolist()])


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
