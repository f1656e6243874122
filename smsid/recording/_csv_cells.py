"""Numbers as people write them into the cells of a table."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smsid.recording._units import unit_word

NO_SAMPLE = frozenset(
    {"", "na", "n/a", "#n/a", "n.a.", "null", "none", "-", "--", "---", "?"}
    | {"#value!", "#ref!", "#div/0!", "#num!", "#name?", "#null!", "#wert!"}
)
"""Cells, in lower case, that say there is no sample. ``nan`` is a sample that is no number."""
NUMBER = re.compile(r"[-+\u2212]?(\d+([.,]\d*)?|[.,]\d+)([eEdD][-+]?\d+)?|[-+]?(?i:nan|inf)")
THOUSANDS = re.compile(r"[-+]?\d{1,3}(,\d{3})+(\.\d*)?")
WITH_UNIT = re.compile(r"([-+]?[\d.,]+(?:[eE][-+]?\d+)?)\s*([^\d\s.,+-].*)")
LIST = re.compile(r"\s*[\[({](.*)[\])}]\s*")


def read_cells(
    cells: Sequence[str], decimal: str, missing: Sequence[str] = ()
) -> tuple[NDArray[Any], NDArray[np.bool_], str | None]:
    """Read a column: its numbers (N,), lists (N, k) or text (N,); where it is blank (N,); its cells' unit."""
    none = NO_SAMPLE | {word.strip().lower() for word in missing}
    blank = np.array([cell.strip().lower() in none for cell in cells])
    kept = [cell for cell, empty in zip(cells, blank, strict=True) if not empty]
    unit = None
    for repair in (None, _repair_numbers, _without_unit):
        try:
            if repair is not None:
                kept, found = repair(kept)
                unit = found or unit
            numbers = np.full(len(cells), np.nan)
            numbers[~blank] = [parse_number(cell, decimal) for cell in kept]
            return numbers, blank, unit
        except ValueError:
            continue
    rows = [LIST.fullmatch(cell) for cell in kept]
    if kept and all(rows):
        try:
            listed = [
                [float(word) for word in re.split(r"[\s,;]+", row.group(1).strip())] for row in rows if row
            ]
            lists = np.full((len(cells), len(listed[0])), np.nan)
            lists[~blank] = np.array(listed)
            return lists, blank, None
        except ValueError:  # words, or lists of different lengths
            pass
    return np.array(cells), blank, None


def _repair_numbers(cells: list[str]) -> tuple[list[str], None]:
    """Write minus signs, the exponents of Fortran and groups of thousands as Python does."""
    grouped = [cell for cell in cells if "," in cell]
    thousands = bool(grouped) and all(THOUSANDS.fullmatch(cell.strip()) for cell in grouped)
    found = []
    for cell in cells:
        text = re.sub(r"(?<=[\d.])[dD](?=[-+]?\d)", "e", cell.replace("\u2212", "-"))
        found.append(text.replace(",", "") if thousands else text)
    return found, None


def _without_unit(cells: list[str]) -> tuple[list[str], str | None]:
    """Take away a unit that every cell states; raise ValueError where they do not."""
    matches = [WITH_UNIT.fullmatch(cell.strip()) for cell in cells]
    units = {match.group(2).strip() if match else "" for match in matches}
    unit = unit_word(next(iter(units))) if len(units) == 1 else None
    if unit is None:
        raise ValueError(units)
    return [match.group(1) for match in matches if match], unit


def parse_number(cell: str, decimal: str = ".") -> float:
    """Read a number; raise ValueError for anything else, such as the digit groups ``1_000``."""
    if "_" in cell or (decimal == "," and "." in cell):
        raise ValueError(cell)
    return float(cell.replace(",", ".") if decimal == "," else cell)


def sniff_decimal(table: list[list[str]], delimiter: str) -> str:
    """A comma inside cells is the decimal sign if no number has a point.

    Not so between commas where every one may group thousands: ``"1,000"``.
    """
    cells = [cell.strip() for row in table[:100] for cell in row]
    commas = [cell for cell in cells if re.fullmatch(r"[-+]?\d*,\d+([eE][-+]?\d+)?", cell)]
    point = any(re.fullmatch(r"[-+]?\d*\.\d+([eE][-+]?\d+)?", cell) for cell in cells)
    grouped = delimiter == "," and all(re.fullmatch(r"[-+]?[1-9]\d{0,2},\d{3}", cell) for cell in commas)
    return "," if commas and not point and not grouped else "."
