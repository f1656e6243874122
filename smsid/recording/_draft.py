"""A draft of a mapping that imports as it stands: what is doubtful is commented out, with the reason."""

from __future__ import annotations

import json
import re
import tomllib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from smsid.errors import RecordingError
from smsid.recording import channel_checks
from smsid.recording._columns import Columns
from smsid.recording._guess import (
    COMMANDED,
    Group,
    are_counted,
    joined_by_quantity,
    joint_labels,
    rises_evenly,
)
from smsid.recording._importing import columns_to_recording
from smsid.recording._name_order import name_tokens
from smsid.recording.channels import EXTRA, QUANTITIES, Quantity
from smsid.recording.mapping import parse_mapping
from smsid.recording.recording import Recording

if TYPE_CHECKING:
    from smsid.recording.inspect import ClockReport

PER_TOPIC = (".stamp", ".time")


@dataclass(frozen=True)
class MappingDraft:
    """The text of a mapping, and which channels contradict each other in it."""

    text: str
    contradictions: tuple[str, ...]


@dataclass(frozen=True)
class _Entry:
    """A channel of the draft; ``reason`` says why it is commented out, empty where it is not."""

    channel: str
    group: Group
    clock: str | None
    rows: bytes
    time_axis: int = 0
    labels: tuple[str, ...] = ()
    reason: str = ""
    notes: tuple[str, ...] = field(default=())

    @property
    def source(self) -> str:
        return self.channel.partition(".")[0]

    def lines(self) -> list[str]:
        group = self.group
        lines = [f'[channel."{self.channel}"]', f"columns = [{', '.join(map(toml_string, group.columns))}]"]
        if self.time_axis:
            lines.append(f"time_axis = {self.time_axis}")
        if self.channel.endswith(".attitude") and self.source != EXTRA:
            counted = len(group.columns) == 4 and re.search(r"0\D*$", group.columns[0])  # from zero
            order = group.order or ("wxyz" if counted else "xyzw")
            guess = "" if group.order else " # guess: the names do not say"
            lines += [
                f'quaternion = "{order}"{guess}',
                'direction = "body_to_inertial" # guess; or "inertial_to_body"',
            ]
        else:
            unknown = "unknown" if group.quantity is None else "usual for the name; the file does not say"
            lines.append(f'unit = "{group.unit}"' + ("" if group.unit_written else f" # guess: {unknown}"))
        if self.labels:
            lines.append(f"labels = [{', '.join(map(toml_string, self.labels))}]")
        if self.reason:
            return [f"# Commented out: {_one_line(self.reason)}", *(f"# {line}" for line in lines)]
        return [*(f"# {_one_line(note)}" for note in self.notes), *lines]


def draft_mapping(
    path: Path, columns: Columns, clocks: Mapping[str, ClockReport], found: list[Group]
) -> MappingDraft:
    """Draft a mapping from guesses and try it on the columns; channels that it refuses are commented out.

    A fault of the data's clock, such as a gap, stays: it is for `import_recording` to tell.
    """
    entries = _with_sources(_entries(columns, clocks, found))
    entries = _one_extra_clock(entries)
    entries = _comment_out_refused(path, columns, clocks, entries)
    contradictions: tuple[str, ...] = ()
    recording = _import(path, columns, clocks, entries)
    if recording is not None:
        entries = _finite(entries, recording)
        recording = _import(path, columns, clocks, entries)
    if recording is not None:
        try:
            doubtful = recording.contradictions()
            contradictions = doubtful.sentences
            wrong = {f.channel: f"{f.sentence} {f.mend}" for f in doubtful.findings if f.clear}
        except RecordingError:
            contradictions, wrong = (), {}  # its clocks do not increase
        entries = [replace(e, reason=wrong.get(e.channel, "")) if not e.reason else e for e in entries]
        if not any(not e.reason for e in entries):  # the last one contradicts nothing
            entries = [replace(entries[0], reason=""), *entries[1:]]
    return MappingDraft(_text(columns, clocks, entries), contradictions)


