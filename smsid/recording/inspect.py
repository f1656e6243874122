"""What is in a log file: columns, rates, gaps, ranges, what looks wrong, and a draft of the mapping to
import it.
"""

from __future__ import annotations

import logging
import os
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smsid.errors import RecordingError
from smsid.recording._clock import find_gaps
from smsid.recording._guess import Group, groups, is_clock, suspicion, written_unit
from smsid.recording.importing import import_recording
from smsid.recording.mapping import ImportMapping, load_mapping, parse_mapping
from smsid.recording.readers import read_columns

logger = logging.getLogger(__name__)

Columns = Mapping[str, NDArray[Any]]
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
PER_TOPIC = (".stamp", ".time")


@dataclass(frozen=True)
class ClockReport:
    """A column of times: ``unit`` guessed, ``rate`` [Hz] of the median step, ``jitter`` the standard
    deviation of the steps relative to it, ``duplicates`` and ``backwards`` steps, ``gaps`` as sentences.
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
    path: str | os.PathLike[str], mapping: str | os.PathLike[str] | ImportMapping | None = None
) -> FileReport:
    """Look into a log of any format that `read_columns` reads.

    Nothing is converted and nothing decided: units and meanings are guessed from names and sizes. Channels
    that contradict each other (a rate that is not the derivative of its angle, by unit or sign) are found by
    importing the log with ``mapping``, or with the drafted one.

    Args:
        path: the log.
        mapping: what the columns are; None takes the draft.

    Raises:
        RecordingError: the file cannot be read, or the given mapping does not fit it.
        MissingDependencyError: its reader needs an extra.
    """
    rules = None if mapping is None else load_mapping(mapping)
    columns = read_columns(path, None if rules is None else rules.csv.format())
    clocks = {name: _clock(name, values) for name, values in columns.items() if is_clock(name, values)}
    found = groups(columns, set(clocks))
    doubts: list[str] = []
    for clock in clocks.values():
        if clock.backwards:
            doubts.append(
                f"'{clock.name}' goes back {clock.backwards} times: rows are reordered, or a new run starts."
            )
        if clock.duplicates:
            doubts.append(f"'{clock.name}' repeats {clock.duplicates} times: duplicated rows?")
        doubts += [f"'{clock.name}' has a gap of {gap}." for gap in clock.gaps]
        if clock.jitter > 0.05 and not clock.backwards:
            doubts.append(
                f"'{clock.name}' jitters: its steps vary by {100 * clock.jitter:.0f} %; resample it."
            )
    if not clocks:
        doubts.append("No column looks like times: state the rate.")
    for group in found:
        doubt = suspicion(group, _stacked(columns, group))
        doubts += [doubt] if doubt else []
    reports = tuple(_column(name, values) for name, values in columns.items())
    doubts += [f"'{c.name}' has {c.not_finite} samples that are not finite." for c in reports if c.not_finite]
    doubts += [f"'{name}' is text." for name, values in columns.items() if values.dtype.kind not in "fiub"]
    drafted = draft(columns, clocks, found)
    doubts += _contradictions(path, rules, drafted, doubts)
    return FileReport(str(path), tuple(clocks.values()), reports, tuple(doubts), drafted)


def _contradictions(
    path: str | os.PathLike[str], rules: ImportMapping | None, drafted: str, doubts: list[str]
) -> list[str]:
    """Say which channels contradict each other, once imported; how a log with doubts fails is no news."""
    try:
        known = rules or parse_mapping(tomllib.loads(drafted))
        return import_recording(path, known, check=False).suspicious()
    except RecordingError as error:
        if rules is not None and not doubts:
            raise
        logger.info("%s is not compared channel by channel: %s", path, error)
        return [] if doubts or rules is None else [str(error)]


def draft(columns: Columns, clocks: Mapping[str, ClockReport], found: list[Group]) -> str:
    """Return a mapping file in TOML from guesses; what needs a decision is in comments."""
    lines = ["# Drafted by `smsid inspect`: check every line.", ""]
    sources: dict[str, str] = {}
    shared = next((c for c in clocks.values() if not c.name.endswith(PER_TOPIC)), None)
    if shared is not None:
        lines += ["[time]", f"column = {_quoted(shared.name)}", f'unit = "{shared.unit}"', ""]
    elif not clocks:
        lines += ["[time]", "rate = 100.0 # [Hz] no column of times was found", ""]
    taken: set[str] = set()
    body: list[str] = []
    for group in found:
        if _part_of_array(group, columns):
            continue
        topic = next((c[: -len(s)] for c in clocks for s in PER_TOPIC if _belongs(group, c, s)), None)
        source = sources.setdefault(topic or "", _source(topic) if topic else "log")
        if group.quantity in (None, "current"):
            name = re.sub(r"\W+", "_", group.stem).strip("_").lower() or "column"
            channel = f"extra.{name}"
        else:
            channel = f"{source}.{group.quantity}"
        commented = "# " if channel in taken else ""
        taken |= set() if commented else {channel}
        table = [f'[channel."{channel}"]', f"columns = [{', '.join(map(_quoted, group.columns))}]"]
        if group.quantity == "attitude":
            table += [
                'quaternion = "xyzw" # or "wxyz"',
                'direction = "body_to_inertial" # or "inertial_to_body"',
            ]
        else:
            guess = " # unknown" if group.quantity is None else " # usual for the name; the file does not say"
            known = "" if group.unit_written else guess
            table += [f'unit = "{group.unit}"{known}']
        body += [*(f"{commented}{line}" for line in table), ""]
    for topic, source in sources.items():
        if topic:
            clock = next(c for s in PER_TOPIC for c in clocks if c == f"{topic}{s}")
            if any(name.startswith(f"{source}.") for name in taken):
                lines += [f"[clock.{source}]", f"column = {_quoted(clock)}", 'unit = "s"', ""]
    return "\n".join([*lines, *body]).rstrip() + "\n"


def _clock(name: str, values: NDArray[Any]) -> ClockReport:
    times = values[np.isfinite(values)]
    steps = np.diff(times)
    forward = steps[steps > 0.0]
    step = float(np.median(forward))
    unit = written_unit(name)
    if unit not in SECONDS:
        # A log of less than 2 Hz or more than 1 MHz is rarer than one whose clock counts in another unit.
        unit = "s" if step < 0.5 else "ms" if step < 500.0 else "us" if step < 5e5 else "ns"
    scale = SECONDS[unit]
    gaps = find_gaps(np.unique(times) * scale, name)
    regular = forward[forward < 5.0 * step]
    return ClockReport(
        name, unit, int(times.size), float(times[0]), float(times[-1]), 1.0 / (step * scale),
        float(np.std(regular) / step), int(np.sum(steps == 0.0)), int(np.sum(steps < 0.0)),
        tuple(str(gap) for gap in gaps),
    )  # fmt: skip


def _column(name: str, values: NDArray[Any]) -> ColumnReport:
    if values.dtype.kind not in "fiub" or values.size == 0:
        return ColumnReport(name, values.shape, float("nan"), float("nan"), 0, False)
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (float("nan"), float("nan"))
    return ColumnReport(name, values.shape, low, high, int(values.size - finite.size), low == high)


def _stacked(columns: Columns, group: Group) -> NDArray[Any]:
    first = columns[group.columns[0]]
    if first.ndim == 2:
        return first
    same = [columns[name] for name in group.columns if columns[name].shape == first.shape]
    return np.stack(same, axis=1)


def _belongs(group: Group, clock: str, suffix: str) -> bool:
    return clock.endswith(suffix) and group.columns[0].startswith(f"{clock[: -len(suffix)]}.")


def _part_of_array(group: Group, columns: Columns) -> bool:
    """A joint that a bag gives by name as well is in the array of all joints already."""
    names = [group.columns[0][: k.start()] for k in re.finditer(r"\.", group.columns[0])]
    return any(name in columns and columns[name].ndim == 2 for name in names)


def _source(topic: str) -> str:
    return re.sub(r"\W+", "_", topic).strip("_").lower() or "log"


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
