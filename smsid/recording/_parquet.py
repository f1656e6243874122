"""Parquet files, through pyarrow (extra ``parquet``)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smsid.errors import require
from smsid.recording.columns import Columns, unreadable, without_samples


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
    columns = Columns({name: _array(table.column(name)) for name in table.column_names})
    for name in table.column_names:
        missing = np.asarray(table.column(name).is_null().to_numpy(zero_copy_only=False), dtype=bool)
        if missing.any():
            columns.blank[name] = missing
    return columns


def _array(column: Any) -> NDArray[Any]:
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
