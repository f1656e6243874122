"""Follow telemetry as it comes: its first seconds say how it is taken, then it is sample in, belief out."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from smsid._files import json_ready
from smsid.description.schema import Description
from smsid.errors import RecordingError
from smsid.identify.estimate import Estimate
from smsid.model import build_model
from smsid.recording import Recording
from smsid.tracking._change_detection import Change, ChangeDetector
from smsid.tracking._sample import Sample
from smsid.tracking._setting import Setting
from smsid.tracking._tracker import SETTLE, Tracker
from smsid.tracking._update import Update
from smsid.tracking.followed_parameters import Rate
from smsid.tracking.json_lines import SampleColumns, parse_sample
from smsid.tracking.track_recordings import track_recordings

BEGIN = 30.0  # [s]

Message = dict[str, Any]
"""What there is to say: a result, ``{"time", "parameters", "sigmas", "explained", "fit"}``, or an event with
a ``text``: ``rejected``, ``not explained``, ``change``, or one of the tracker's log."""


class Stream:
    """A `Tracker` fed as telemetry comes, and what there is to say of it.

    The first ``begin`` seconds are kept and taken as a recording: they tell how commands act between samples,
    what drives the joints, and without an estimate where to linearise (`track_recordings`). Once the model
    does not explain the telemetry, that is told, and standard deviations are wider from then on
    (`Tracker.watch`). Not to be shared between threads.

    Args:
        description: the spacecraft.
        tracker: one to go on with; it follows what it followed.
        follow: as in `track_recordings`, like ``hold`` and ``estimate``.
        begin: how much is looked at first [s].
        every: least time between results, of the telemetry [s].
        lateness: samples may come late by so much [s]; as the tracker was saved with if not given, else zero.
        false_alarms: tell what changed (`ChangeDetector`), with so many false alarms per hour.
    """

    def __init__(
        self,
        description: Description,
        *,
        tracker: Tracker | None = None,
        follow: Mapping[str, Rate] | Sequence[str] | None = None,
        hold: Sequence[str] = (),
        estimate: Estimate | None = None,
        begin: float = BEGIN,
        every: float = 0.0,
        lateness: float | None = None,
        false_alarms: float | None = None,
    ) -> None:
        self.description, self.tracker = description, tracker
        self.columns = SampleColumns(build_model(description) if tracker is None else tracker.origin.base)
        self.begin, self.every, self.false_alarms, self.lateness = begin, every, false_alarms, lateness
        self._asked = {"follow": follow, "hold": hold, "estimate": estimate}
        self._first: list[Sample] = []
        self._ahead: list[Sample] = []
        self._detector: ChangeDetector | None = None
        self._lines, self._changes, self._explained = 0, 0, True
        self._last, self._untold = -np.inf, None
        if tracker is not None:
            self._watch(tracker)
            self._explained = tracker.watch.explained

    def hear(self, sample: Sample) -> list[Message]:
        """Take in a sample, columns in the spacecraft's order, and return what there is to say.

        Raises `RecordingError` for a sample that cannot be used, `SimulationError` when the motion is lost.
        """
        if self.tracker is None:
            return self._begun(sample)
        return self._said(self.tracker.update(sample))

    def hear_line(self, line: str) -> list[Message]:
        """Take in a line of JSON, sample or labels (`SampleColumns`); one that cannot be used is an event."""
        self._lines += 1
        try:
            if not line.strip() or self.columns.told(line):
                return []
            sample = self.columns.ordered(parse_sample(line))
            if self.tracker is not None:
                return self.hear(sample)
        except RecordingError as error:
            return [{"event": "rejected", "line": self._lines, "text": str(error)}]
        return self.hear(sample)  # a beginning that is of no use is no matter of one line

    def end(self) -> list[Message]:
        """Take in what waits, and return what is left to say, the last result in any case.

        Raises `RecordingError` when no sample has come that could be used.
        """
        if self.tracker is None and not self._first:
            raise RecordingError("No sample came.", advice='Send {"time": seconds, "channel": [numbers]}.')
        out = self._start(over=True) if self.tracker is None else []
        assert self.tracker is not None
        out += self._said(self.tracker.flush())
        if self._untold is not None:
            out.append(self._result(self._untold))
            self._untold = None
        return out

    def follow(self, lines: Iterable[str]) -> Iterator[str]:
        """Take in lines until there are none left, and yield lines of JSON of what there is to say.

        Raises `RecordingError` when none of them was a sample that could be used.
        """
        refused = ""
        for line in lines:
            for told in self.hear_line(line):
                refused = told["text"] if told.get("event") == "rejected" else refused
                yield json.dumps(json_ready(told))
        try:
            rest = self.end()
        except RecordingError as error:
            raise RecordingError(f"{error.message} {refused}".strip(), advice=error.advice) from error
        yield from (json.dumps(json_ready(told)) for told in rest)

    def _begun(self, sample: Sample) -> list[Message]:
        """Keep a sample of the beginning, and start where there is enough; a silence begins it anew.

        A moment behind a silence waits for a later one: where time goes on before it, its clock was wrong.
        """
        out: list[Message] = []
        if self._first:
            late = max(x.time for x in self._first) - sample.time
            if sample.time >= self._first[0].time - Setting.silence and late > max(
                self.lateness or 0.0, SETTLE
            ):
                text = f"came {late:.3g} s late and is left out"
                return [{"event": "late", "time": sample.time, "text": text}]
        for kept in (self._ahead, self._first):
            if kept and sample.time < kept[0].time - Setting.silence:
                for wrong in kept:
                    text = f"is {wrong.time - sample.time:.3g} s ahead of what came after it and is left out"
                    out.append({"event": "ahead", "time": wrong.time, "text": text})
                kept.clear()
        if self._ahead and sample.time > self._ahead[0].time:
            self._first, self._ahead = [*self._ahead, sample], []
        elif self._ahead or (self._first and sample.time > self._first[-1].time + Setting.silence):
            self._ahead.append(sample)
        else:
            self._first.append(sample)
        waits = self.begin + (self.lateness or 0.0)
        enough = bool(self._first) and self._first[-1].time >= self._first[0].time + waits
        return out + (self._start() if enough else [])

    def _start(self, *, over: bool = False) -> list[Message]:
        """Make the tracker of what came first."""
        # beside what is newer, others may come late: it stays for the tracker to wait with
        until = max(x.time for x in self._first) - (0.0 if over else self.lateness or 0.0)
        later = [x for x in self._first if x.time > until]
        first = _recording_of([x for x in self._first if x.time <= until])
        heard: deque[Update] = deque(maxlen=1)
        _, self.tracker = track_recordings(
            self.description, [first], warm_up=self.begin, hear=heard.append, **self._asked
        )
        self._first = []
        self._watch(self.tracker)
        out = self._said(heard)
        for sample in later:
            out += self._said(self.tracker.update(sample))
        return out

    def _watch(self, tracker: Tracker) -> None:
        self._events = tracker.log.total
        if self.lateness is not None:
            tracker.setting = replace(tracker.setting, lateness=self.lateness)
            tracker.buffer.lateness = self.lateness
        if self.false_alarms is not None:
            self._detector = ChangeDetector.watch(tracker, false_alarms=self.false_alarms)

    def _said(self, updates: Iterable[Update]) -> list[Message]:
        assert self.tracker is not None
        log, watch, out = self.tracker.log, self.tracker.watch, []
        fresh = min(log.total - self._events, len(log.last))
        for e in list(log.last)[len(log.last) - fresh :]:
            out.append({"event": e.kind, "time": e.time, "channel": e.channel, "text": e.text})
        self._events = log.total
        for update in updates:
            if self._explained and not watch.explained:
                self._explained = False
                out.append({"event": "not explained", "time": update.time, "text": watch.sentence})
            self._untold = update
            if update.time >= self._last + self.every:
                self._last, self._untold = update.time, None
                out.append(self._result(update))
        if self._detector is not None:
            out += [_change(c) for c in self._detector.changes[self._changes :]]
            self._changes = len(self._detector.changes)
        return out

    def _result(self, update: Update) -> Message:
        """Return what is believed; ``fit`` is the mean square of this moment's normalised innovations."""
        assert self.tracker is not None
        names, watch = self.tracker.names, self.tracker.watch
        sigmas = watch.widening * update.sigmas
        return {
            "time": update.time,
            "parameters": dict(zip(names, update.values.tolist(), strict=True)),
            "sigmas": dict(zip(names, sigmas.tolist(), strict=True)),
            "explained": watch.explained,
            "fit": float((update.innovations**2).mean()) if len(update.innovations) else None,
        }


