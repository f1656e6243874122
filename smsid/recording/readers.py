"""Readers of log files: each gives the columns or arrays of a file by name.

A column of a CSV file in which every cell is a number is float64; any other keeps its text, so that columns
nobody maps do no harm.
"""

from __future__ import annotations

import csv
import gzip
import io
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smsid.errors import RecordingError
from smsid.recording._bags import is_bag_folder, read_bag
from smsid.recording._hdf5 import read_hdf5, read_matlab_hdf5
from smsid.recording._parquet import read_parquet

Columns = dict[str, NDArray[Any]]
DELIMITERS = (";", "\t", "|", ",")


@dataclass(frozen=True)
class CsvFormat:
    """How a CSV file is written; what is None is found out.

    Attributes:
        delimiter: between cells.
        decimal: '.' or ','.
        skip_rows: lines before the header (lines starting with '#' there are skipped anyway).
        names: names of the columns, for a file without header.
    """

    delimiter: str | None = None
    decimal: str | None = None
    skip_rows: int = 0
    names: tuple[str, ...] | None = None


Reader = Callable[[Path, CsvFormat], Columns]


def read_columns(path: str | os.PathLike[str], csv_format: CsvFormat | None = None) -> Columns:
    """Read the columns of a file with the reader of its suffix.

    Raises:
        RecordingError: no such file, no reader for the suffix, or what the reader finds wrong.
        MissingDependencyError: the reader needs an extra, such as ``bags`` or ``parquet``.
    """
    file = Path(path)
    if is_bag_folder(file):
        return read_bag(file)
    if not file.is_file():
        raise RecordingError(f"There is no file {path}.", advice="Check the path.", path=str(path))
    for suffix, reader in READERS.items():
        if file.name.lower().endswith(suffix):
            try:
                return reader(file, csv_format or CsvFormat())
            except csv.Error as error:  # a cell longer than any number, a NUL
                raise unreadable(file, "CSV", error) from error
    raise RecordingError(
        f"No reader for {path}.",
        advice=f"Known suffixes: {', '.join(READERS)}.",
        path=str(path),
        known=tuple(READERS),
    )


def read_csv(path: Path, csv_format: CsvFormat) -> Columns:
    """Read a CSV file, perhaps gzipped; columns (N,) by the names of its header.

    Raises:
        RecordingError: not text, cut short, no header, a repeated name, or a line with another number of
            cells.
    """
    lines, first = _csv_lines(path, csv_format)
    delimiter = csv_format.delimiter or _sniff_delimiter(path, lines)
    rows = csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
    names = list(csv_format.names) if csv_format.names else [cell.strip() for cell in next(rows, [])]
    _check_header(path, names)
    table: list[list[str]] = []
    line = first
    for row in rows:
        line = first + rows.line_num - 1
        if len(row) == len(names) + 1 and not row[-1].strip():
            row = row[:-1]  # a delimiter at the end of every line, which the header lacks
        if len(row) != len(names):
            rest = any(any(cell.strip() for cell in later) for later in rows)
            if not row and not rest:
                break
            cut = len(row) < len(names) and not rest
            raise RecordingError(
                f"{path}, line {line}: {len(row)} cells, but there are {len(names)} columns"
                f"{'; the file is cut short there' if cut else ''}.",
                advice="Copy the file again, or delete that line."
                if cut
                else f"Mend the line; state delimiter and decimal if '{delimiter}' is wrong.",
                path=str(path),
                line=line,
            )
        table.append(row)
    if not table:
        raise RecordingError(f"{path} has no samples.", advice="Is it the right file?", path=str(path))
    decimal = csv_format.decimal or _sniff_decimal(table, delimiter)
    columns = {}
    for name, cells in zip(names, zip(*table, strict=True), strict=True):
        if name:
            columns[name] = _numbers(cells, decimal)
    return columns


