"""Samples as JSON lines, in and out: a stream or a growing file of telemetry, and what it tells."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from smsid._files import json_ready
from smsid.errors import RecordingError
from smsid.tracking.sample import Sample
from smsid.tracking.tracker import Tracker, Update

LONGEST_LINE = 1_000_000  # characters
PAUSE = 0.1  # [s] between looks at a file that grows


def parse_sample(line: str) -> Sample:
    """Return the sample of a line: ``{"time": 0.1, "gyro.angular_rate": [...], ...}``.

    Raises `RecordingError` when it is no such thing.
    """
    if len(line) > LONGEST_LINE:
        raise RecordingError(f"A line has {len(line)} characters.", advice="Give one sample a line.")
    try:
        table = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise RecordingError(f"A line is no JSON: {error}.", advice="Give one JSON object a line.") from error
    if not isinstance(table, dict) or "time" not in table:
        raise RecordingError("A line has no time.", advice='Give {"time": seconds, "channel": [numbers]}.')
    return Sample.of(table.pop("time"), table)


def follow_lines(tracker: Tracker, lines: Iterable[str], *, every: float = 0.0) -> Iterator[str]:
    """Feed lines of samples to a tracker and yield lines of what it believes, and of what went wrong.

    A line that cannot be used is told as ``{"event": "rejected", ...}`` and the stream goes on. ``every`` is
    the least time between results [s]. Raises `SimulationError` when the filter has lost the motion.
    """
    told, last = 0, -float("inf")
    updates: tuple[Update, ...]
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            updates = tracker.update(parse_sample(line))
        except RecordingError as error:
            yield json.dumps({"event": "rejected", "line": number, "text": str(error)})
            continue
        count = sum(tracker.log.counts.values())
        recent = list(tracker.log.last)[-min(count - told, len(tracker.log.last)) :] if count > told else []
        told = count
        for e in recent:
            table = {"event": e.kind, "time": e.time, "channel": e.channel, "text": e.text}
            yield json.dumps(json_ready(table))
        for update in updates:
            if update.time >= last + every:
                last = update.time
                yield result_line(tracker, update)
    for update in tracker.flush()[-1:]:
        yield result_line(tracker, update)


def result_line(tracker: Tracker, update: Update) -> str:
    """Return a line: time, parameters with standard deviations, mean square of the normalised innovations."""
    table = {
        "time": update.time,
        "parameters": dict(zip(tracker.names, update.values.tolist(), strict=True)),
        "sigmas": dict(zip(tracker.names, update.sigmas.tolist(), strict=True)),
        "fit": float((update.innovations**2).mean()) if len(update.innovations) else None,
    }
    return json.dumps(json_ready(table))


def growing_lines(
    path: str | os.PathLike[str],
    *,
    ended: Callable[[], bool],
    pause: float = PAUSE,
) -> Iterator[str]:
    """Yield the lines of a file as they are written, whole ones only, until ``ended`` says that it is over.

    Raises `RecordingError` when there is no such file.
    """
    try:
        stream = Path(path).open(encoding="utf-8", errors="replace")  # noqa: SIM115 - closed below
    except OSError as error:
        raise RecordingError(
            f"Cannot read '{path}': {error.strerror}.", advice="Check the path.", path=str(path)
        ) from error
    with stream:
        begun = ""
        while True:
            over = ended()  # asked before reading, so that nothing written until then is lost
            part = stream.readline()
            if part:
                begun += part
                if begun.endswith("\n"):
                    yield begun
                    begun = ""
            elif over:
                if begun:
                    yield begun
                return
            else:
                time.sleep(pause)
