"""What is in a log file: columns, rates, gaps, ranges, what looks wrong, and a draft of the mapping to
import it.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smsid.errors import RecordingError
from smsid.recording._columns import Columns
from smsid.recording._draft import draft_mapping, toml_string
from smsid.recording._guess import Group, groups, is_clock, stated_unit, suspicion
from smsid.recording._importing import import_recording, is_number
from smsid.recording._units import convert
from smsid.recording.clock import find_gaps
from smsid.recording.mapping import ImportMapping, load_mapping
from smsid.recording.readers import read_joined

logger = logging.getLogger(__name__)

MIN_CHANGES = 20
"""Fewer changes of a signal do not tell whether it is held."""

EPOCHS = (("ns", 5e17, 4e18), ("us", 5e14, 4e15), ("ms", 5e11, 4e12))
"""Times since 1970 in each unit, from 1985 to 2096."""

DAYS = ((2e4, 8e4), (6.9e5, 7.7e5))
"""Dates as spreadsheets (days since 1900) and MATLAB (since the year 0) count them, from 1954 on."""

SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "day": 86400.0}


@dataclass(frozen=True)
class ClockReport:
    """A column of times: ``unit`` as a mapping or the file states it, else guessed; ``rate`` [Hz] of the
    median step, ``jitter`` the standard deviation of the steps relative to it, ``duplicates`` and
    ``backwards`` steps, ``gaps`` as sentences, the longest of them; ``unit_written`` whether the unit is
    stated; ``newest_first`` whether times only decrease.
    """

    name: str
    unit: str
    samples: int
    start: float
    end: float
    rate: float
    jitter: float
    duplicates: int
    backwards: int
    gaps: tuple[str, ...]
    unit_written: bool = False
    longest_gap: str = ""
    newest_first: bool = False


@dataclass(frozen=True)
class ColumnReport:
    """A column or array: shape, smallest and largest value (NaN for text), samples that are not finite."""

    name: str
    shape: tuple[int, ...]
    low: float
    high: float
    not_finite: int
    constant: bool


@dataclass(frozen=True)
class FileReport:
    """All of a file. ``suspicions`` are sentences; ``mapping`` is TOML, to be checked and completed by
    hand.
    """

    path: str
    clocks: tuple[ClockReport, ...]
    columns: tuple[ColumnReport, ...]
    suspicions: tuple[str, ...]
    mapping: str


def inspect_file(
    path: str | os.PathLike[str],
    mapping: str | os.PathLike[str] | ImportMapping | None = None,
    *,
    also: Sequence[str | os.PathLike[str]] = (),
) -> FileReport:
    """Look into a log of any format that `read_columns` reads.

    Nothing is converted and nothing decided: units and meanings are guessed from names and sizes. Channels
    that contradict each other (a rate that is not the derivative of its angle, by unit or sign) are found by
    importing the log with ``mapping``, or with the drafted one.

    Args:
        path: the log.
        mapping: what the columns are; None takes the draft.
        also: files with more columns of the same log, see `read_joined`.

    Raises:
        RecordingError: the file cannot be read, or the given mapping does not fit it.
        MissingDependencyError: its reader needs an extra.
    """
    rules = None if mapping is None else load_mapping(mapping)
    columns = read_joined(path, also, None if rules is None else rules.csv)
    joined = {part for name in columns if " + " in name for part in name.split(" + ") if part in columns}
    units = {} if rules is None else _stated_units(rules)
    clocks = {
        name: _clock(columns, name, units.get(name))
        for name, values in columns.items()
        if name not in joined and is_clock(name, values, surely=name in columns.times)
    }
    found = groups(columns, set(clocks) | joined)
    doubts = []
    for name, clock in clocks.items():
        for own in _by_source(columns, name, found, units.get(name)) or [clock]:
            doubts += [said for said in _clock_doubts(own) if said not in doubts]
    if not clocks:
        doubts.append("No column looks like times: state the rate.")
    for group in found:
        values = _stack_samples(columns, group)
        doubts += [doubt] if (doubt := suspicion(group, values)) else []
        doubts += [doubt] if (doubt := _held_samples_note(columns, clocks, group)) else []
    reports = tuple(_column(columns, name) for name in columns)
    doubts += [f"'{c.name}' has {c.not_finite} samples that are not finite." for c in reports if c.not_finite]
    texts = [name for name, values in columns.items() if values.dtype.kind not in "fiub"]
    nearly = {name: sentence for name in texts if (sentence := words_among_numbers(name, columns[name]))}
    doubts += nearly.values()
    if texts := [name for name in texts if name not in nearly]:
        doubts.append(f"Text, not numbers: {', '.join(texts)}.")
    drafted = draft_mapping(Path(path), columns, clocks, found)
    if rules is None:
        told = any("changes only every" in d for d in doubts)  # by column, before any mapping
        doubts += [c for c in drafted.contradictions if not (told and "it holds data of" in c)]
    else:
        doubts += _contradictions(path, rules, doubts, also)
    return FileReport(str(path), tuple(clocks.values()), reports, tuple(doubts), drafted.text)


def words_among_numbers(name: str, cells: NDArray[Any]) -> str | None:
    """Say which cells of a column (N,) are no numbers where most are; None for a column of text."""
    if cells.ndim != 1 or cells.dtype.kind != "U":
        return None
    words = [k for k, cell in enumerate(cells) if not is_number(str(cell))]
    if len(words) > cells.size // 5:
        return None
    if not words:
        return f"'{name}' has points and commas in its numbers: state [csv] decimal, or mend the others."
    cell = str(cells[words[0]])
    return (
        f"'{name}' is no column of numbers for {len(words)} of {cells.size} cells, the first '{cell}' in row "
        f"{words[0] + 1} after the header: mend them, or state [csv] missing = [{toml_string(cell)}]."
    )


def _contradictions(
    path: str | os.PathLike[str],
    rules: ImportMapping,
    doubts: list[str],
    also: Sequence[str | os.PathLike[str]],
) -> list[str]:
    """Say which channels contradict each other, once imported; how a log with doubts fails is no news."""
    try:
        return import_recording(path, rules, check=False, also=also).suspicious()
    except RecordingError as error:
        if not doubts:
            raise
        logger.info("%s is not compared channel by channel: %s", path, error)
        return []


def _clock_doubts(clock: ClockReport) -> list[str]:
    """Say what is wrong with a clock, each kind of fault in one sentence."""
    doubts = []
    if clock.newest_first:
        doubts.append(f"'{clock.name}' runs backwards, newest sample first: import turns the rows round.")
    if clock.backwards:
        doubts.append(
            f"'{clock.name}' goes back {clock.backwards} times: rows are reordered, or a new run starts."
        )
    if clock.duplicates:
        doubts.append(f"'{clock.name}' repeats {clock.duplicates} times: duplicated rows?")
    if len(clock.gaps) == 1:
        doubts.append(f"'{clock.name}' has a gap of {clock.gaps[0]}.")
    elif clock.gaps:
        doubts.append(f"'{clock.name}' has {len(clock.gaps)} gaps; the longest is {clock.longest_gap}.")
    if clock.jitter > 0.05 and not clock.backwards:
        doubts.append(f"'{clock.name}' jitters: its steps vary by {100 * clock.jitter:.0f} %; resample it.")
    return doubts


def _by_source(columns: Columns, name: str, found: Sequence[Group], mapped: str | None) -> list[ClockReport]:
    """Return a clock as each source of a table has it that leaves the others' cells of its rows blank."""
    times = columns[name]
    own = {g.rows.tobytes(): g for g in found if g.rows is not None and g.rows.shape == times.shape}
    if any(g.rows is None and len(columns[g.columns[0]]) == len(times) for g in found):
        return []  # something has a value in every row
    return [
        _clock(columns, name, mapped, g.rows, f"{name}' of '{g.stem}")
        for g in own.values()
        if g.rows is not None and len(np.unique(times[g.rows])) > 1
    ]