def _change(change: Change) -> Message:
    """Return what changed, when, and by how much with standard deviations."""
    return {
        "event": "change",
        "time": change.alarm,
        "began": change.began,
        "grid": change.grid,
        "group": change.group,
        "jumps": dict(zip(change.names, change.jumps.tolist(), strict=True)),
        "sigmas": dict(zip(change.names, change.sigmas.tolist(), strict=True)),
        "text": change.sentence,
    }


def _recording_of(samples: Sequence[Sample]) -> Recording:
    """Return the recording of samples: a clock a source, what it did not read then is missing."""
    sources: dict[str, dict[int, dict[str, np.ndarray]]] = {}  # by microseconds: what is nearer is the same
    widths: dict[str, int] = {}
    for sample in samples:
        for name, x in sample.channels.items():
            if widths.setdefault(name, len(x)) != len(x):
                raise RecordingError(
                    f"'{name}' has {widths[name]} components in one line and {len(x)} in another.",
                    advice="Give all of them, always; null where one is missing.",
                    channel=name,
                )
            moments = sources.setdefault(name.partition(".")[0], {})
            moments.setdefault(round(1e6 * sample.time), {}).setdefault(name, x)
    channels = {}
    for name, width in widths.items():
        read = sources[name.partition(".")[0]]
        moments, nothing = sorted(read), np.full(width, np.nan)
        times, values = 1e-6 * np.array(moments), np.array([read[t].get(name, nothing) for t in moments])
        if name.endswith(".acceleration") and width > 3:  # stations of a panel
            values = values.reshape(len(times), -1, 3)
        channels[name] = times, values
    return Recording.from_arrays(None, channels, name="stream")
