"""CSV files: rows and columns of a text file, with what it says about units and missing samples."""

from __future__ import annotations

import codecs
import csv
import gzip
import io
import logging
import re
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from smsid.errors import RecordingError
from smsid.recording._columns import Columns, unreadable, without_samples
from smsid.recording._csv_cells import NUMBER, parse_number, read_cells, sniff_decimal
from smsid.recording._csv_header import (
    comment_names,
    count_preamble,
    header_rows,
    join_header,
    sniff_delimiter,
    spread_long_table,
    units_row,
    without_repeats,
)
from smsid.recording._times import is_time
from smsid.recording._units import unit_word

__all__ = ["CsvFormat", "parse_number", "read_csv"]

logger = logging.getLogger(__name__)


class CsvFormat(BaseModel):
    """How a CSV file is written, ``[csv]`` of a mapping; what is None is found out.

    Attributes:
        delimiter: between cells; a blank stands for any number of blanks.
        decimal: '.' or ','.
        skip_rows: lines before the header (lines starting with '#' there are skipped anyway).
        names: names of the columns, for a file without header; without them ``column1``, ``column2``, ...
        missing: cells that say there is no sample, such as '-999' or 'nan', beside blank ones.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    delimiter: Annotated[str, Field(min_length=1, max_length=1)] | None = None
    decimal: Literal[".", ","] | None = None
    skip_rows: Annotated[int, Field(ge=0)] = 0
    names: tuple[str, ...] | None = None
    missing: tuple[Annotated[str, Field(min_length=1)], ...] = ()


def read_csv(path: Path, csv_format: CsvFormat) -> Columns:
    """Read a CSV file, perhaps gzipped; columns (N,) by the names of its header.

    Lines before the header that have another number of cells are a preamble and skipped. Header rows above
    one another are joined where the lowest leaves names blank or alike. A row of units under the header is
    not a sample. A long table (time, parameter, value) is spread to one column per parameter. A column of
    numbers is float64, NaN where a cell is blank; lists of numbers are (N, k); any other column is text.

    Raises:
        RecordingError: not text, cut short, or a line with another number of cells.
    """
    lines, comment, first = read_lines(path, csv_format.skip_rows)
    delimiter = csv_format.delimiter or sniff_delimiter(path, lines)
    if delimiter == " ":
        lines = [" ".join(line.split()) + "\n" for line in lines]
    if not csv_format.names:
        preamble = count_preamble(lines, delimiter)
        lines, first = lines[preamble:], first + preamble
    rows = csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
    names, heading = _names(path, lines, comment, delimiter, csv_format)
    for _ in range(heading):
        next(rows)
    table = _table(path, rows, names, delimiter, first)
    decimal = csv_format.decimal or sniff_decimal(table, delimiter)
    units = units_row(table[0]) if len(table) > 1 else None
    if units is not None:
        table = table[1:]
    names, table = spread_long_table(names, table)
    by_name = without_repeats(path, names, list(zip(*table, strict=True)))
    columns = Columns()
    for name, cells in by_name.items():
        columns[name], blank, unit = read_cells(cells, decimal, csv_format.missing)
        if blank.any():
            columns.blank[name] = blank
        if units is not None and name in names:
            unit = unit_word(units[names.index(name)]) or unit
        if unit is not None:
            columns.units[name] = unit
    return columns


def _names(
    path: Path, lines: list[str], comment: str, delimiter: str, csv_format: CsvFormat
) -> tuple[list[str], int]:
    """Give the names of the columns and the number of lines that they take."""
    if csv_format.names:
        return list(csv_format.names), 0
    head = [[cell.strip() for cell in row] for row in csv.reader(lines[:60], delimiter=delimiter,
                                                                 skipinitialspace=True)]  # fmt: skip
    cells = head[0] if head else []
    values = [bool(NUMBER.fullmatch(cell)) or is_time(cell) for cell in cells if cell]
    if cells and values and all(values) and any(NUMBER.fullmatch(cell) for cell in cells):
        named = comment_names(comment, delimiter, len(cells))
        if named is None:
            named = [f"column{k}" for k in range(1, len(cells) + 1)]
            logger.warning("%s has no header: its columns are called column1 to column%d.", path, len(cells))
        return named, 0
    upper = header_rows(head)
    return join_header(head[:upper]), upper


def _table(path: Path, rows: Any, names: list[str], delimiter: str, first: int) -> list[list[str]]:
    """Collect the rows under the header; raise `RecordingError` at one of another length."""
    table: list[list[str]] = []
    for row in rows:
        line = first + rows.line_num - 1
        if len(row) == len(names) + 1 and not row[-1].strip():
            row = row[:-1]  # a delimiter at the end of every line, which the header lacks
        if row and row[0].lstrip().startswith("#") and len(row) != len(names):
            continue  # a comment between the samples
        if len(row) != len(names):
            rest = any(any(cell.strip() for cell in later) for later in rows)
            if not row and not rest:
                break
            if len(row) == 1 and not rest and table and not re.search(r"\d", row[0]):
                logger.warning("%s, line %d: '%s' is no sample and skipped.", path, line, row[0].strip())
                break
            raise _uneven_error(path, line, row, names, delimiter, rest)
        if any(cell.strip() for cell in row):  # a row of delimiters only, as spreadsheets leave at the end
            table.append(row)
    if not table:
        raise without_samples(path, "samples")
    return table


def _uneven_error(
    path: Path, line: int, row: list[str], names: list[str], delimiter: str, rest: bool
) -> RecordingError:
    cut = len(row) < len(names) and not rest
    if cut:
        advice = "Copy the file again, or delete that line."
    elif delimiter == "," and len(row) == 2 * len(names):
        advice = "Its decimals look like commas, as the cells' limits do: write it with ';' between cells."
    else:
        advice = (
            f"Mend the line; in the mapping, state [csv] delimiter and decimal if '{delimiter}' is wrong, "
            "and skip_rows if the header comes later."
        )
    return RecordingError(
        f"{path}, line {line}: {len(row)} cells, but there are {len(names)} columns"
        f"{'; the file is cut short there' if cut else ''}.",
        advice=advice,
        path=str(path),
        line=line,
    )


CONTROL = re.compile(r"[\x00-\x08\x0e-\x1f\x7f]")


def read_lines(path: Path, skip_rows: int) -> tuple[list[str], str, int]:
    """Give the lines from the header on, the last comment before them, and the number of the first, from 1.

    Raises:
        RecordingError: not text, a damaged archive, or nothing in it.
    """
    try:
        raw = path.read_bytes()
        data = gzip.decompress(raw) if path.name.lower().endswith(".gz") else raw
    except Exception as error:  # gzip raises OSError, EOFError or zlib.error
        raise unreadable(path, "gzipped CSV", error) from error
    lines = io.StringIO(_decode(path, data), newline=None).read().split("\n")
    skipped = skip_rows
    comment = ""
    # Spreadsheets take their delimiter from a first line such as 'sep=;'.
    while skipped < len(lines) and re.match(r"#|\s*$|(?i:sep=.\s*$)", lines[skipped]):
        comment = lines[skipped].lstrip("# ") or comment
        skipped += 1
    while lines and not lines[-1].strip():
        lines.pop()
    if len(lines) <= skipped:
        raise without_samples(path, "lines to read")
    return [f"{line}\n" for line in lines[skipped:]], comment, skipped + 1


def _decode(path: Path, data: bytes) -> str:
    """Decode UTF-8, UTF-16, or the code page of older programs of Windows."""
    even, odd = data[0:2000:2], data[1:2000:2]
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) and len(data) % 2 == 0 and 0 in data[:200]:
        names = ("utf-16",)
    elif len(odd) > 4 and (odd.count(0) > 0.9 * len(odd) or even.count(0) > 0.9 * len(even)):
        names = ("utf-16-le" if odd.count(0) > even.count(0) else "utf-16-be",)
    else:
        names = ("utf-8-sig", "cp1252")
    for name in names:
        try:
            text = data.decode(name)
        except UnicodeDecodeError:
            continue
        if name == "cp1252":
            if CONTROL.search(text):
                break
            logger.warning("%s is not UTF-8; it is read as Windows-1252.", path)
        return text
    raise RecordingError(
        f"{path} is no text in UTF-8, UTF-16 or Windows-1252.",
        advice="Is it the right file? If so, save it as UTF-8.",
        path=str(path),
    )
