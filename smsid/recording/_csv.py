"""CSV files: dialect, preamble, header, row of units, blank cells."""

from __future__ import annotations

import csv
import gzip
import io
import logging
import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smsid.errors import RecordingError
from smsid.recording._names import unit_word
from smsid.recording.columns import Columns

logger = logging.getLogger(__name__)

DELIMITERS = (";", "\t", "|", ",")
NO_SAMPLE = frozenset({"", "na", "n/a", "#n/a", "null", "none"})
"""Cells, in lower case, that say there is no sample. ``nan`` is a sample that is no number."""
NUMBER = re.compile(r"[-+]?(\d+([.,]\d*)?|[.,]\d+)([eE][-+]?\d+)?")


@dataclass(frozen=True)
class CsvFormat:
    """How a CSV file is written; what is None is found out.

    Attributes:
        delimiter: between cells.
        decimal: '.' or ','.
        skip_rows: lines before the header (lines starting with '#' there are skipped anyway).
        names: names of the columns, for a file without header; without them ``column1``, ``column2``, ...
    """

    delimiter: str | None = None
    decimal: str | None = None
    skip_rows: int = 0
    names: tuple[str, ...] | None = None


def read_csv(path: Path, csv_format: CsvFormat) -> Columns:
    """Read a CSV file, perhaps gzipped; columns (N,) by the names of its header.

    Lines before the header that have another number of cells are a preamble and skipped. A row of units under
    the header is not a sample. A column of numbers is float64, NaN where a cell is blank; any other is text.

    Raises:
        RecordingError: not text, cut short, a repeated name, or a line with another number of
            cells.
    """
    lines, first = _csv_lines(path, csv_format)
    delimiter = csv_format.delimiter or _sniff_delimiter(path, lines)
    if not csv_format.names:
        preamble = _preamble(lines, delimiter)
        lines, first = lines[preamble:], first + preamble
    rows = csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
    named = csv_format.names
    if not named:
        cells = next(csv.reader(lines[:1], delimiter=delimiter, skipinitialspace=True), [])
        if len(cells) > 1 and all(NUMBER.fullmatch(cell.strip()) for cell in cells):
            named = tuple(f"column{k}" for k in range(1, len(cells) + 1))
            logger.warning("%s has no header: its columns are called column1 to column%d.", path, len(cells))
    names = list(named) if named else [cell.strip() for cell in next(rows, [])]
    _check_header(path, names)
    table = _table(path, rows, names, delimiter, first)
    decimal = csv_format.decimal or _sniff_decimal(table, delimiter)
    units = _units_row(table[0], decimal) if len(table) > 1 else None
    if units is not None:
        table = table[1:]
    columns = Columns()
    for k, (name, cells) in enumerate(zip(names, zip(*table, strict=True), strict=True)):
        if not name:
            continue
        columns[name], blank = _numbers(cells, decimal)
        if blank.any():
            columns.blank[name] = blank
        unit = unit_word(units[k]) if units is not None else None
        if unit is not None:
            columns.units[name] = unit
    return columns


def _table(path: Path, rows: Any, names: list[str], delimiter: str, first: int) -> list[list[str]]:
    """Collect the rows under the header; raise `RecordingError` at one of another length."""
    table: list[list[str]] = []
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
                else f"Mend the line; in the mapping, state [csv] delimiter and decimal if '{delimiter}' is "
                "wrong, and skip_rows if the header comes later.",
                path=str(path),
                line=line,
            )
        if any(cell.strip() for cell in row):  # a row of delimiters only, as spreadsheets leave at the end
            table.append(row)
    if not table:
        raise RecordingError(f"{path} has no samples.", advice="Is it the right file?", path=str(path))
    return table


