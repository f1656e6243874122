"""Samples put in order: late, repeated and unknown ones are named, those of one moment go together."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

MOST_EVENTS = 1000  # that are remembered; all are counted

EventKind = Literal["late", "ahead", "duplicate", "unknown channel", "not finite", "silence", "begun", "lost"]


@dataclass(frozen=True)
class Event:
    """Something that happened to the stream at a time [s]: what kind, to which channel, in words."""

    time: float
    kind: str
    channel: str
    text: str


@dataclass(eq=False)
class EventLog:
    """The last events, and how many there were of each kind."""

    last: deque[Event] = field(default_factory=lambda: deque(maxlen=MOST_EVENTS))
    counts: dict[str, int] = field(default_factory=dict)

    def add(self, time: float, kind: EventKind, channel: str, text: str) -> None:
        """Remember an event."""
        self.last.append(Event(time, kind, channel, text))
        self.counts[kind] = self.counts.get(kind, 0) + 1

    @property
    def total(self) -> int:
        """Number of events there were."""
        return sum(self.counts.values())


@dataclass(frozen=True, eq=False)
class MomentEvents:
    """What came of one moment [s], by channel."""

    time: float
    channels: dict[str, np.ndarray]


@dataclass(eq=False)
class SampleBuffer:
    """Moments not yet taken in, in order of time.

    Channels within ``together`` [s] are of one moment. A moment is handed out when one came that is
    ``lateness`` [s] later. ``passed`` is the last that was handed out, and ``read`` what was read then.
    After a silence of ``silence`` [s] a moment waits for a later one: where time goes on before it instead,
    its clock was wrong, and all that comes would be late after it.
    """

    together: float
    lateness: float
    log: EventLog
    silence: float = np.inf
    waiting: list[MomentEvents] = field(default_factory=list)
    passed: float = -np.inf
    read: set[str] = field(default_factory=set)
    newest: float = -np.inf

    def add(self, time: float, channels: Mapping[str, np.ndarray]) -> None:
        """Take in channels (k,) read at a time; those too late or there already are named and left out."""
        if time < self.passed - self.together:
            for channel in channels:
                text = f"came {self.passed - time:.3g} s late and is left out"
                self.log.add(time, "late", channel, text)
            return
        own = dict(channels)
        if abs(time - self.passed) <= self.together:
            time = self.passed
            for channel in [c for c in own if c in self.read]:
                self.log.add(time, "duplicate", channel, "came again and is left out")
                del own[channel]
        if not own:
            return
        if self._doubtful and time < self.waiting[-1].time - self.silence:
            wrong = self.waiting.pop()
            for channel in wrong.channels:
                text = f"is {wrong.time - time:.3g} s ahead of what came after it and is left out"
                self.log.add(wrong.time, "ahead", channel, text)
        i = bisect_left([e.time for e in self.waiting], time)
        for entry in self.waiting[max(0, i - 1) : i + 1]:
            if abs(entry.time - time) <= self.together:
                for channel, value in own.items():
                    if channel in entry.channels:
                        self.log.add(time, "duplicate", channel, "came again and is left out")
                    else:
                        entry.channels[channel] = value
                return
        self.waiting.insert(i, MomentEvents(time, own))

    @property
    def _doubtful(self) -> bool:
        """Whether the last moment came after a silence, and none since."""
        before = self.waiting[-2].time if len(self.waiting) > 1 else self.passed
        return bool(self.waiting) and np.isfinite(before) and self.waiting[-1].time > before + self.silence

    def ready(self, *, everything: bool = False) -> list[MomentEvents]:
        """Hand out the moments whose time has come, or everything."""
        sure = self.waiting[: len(self.waiting) - self._doubtful]
        self.newest = max(self.newest, sure[-1].time) if sure else self.newest
        limit = np.inf if everything else self.newest - self.lateness
        count = sum(e.time <= limit for e in self.waiting)
        found, self.waiting = self.waiting[:count], self.waiting[count:]
        for entry in found:
            if entry.time > self.passed:
                self.passed, self.read = entry.time, set()
            self.read |= set(entry.channels)
        return found