def _held_samples_note(columns: Columns, clocks: dict[str, ClockReport], group: Group) -> str | None:
    """Say that a sensor is slower than its log: its samples change at every k-th row only, evenly."""
    values = columns[group.columns[0]]
    if values.ndim != 1 or group.rows is not None:
        return None
    held = held_samples(_stack_samples(columns, group))
    if held is None:
        return None
    rate = next((c.rate for c in clocks.values() if c.samples == values.size), None)
    told = f"{rate / held:.4g} Hz data in a {rate:.4g} Hz log" if rate else "a slow sensor in a fast log"
    return f"'{group.stem}' changes only every {held} samples: {told}; resample it to that rate."


def held_samples(values: NDArray[Any]) -> int | None:
    """Count the rows that each sample is held for, or None where the values are not held evenly.

    Args:
        values: (N, k).
    """
    changed = np.flatnonzero(np.any(np.diff(values, axis=0) != 0.0, axis=1))
    if changed.size < MIN_CHANGES:
        return None
    runs = np.diff(changed)
    middle = int(np.median(runs))
    even = float(np.mean(np.abs(runs - middle) <= max(1, middle // 10))) > 0.95 and float(runs.min()) > 1
    # A square wave changes evenly, too, but between few values.
    many = np.unique(values[changed + 1], axis=0).shape[0] > changed.size // 4
    return middle if middle > 1 and even and many else None


def _stated_units(rules: ImportMapping) -> dict[str, str]:
    """Return the units that a mapping states of its columns of times, by column."""
    tables = (rules.time, *rules.clock.values())
    return {t.column: t.unit for t in tables if t is not None and t.column is not None and t.unit is not None}


def _clock(
    columns: Columns, name: str, mapped: str | None, rows: NDArray[np.bool_] | None = None, called: str = ""
) -> ClockReport:
    """Return a clock in the unit that a mapping states; without one as written in the file, or guessed."""
    values = columns[name] if rows is None else columns[name][rows]
    times = values[np.isfinite(values)].astype(np.float64)
    steps = np.diff(times)
    reversed_ = bool((steps < 0.0).all())
    steps = -steps if reversed_ else steps
    forward = steps[steps > 0.0]
    step = float(np.median(forward))
    own = stated_unit(columns, name)
    unit = mapped or (own if own in SECONDS else None)
    written = unit is not None
    if unit is None:
        epoch = [word for word, low, high in EPOCHS if low < abs(float(np.median(times))) < high]
        # A log of less than 2 Hz or more than 1 MHz is rarer than one whose clock counts in another unit.
        by_step = "s" if step < 0.5 else "ms" if step < 500.0 else "us" if step < 5e5 else "ns"
        if step < 1e-3 and any(low < float(np.median(times)) < high for low, high in DAYS):
            by_step = "day"
        unit = epoch[0] if epoch else by_step
    scale = SECONDS[unit] if unit in SECONDS else float(convert(np.ones(1), unit, "s", f"'{name}'")[0])
    gaps = find_gaps(np.unique(times) * scale, name)
    regular = forward[forward < 5.0 * step]
    longest = str(max(gaps, key=lambda gap: gap.duration)) if gaps else ""
    return ClockReport(
        called or name, unit, int(times.size), float(times[0]), float(times[-1]), 1.0 / (step * scale),
        float(np.std(regular) / step), int(np.sum(steps == 0.0)), int(np.sum(steps < 0.0)),
        tuple(str(gap) for gap in gaps), written, longest, reversed_,
    )  # fmt: skip


def _column(columns: Columns, name: str) -> ColumnReport:
    values = columns[name]
    if values.dtype.kind not in "fiub" or values.size == 0:
        return ColumnReport(name, values.shape, float("nan"), float("nan"), 0, False)
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (float("nan"), float("nan"))
    blank = int(columns.missing(name).sum()) if values.ndim else 0
    return ColumnReport(name, values.shape, low, high, int(values.size - finite.size) - blank, low == high)


def _stack_samples(columns: Columns, group: Group) -> NDArray[Any]:
    """Give the samples of a group, (N, k), without rows that are blank."""
    first = columns[group.columns[0]]
    if first.ndim == 2:
        return first
    same = [columns[name] for name in group.columns if columns[name].shape == first.shape]
    stacked = np.stack(same, axis=1).astype(np.float64)
    return stacked if group.rows is None else stacked[group.rows]
