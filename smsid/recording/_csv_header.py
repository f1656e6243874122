"""What stands above and between the samples of a CSV file: delimiter, preamble, header, units."""

from __future__ import annotations

import csv
import itertools
import logging
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from smsid.errors import RecordingError
from smsid.recording._csv_cells import NUMBER
from smsid.recording._units import unit_word

logger = logging.getLogger(__name__)

DELIMITERS = (";", "\t", "|", ",")
PARAMETER = re.compile(r"(?i)_?(parameter|param|variable|signal|channel|mnemonic|field|name)( ?_?name)?")
TIME = re.compile(r"(?i)time|stamp|zeit|utc|^t$|^t[ _\[(]")
VALUE = re.compile(r"(?i)_?(eng(ineering)?[ _]?)?value")


def sniff_delimiter(path: Path, lines: list[str]) -> str:
    """Choose the delimiter that splits the lines alike and into most cells; else most of them.

    A blank stands for any number of blanks. A file of one column has none; any delimiter serves it.

    Raises:
        RecordingError: none does.
    """
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
    words, times = Counter(len(line.split()) for line in head).most_common(1)[0]
    if words > 1 and times > len(head) // 2:
        return " "
    if len(head) > 2 and all(NUMBER.fullmatch(line.strip()) for line in head[1:]):
        return ","
    raise RecordingError(
        f"{path}: no delimiter found in the line {head[0].strip()!r}.",
        advice="State it in the mapping: [csv] delimiter = ' '; if the header comes later, skip_rows = 3 or "
        "as many lines as there are before it.",
        path=str(path),
    )


def count_preamble(lines: list[str], delimiter: str) -> int:
    """Count the lines before the header: the header is the first of as many cells as most lines have.

    Lines before a blank one are a preamble in any case, unless samples stand among them.
    """
    blank = max((k for k, line in enumerate(lines[:60]) if not line.strip(f"{delimiter} \t\n")), default=-1)
    if blank >= 0 and not any(NUMBER.match(line.lstrip()) for line in lines[:blank]):
        return blank + 1 + count_preamble(lines[blank + 1 :], delimiter)
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


def header_rows(head: list[list[str]]) -> int:
    """Count the header rows: several where the first leaves names blank or alike and none holds samples."""
    if not head:
        return 0
    inner = head[0][1:].copy()
    while inner and not inner[-1]:
        inner.pop()
    if "" not in inner and len(set(inner)) == len(inner) and head[0][0]:
        return 1
    numbers = [any(NUMBER.fullmatch(cell) for cell in row) for row in head]
    samples = next((k for k in range(1, len(head)) if all(numbers[k:])), 1)
    widths = {len(row) for row in head[:samples]}
    above = head[samples - 1]
    # A row of units is not part of the names.
    return max(samples - (units_row(above) is not None), 1) if len(widths) == 1 else 1


def join_header(rows: list[list[str]]) -> list[str]:
    """Name the columns after the lowest row, with the words above it where that is blank or repeated."""
    if not rows:
        return []
    names = list(rows[-1])
    for row in reversed(rows[:-1]):
        counts = Counter(names)
        # A blank cell goes on with the one before it, as merged cells do.
        words = list(itertools.accumulate(row, lambda before, cell: cell or before))
        needed = {word for word, name in zip(words, names, strict=True) if not name or counts[name] > 1}
        names = [
            f"{word} {name}".strip() if word in needed else name
            for word, name in zip(words, names, strict=True)
        ]
    return names


def comment_names(comment: str, delimiter: str, count: int) -> list[str] | None:
    """Read the names of a header that is a comment, such as ``# t, q1``; None if it has other cells."""
    for cells in (next(csv.reader([comment], delimiter=delimiter), []), comment.split(), comment.split(",")):
        names = [cell.strip() for cell in cells]
        if len(names) == count and all(names) and len(set(names)) == count:
            return names
    return None


def units_row(row: Sequence[str]) -> Sequence[str] | None:
    """Give the cells of a row of units under the header, or None if the row is something else."""
    written = [cell.strip() for cell in row if cell.strip()]
    named = [cell for cell in written if cell not in ("-", "1")]
    known = all(unit_word(cell) is not None for cell in written)
    return row if named and known and len(written) * 2 >= len(row) else None


def spread_long_table(names: list[str], table: list[list[str]]) -> tuple[list[str], list[list[str]]]:
    """Turn rows (time, parameter, value) into one column per parameter; give anything else as it is.

    Rows of one time become one row; where a parameter has no value then, its cell is blank. Further columns
    stay where they are the same in all rows of a time.
    """
    which = [k for k, name in enumerate(names) if PARAMETER.fullmatch(name)]
    value = [k for k, name in enumerate(names) if VALUE.fullmatch(name)]
    others = [k for k in range(len(names)) if k not in which + value]
    if not (which and len(value) == 1 and others):
        return names, table
    label = [".".join(row[k].strip() for k in which) for row in table]
    if NUMBER.fullmatch(label[0]):
        return names, table  # a numbered signal is a column of numbers
    parameters = list(dict.fromkeys(label))
    time = next((k for k in others if TIME.search(names[k])), others[0])
    spread: dict[str, list[str]] = {}
    for row, name in zip(table, label, strict=True):
        cells = spread.setdefault(row[time], [row[k] for k in others] + [""] * len(parameters))
        place = len(others) + parameters.index(name)
        if cells[place]:
            return names, table  # two values at one time: no table of samples
        cells[place] = row[value[0]]
    return [names[k] for k in others] + parameters, list(spread.values())


def without_repeats(path: Path, names: list[str], cells: list[tuple[str, ...]]) -> dict[str, tuple[str, ...]]:
    """Give the cells by name: a repeated column once; columns of one name that differ are numbered.

    Columns without a name are left out.
    """
    by_name: dict[str, tuple[str, ...]] = {}
    for name in dict.fromkeys(filter(None, names)):
        alike = list(
            dict.fromkeys(column for other, column in zip(names, cells, strict=True) if other == name)
        )
        if len(alike) == 1:
            by_name[name] = alike[0]
            continue
        numbered = [f"{name} ({k})" for k in range(1, len(alike) + 1)]
        logger.warning("%s: %d columns are called '%s'; they are '%s' here.", path, len(alike), name,
                       "', '".join(numbered))  # fmt: skip
        by_name |= dict(zip(numbered, alike, strict=True))
    return by_name