def _entries(columns: Columns, clocks: Mapping[str, ClockReport], found: list[Group]) -> list[_Entry]:
    entries = []
    for group in joined_by_quantity(found, columns):
        if _part_of_array(group, columns):
            continue
        shape = columns[group.columns[0]].shape
        axis = 0
        clock = _clock_of(columns, clocks, group, shape[0])
        if clock is None and len(shape) == 2 and clocks:
            clock = _clock_of(columns, clocks, group, shape[1])
            axis = 1 if clock is not None else 0
        rows = b"" if group.rows is None else group.rows.tobytes()
        reason = ""
        if clock is None and clocks:
            reason = f"no column of times has its {shape[0]} samples"
        elif group.rows is not None and not group.rows.any():
            reason = "its cells are all blank"
        width = shape[1 - axis] if len(shape) == 2 else len(group.columns)
        usual = QUANTITIES.get(group.quantity or "")
        if usual is not None and not _fits(usual, width):
            group = replace(group, quantity=None, unit=group.unit if group.unit_written else usual.unit)
            usual = None
        name = usual.name if usual is not None else f"{EXTRA}.{_slug(group.stem) or 'column'}"
        labels = _labels(columns, group, width)
        notes = ("the order of the columns is the file's: their names do not tell one",)
        told = len(group.columns) == 1 or labels or group.order or name_tokens(group.columns)
        entries.append(_Entry(name, group, clock, rows, axis, labels, reason, () if told else notes))
    counted = {e.labels for e in entries if are_counted(e.labels)}
    if len(counted) > 1:  # one joint by two names: their numbers alone say which
        entries = [replace(e, labels=()) if e.labels in counted else e for e in entries]
    return entries


def _labels(columns: Columns, group: Group, width: int) -> tuple[str, ...]:
    """Joints' names: an array's own columns, where a bag has them by name as well, or the columns' names."""
    first, quantity = group.columns[0], group.quantity or ""
    if quantity.startswith("joint_") and columns[first].ndim == 2:
        named = [k.removeprefix(f"{first}.") for k in columns if _is_part(k, first, columns)]
        return tuple(named) if len(named) == width else ()
    return joint_labels(group) if quantity and len(group.columns) > 1 else ()


def _is_part(name: str, array: str, columns: Columns) -> bool:
    return name.startswith(f"{array}.") and columns[name].ndim == 1


def _fits(quantity: Quantity, width: int) -> bool:
    sizes = {"axis": 3, "quaternion": 4}
    return any(sizes.get(choice[-1], width) == width for choice in quantity.dims if len(choice) == 1)


def _clock_of(columns: Columns, clocks: Mapping[str, ClockReport], group: Group, samples: int) -> str | None:
    """Choose the clock of a group: as long as it, increasing, and nearest by name."""
    found = []
    for k, name in enumerate(clocks):
        times = columns[name]
        if times.size != samples:
            continue
        topic = next((name[: -len(s)] for s in PER_TOPIC if name.endswith(s)), None)
        own = topic is not None and group.columns[0].startswith(f"{topic}.")
        if topic and topic.startswith("/") and not own:
            continue  # another topic of a bag that happens to have as many messages
        kept = times if group.rows is None or group.rows.size != samples else times[group.rows]
        steps = np.diff(kept.astype(np.float64))
        good = bool(np.isfinite(kept).all() and (steps > 0.0).all())
        shared = len(_common_groups(name, group.columns[0]))
        stamp = name.endswith(".stamp")
        found.append((own, good, shared, stamp, -k, name))
    return max(found)[-1] if found else None


def _common_groups(a: str, b: str) -> str:
    """Give the folders, topics or structures that two names share."""
    parts, others = re.split(r"[./]", a), re.split(r"[./]", b)
    count = 0
    while count < min(len(parts), len(others)) - 1 and parts[count] == others[count]:
        count += 1
    return ".".join(parts[:count])


def _with_sources(entries: list[_Entry]) -> list[_Entry]:
    """Name sources so that each has one clock and one set of rows, and no quantity twice."""
    keys: dict[str, tuple[str | None, bytes]] = {}
    taken: set[str] = set()
    named = []
    for entry in entries:
        if entry.channel.startswith(f"{EXTRA}."):
            channel, number = entry.channel, 2
            while channel in taken:
                channel, number = f"{entry.channel}_{number}", number + 1
            taken.add(channel)
            named.append(replace(entry, channel=channel))
            continue
        key = (entry.clock, entry.rows)
        shared = _common_groups(entry.clock, entry.group.columns[0]) if entry.clock else ""
        commanded = COMMANDED.search(" ".join(entry.group.columns).lower())
        base = "command" if commanded else _slug(_topic(entry.clock) or shared) or "log"
        base = "log" if base == EXTRA else base
        source, number = base, 2
        while keys.get(source, key) != key or f"{source}.{entry.channel}" in taken:
            source, number = f"{base}{number}", number + 1
        keys[source] = key
        taken.add(f"{source}.{entry.channel}")
        named.append(replace(entry, channel=f"{source}.{entry.channel}"))
    return named


def _topic(clock: str | None) -> str:
    return next((clock[: -len(s)] for s in PER_TOPIC if clock and clock.endswith(s)), "")


def _one_extra_clock(entries: list[_Entry]) -> list[_Entry]:
    extras = Counter((e.clock, e.rows) for e in entries if e.source == EXTRA and not e.reason)
    if len(extras) < 2:
        return entries
    (kept, _), *_ = extras.most_common(1)
    reason = "channels 'extra' share one clock and this one has another; name its quantity, or map it apart"
    return [
        replace(e, reason=reason) if e.source == EXTRA and not e.reason and (e.clock, e.rows) != kept else e
        for e in entries
    ]