def read_npz(path: Path, csv_format: CsvFormat) -> Columns:
    """Read the arrays of an NPZ file by name; raise `RecordingError` if it is cut short or holds objects."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except Exception as error:  # zipfile, zlib, EOFError, ValueError, depending on where it breaks
        raise unreadable(path, "NPZ", error) from error


def read_mat(path: Path, csv_format: CsvFormat) -> Columns:
    """Read the arrays of a MATLAB file, version 4 to 7.3; fields of structures are called ``data.imu.acc``.

    Raises:
        RecordingError: no MATLAB file, or cut short.
    """
    from scipy.io import loadmat

    try:
        tree = loadmat(path, simplify_cells=True)
    except NotImplementedError:  # version 7.3 is HDF5
        return read_matlab_hdf5(path)
    except Exception as error:  # MatReadError, ValueError, TypeError, zlib.error, ...
        raise unreadable(path, "MATLAB", error) from error
    return dict(_leaves("", {name: value for name, value in tree.items() if not name.startswith("__")}))


def unreadable(path: Path, kind: str, error: Exception) -> RecordingError:
    """Word the error of a file that a reader gave up on."""
    return RecordingError(
        f"{path} ({path.stat().st_size} bytes) cannot be read as {kind}: {error}.",
        advice="It is cut short, damaged, or of another format: copy it again, or correct its suffix.",
        path=str(path),
        size=path.stat().st_size,
    )


READERS: MappingProxyType[str, Reader] = MappingProxyType(
    {
        ".csv": read_csv,
        ".csv.gz": read_csv,
        ".tsv": read_csv,
        ".txt": read_csv,
        ".npz": read_npz,
        ".mat": read_mat,
        ".h5": lambda path, _: read_hdf5(path),
        ".hdf5": lambda path, _: read_hdf5(path),
        ".nc": lambda path, _: read_hdf5(path),
        ".parquet": lambda path, _: read_parquet(path),
        ".bag": lambda path, _: read_bag(path),
        ".db3": lambda path, _: read_bag(path),
        ".mcap": lambda path, _: read_bag(path),
    }
)
"""Readers by suffix."""


def _csv_lines(path: Path, csv_format: CsvFormat) -> tuple[list[str], int]:
    """Give the lines from the header on, and the number of the first of them, counted from 1."""
    try:
        raw = path.read_bytes()
        data = gzip.decompress(raw) if path.name.lower().endswith(".gz") else raw
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise RecordingError(
            f"{path} is not UTF-8 text: {error}.", advice="Save it as UTF-8.", path=str(path)
        ) from error
    except Exception as error:  # gzip raises OSError, EOFError or zlib.error
        raise unreadable(path, "gzipped CSV", error) from error
    lines = io.StringIO(text, newline=None).read().split("\n")
    skipped = csv_format.skip_rows
    while skipped < len(lines) and (lines[skipped].startswith("#") or not lines[skipped].strip()):
        skipped += 1
    while lines and not lines[-1].strip():
        lines.pop()
    if len(lines) <= skipped:
        raise RecordingError(f"{path} has no lines to read.", advice="Is it the right file?", path=str(path))
    return [f"{line}\n" for line in lines[skipped:]], skipped + 1


def _sniff_delimiter(path: Path, lines: list[str]) -> str:
    """Choose the delimiter that splits the first lines alike and into most cells."""
    head = lines[:20]
    found: dict[str, int] = {}
    for delimiter in DELIMITERS:
        counts = {len(row) for row in csv.reader(head[:-1] or head, delimiter=delimiter)}
        if len(counts) == 1 and max(counts) > 1:
            found[delimiter] = max(counts)
    if found:
        return max(found, key=lambda delimiter: found[delimiter])
    if any(delimiter in head[0] for delimiter in DELIMITERS):
        return max(DELIMITERS, key=head[0].count)
    raise RecordingError(
        f"{path}: no delimiter found in the line {head[0].strip()!r}.",
        advice="State it in the mapping: [csv] delimiter = ' '.",
        path=str(path),
    )


def _check_header(path: Path, names: list[str]) -> None:
    repeated = sorted({name for name in names if name and names.count(name) > 1})
    if repeated:
        raise RecordingError(
            f"{path}: the columns {', '.join(repeated)} appear more than once.",
            advice="Rename them in the header.",
            path=str(path),
            repeated=tuple(repeated),
        )
    if names and all(re.fullmatch(r"[-+]?[\d.,]+([eE][-+]?\d+)?", name) for name in names):
        raise RecordingError(
            f"{path} has no header: the first line is {', '.join(names[:4])}.",
            advice="Name the columns in the mapping: [csv] names = ['t', ...].",
            path=str(path),
        )


def _sniff_decimal(table: list[list[str]], delimiter: str) -> str:
    """A comma inside cells is the decimal sign if no number has a point."""
    if delimiter == ",":
        return "."
    cells = [cell for row in table[:100] for cell in row]
    comma = any(re.fullmatch(r"\s*[-+]?\d*,\d+([eE][-+]?\d+)?\s*", cell) for cell in cells)
    point = any(re.fullmatch(r"\s*[-+]?\d*\.\d+([eE][-+]?\d+)?\s*", cell) for cell in cells)
    return "," if comma and not point else "."


def _numbers(cells: tuple[str, ...], decimal: str) -> NDArray[Any]:
    try:
        return np.array([parse_number(cell, decimal) for cell in cells], dtype=np.float64)
    except ValueError:
        # A point is what the importer expects when it looks for the cell at fault.
        return np.array([cell.replace(decimal, ".") if decimal != "." else cell for cell in cells])


def parse_number(cell: str, decimal: str = ".") -> float:
    """Read a number; raise ValueError for anything else, such as the digit groups ``1_000``."""
    if "_" in cell or (decimal == "," and "." in cell):
        raise ValueError(cell)
    return float(cell.replace(",", ".") if decimal == "," else cell)


def _leaves(prefix: str, tree: dict[str, Any]) -> list[tuple[str, NDArray[Any]]]:
    found: list[tuple[str, NDArray[Any]]] = []
    for key, value in tree.items():
        name = f"{prefix}{key}"
        found += _leaves(f"{name}.", value) if isinstance(value, dict) else [(name, np.asarray(value))]
    return found
