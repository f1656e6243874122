"""Messages of one topic, gathered field by field into columns."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smsid.recording.columns import Columns, without_samples

CLOCKS = (".time", ".stamp")
LARGEST_MESSAGE = 4096
"""Numbers of a message beyond which it is no signal: images, point clouds."""


def columns_of(topics: Iterable[Topic], path: Path) -> Columns:
    """Return the columns of all topics of a file; raises `RecordingError` if there are none."""
    columns = Columns()
    for topic in topics:
        columns.update(topic.columns())
    if not columns:
        raise without_samples(path, "messages with numbers", "Is it the right bag?")
    columns.units.update({name: "s" for name in columns if name.endswith(CLOCKS)})
    return columns


class Topic:
    """The messages of one topic, gathered field by field."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.fields: dict[str, list[Any]] = {}
        self.times: list[float] = []
        self.stamps: list[float] = []
        self.by_name: dict[str, list[tuple[float, float, tuple[str, ...], Any]]] = {}
        self.skipped = False

    def add(
        self, time: float, stamp: float | None, values: dict[str, Any], names: tuple[str, ...] = ()
    ) -> None:
        """Add the numbers of a message that was recorded at a time and has a stamp of its own, or none [s].

        ``names`` are those of the elements of arrays as long.
        """
        if sum(np.size(v) for v in values.values()) > LARGEST_MESSAGE:
            self.skipped = True
            return
        own = time if stamp is None else stamp
        if stamp is not None:
            self.stamps.append(stamp)
        self.times.append(time)
        for key, value in values.items():
            if names and np.shape(value) == (len(names),):
                self.by_name.setdefault(key, []).append((time, own, names, value))
            else:
                self.fields.setdefault(key, []).append(value)

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return the columns of the topic, empty if its messages are no signals."""
        if self.skipped or not self.times:
            return {}
        found: dict[str, NDArray[Any]] = {}
        # the headers' stamps are times where every message has one and they are not left at zero
        messages = len(self.times)
        stamped = len(self.stamps) == messages and (messages < 2 or len(set(self.stamps)) > 1)
        sets: dict[frozenset[str], tuple[str, ...]] = {}  # one order of each, the first
        for _, _, names, _ in (row for rows in self.by_name.values() for row in rows):
            sets.setdefault(frozenset(names), names)
        groups = list(sets.values())
        if len(groups) < 2:
            found[f"{self.name}.time"] = np.array(self.times)
            if stamped:
                found[f"{self.name}.stamp"] = np.array(self.stamps)
        for members in groups:
            # Several publishers: each set of names has times of its own.
            where = self.name if len(groups) == 1 else f"{self.name}.{members[0]}"
            found |= self._named(where, members, stamped)
        for key, values in self.fields.items():
            if len(values) != len(self.times) or len({np.shape(v) for v in values}) != 1:
                continue
            array = np.array(values, dtype=np.float64)
            if array.size:
                found[f"{self.name}.{key}"] = array
        return found

    def _named(self, where: str, members: tuple[str, ...], stamped: bool) -> dict[str, NDArray[Any]]:
        """Give the arrays of one set of names, (N, names) in the order of its first message."""
        found: dict[str, NDArray[Any]] = {}
        for key, rows in self.by_name.items():
            own = [row for row in rows if set(row[2]) == set(members)]
            if not own:
                continue
            if f"{where}.time" not in found and where != self.name:
                found[f"{where}.time"] = np.array([row[0] for row in own])
                if stamped:
                    found[f"{where}.stamp"] = np.array([row[1] for row in own])
            array = np.array([[row[3][row[2].index(name)] for name in members] for row in own])
            times = len(self.times) if where == self.name else found[f"{where}.time"].size
            if array.shape[0] != times:
                continue  # a field that only some messages fill
            found[f"{where}.{key}"] = array
            found |= {f"{where}.{key}.{name}": array[:, k] for k, name in enumerate(members)}
        return found