def _comment_out_refused(
    path: Path, columns: Columns, clocks: Mapping[str, ClockReport], entries: list[_Entry]
) -> list[_Entry]:
    """Comment out what the importer refuses: one channel after the other, if not all at once."""
    try:
        _import(path, columns, clocks, entries, raises=True)
        return entries
    except RecordingError:
        pass
    good: list[_Entry] = []
    refused: dict[str, str] = {}
    for entry in entries:
        if entry.reason:
            continue
        try:
            _import(path, columns, clocks, [*good, entry], raises=True)
            good.append(entry)
        except RecordingError as error:
            refused[entry.channel] = error.message.removeprefix(f"{path}: ").removeprefix(f"{path}, ")
    return [replace(e, reason=refused.get(e.channel, e.reason)) for e in entries]


def _import(
    path: Path,
    columns: Columns,
    clocks: Mapping[str, ClockReport],
    entries: list[_Entry],
    *,
    raises: bool = False,
) -> Recording | None:
    if all(entry.reason for entry in entries):
        return None
    try:
        rules = parse_mapping(tomllib.loads(_text(columns, clocks, entries)))
        return columns_to_recording(path, rules, columns)
    except RecordingError:
        if raises:
            raise
        return None


def _finite(entries: list[_Entry], recording: Recording) -> list[_Entry]:
    """Comment out channels with samples that are not finite, and quaternions that are none."""
    found = []
    for entry in entries:
        reason = entry.reason
        if not reason:
            one = recording.without(*(name for name in recording.channels if name != entry.channel))
            try:
                channel_checks.check_finite(one)
                channel_checks.check_quaternions(one)
            except RecordingError as error:
                reason = error.message
        found.append(replace(entry, reason=reason))
    return found


def _text(columns: Columns, clocks: Mapping[str, ClockReport], entries: list[_Entry]) -> str:
    lines = ["# Drafted by `smsid inspect`: check every line; what is a guess says so.", ""]
    active = [entry for entry in entries if not entry.reason]
    used = Counter(entry.clock for entry in active if entry.clock)
    plain = [name for name in used if not _topic(name).startswith("/")]
    shared = max(plain, key=lambda name: used[name]) if plain else None
    if not clocks:
        even = [name for name, values in columns.items() if rises_evenly(values)]
        lines += ["[time]", "rate = 100.0 # [Hz] guess: no column is named as a time"]
        lines += [
            f"# column = {toml_string(name)} # rises evenly: if it is the time, state its unit"
            for name in even[:3]
        ]
        lines.append("")
    elif shared is not None:
        lines += ["[time]", *_clock_lines(clocks[shared]), ""]
    sources = {entry.source: entry.clock for entry in active}
    for source, clock in sources.items():
        if clock is not None and clock != shared:
            lines += [f"[clock.{source}]", *_clock_lines(clocks[clock]), ""]
    for entry in entries:
        lines += [*_with_labels(entry, active).lines(), ""]
    if not entries:
        lines.append("# Nothing in the file can be drafted: name the columns yourself.")
    large = [f"{toml_string(name)} {values.shape}" for name, values in columns.items() if values.ndim > 2]
    if large:
        lines.append(_one_line(f"# Not drafted, of more than two dimensions: {', '.join(large)}"))
    return "\n".join(lines).rstrip() + "\n"


def _with_labels(entry: _Entry, active: list[_Entry]) -> _Entry:
    """Label joints where sources have different numbers of them."""
    if ".joint_" not in entry.channel or entry.labels or entry.source == EXTRA:
        return entry
    counts = {
        len(e.labels or e.group.columns) for e in active if ".joint_" in e.channel and e.source != EXTRA
    }
    if len(counts) < 2:
        return entry
    others = [e for e in active if e.source == entry.source and ".joint_" in e.channel]
    return replace(entry, labels=(others or [entry])[0].group.columns)


def _clock_lines(clock: ClockReport) -> list[str]:
    guess = "" if clock.unit_written else " # guess: from the size of its steps"
    return [f"column = {toml_string(clock.name)}", f'unit = "{clock.unit}"{guess}']


def _part_of_array(group: Group, columns: Columns) -> bool:
    """A joint that a bag gives by name as well is in the array of all joints already."""
    names = [group.columns[0][: k.start()] for k in re.finditer(r"\.", group.columns[0])]
    return any(name in columns and columns[name].ndim == 2 for name in names)


def _slug(text: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")


def _one_line(text: str) -> str:
    return re.sub(r"[\x00-\x1f\x7f]+", " ", text)


def toml_string(text: str) -> str:
    """Write a text as a string of TOML."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