def _preamble(lines: list[str], delimiter: str) -> int:
    """Count the lines before the header: the header is the first of as many cells as most lines have."""
    counts = [len(next(csv.reader([line], delimiter=delimiter), [])) for line in lines[:60]]
    if len(counts) < 3:
        return 0
    usual = Counter(counts).most_common(1)[0][0]
    start = counts.index(usual)
    if start == 0 or usual < 2:
        return 0
    cells = next(csv.reader([lines[start]], delimiter=delimiter, skipinitialspace=True))
    # A first line of another length before numbers is a header with a fault, not a preamble.
    header = not any(NUMBER.fullmatch(cell.strip()) for cell in cells)
    return start if header else 0


def _units_row(row: list[str], decimal: str) -> list[str] | None:
    """Give the cells of a row of units under the header, or None if the row is something else."""
    written = [cell.strip() for cell in row if cell.strip()]
    named = [cell for cell in written if cell not in ("-", "1")]
    known = all(unit_word(cell) is not None for cell in written)
    return row if named and known and len(written) * 2 >= len(row) else None


def unreadable(path: Path, kind: str, error: Exception) -> RecordingError:
    """Word the error of a file that a reader gave up on."""
    return RecordingError(
        f"{path} ({path.stat().st_size} bytes) cannot be read as {kind}: {error}.",
        advice="It is cut short, damaged, or of another format: copy it again, or correct its suffix.",
        path=str(path),
        size=path.stat().st_size,
    )


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
    """Choose the delimiter that splits the lines alike and into most cells; else most of them."""
    head = lines[:60]
    alike: dict[str, int] = {}
    mostly: dict[str, int] = {}
    for delimiter in DELIMITERS:
        first = {len(row) for row in csv.reader(head[:20][:-1] or head, delimiter=delimiter)}
        if len(first) == 1 and max(first) > 1:
            alike[delimiter] = max(first)
        cells, times = Counter(len(row) for row in csv.reader(head, delimiter=delimiter)).most_common(1)[0]
        if cells > 1 and times > len(head) // 2:
            mostly[delimiter] = cells
    if alike:
        return max(alike, key=lambda delimiter: alike[delimiter])
    if mostly:  # a comma may be the decimal sign, so the others go before it
        return next(iter(mostly))
    if any(delimiter in head[0] for delimiter in DELIMITERS):
        return max(DELIMITERS, key=head[0].count)
    blanks = {len(line.split()) for line in head[:20][:-1] or head}
    if len(blanks) == 1 and blanks != {1} and len({line.count(" ") for line in head}) == 1:
        return " "
    raise RecordingError(
        f"{path}: no delimiter found in the line {head[0].strip()!r}.",
        advice="State it in the mapping: [csv] delimiter = ' '; if the header comes later, skip_rows = 3 or "
        "as many lines as there are before it.",
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


def _sniff_decimal(table: list[list[str]], delimiter: str) -> str:
    """A comma inside cells is the decimal sign if no number has a point."""
    if delimiter == ",":
        return "."
    cells = [cell for row in table[:100] for cell in row]
    comma = any(re.fullmatch(r"\s*[-+]?\d*,\d+([eE][-+]?\d+)?\s*", cell) for cell in cells)
    point = any(re.fullmatch(r"\s*[-+]?\d*\.\d+([eE][-+]?\d+)?\s*", cell) for cell in cells)
    return "," if comma and not point else "."


def _numbers(cells: tuple[str, ...], decimal: str) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Give the numbers (N,) of a column, or its text, and where it is blank."""
    blank = np.array([cell.strip().lower() in NO_SAMPLE for cell in cells])
    try:
        numbers = [np.nan if b else parse_number(cell, decimal) for cell, b in zip(cells, blank, strict=True)]
        return np.array(numbers, dtype=np.float64), blank
    except ValueError:
        return np.array(cells), blank


def parse_number(cell: str, decimal: str = ".") -> float:
    """Read a number; raise ValueError for anything else, such as the digit groups ``1_000``."""
    if "_" in cell or (decimal == "," and "." in cell):
        raise ValueError(cell)
    return float(cell.replace(",", ".") if decimal == "," else cell)
