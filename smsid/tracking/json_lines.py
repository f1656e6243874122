"""Samples as JSON lines, in and out: of a recording, of a stream, of a file that grows."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from smsid._files import json_ready
from smsid.errors import RecordingError
from smsid.model.column_order import column_map
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording
from smsid.tracking._sample import Sample, samples_of

LONGEST_LINE = 1_000_000  # characters
PAUSE = 0.1  # [s] between looks at a file that grows


def parse_sample(line: str) -> Sample:
    """Return the sample of a line: ``{"time": 0.1, "gyro.angular_rate": [...], ...}``.

    Raises `RecordingError` when it is no such thing.
    """
    table = _table(line)
    if "time" not in table:
        raise RecordingError("A line has no time.", advice='Give {"time": seconds, "channel": [numbers]}.')
    return Sample.of(table.pop("time"), table)


def _table(line: str) -> dict[str, Any]:
    if len(line) > LONGEST_LINE:
        raise RecordingError(f"A line has {len(line)} characters.", advice="Give one sample a line.")
    try:
        table = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise RecordingError(f"A line is no JSON: {error}.", advice="Give one JSON object a line.") from error
    if not isinstance(table, dict):
        raise RecordingError("A line is no JSON object.", advice="Give one JSON object a line.")
    return table


def lines_of(recording: Recording) -> Iterator[tuple[float, str]]:
    """Yield the times [s] and lines of a recording's samples; before them, a line with the columns' labels.

    The line of the labels, ``{"labels": {"wheel": ["rw1", "rw2"]}}``, has the time of the first sample.
    """
    labels = {k: list(v) for k, v in recording.labels.items()}
    for k, sample in enumerate(samples_of(recording)):
        if k == 0 and labels:
            yield sample.time, json.dumps({"labels": labels})
        channels = {name: x.tolist() for name, x in sample.channels.items()}
        yield sample.time, json.dumps(json_ready({"time": sample.time, **channels}))


class SampleColumns:
    """Brings the columns of samples into the spacecraft's order, by labels told once, as of a recording."""

    def __init__(self, model: SpacecraftModel) -> None:
        self.model = model
        self.labels: dict[str, tuple[str, ...]] = {}
        self._maps: dict[tuple[str, int], tuple[np.ndarray, np.ndarray]] = {}

    def told(self, line: str) -> bool:
        """Take in a line, and return whether it was one of labels: ``{"labels": {"joint": [names]}}``.

        Raises `RecordingError` for labels that are no names.
        """
        if '"labels"' not in line[:LONGEST_LINE]:
            return False
        table = _table(line)
        if "labels" not in table:
            return False
        labels = table["labels"]
        rows = labels.values() if isinstance(labels, dict) else [None]
        if not all(isinstance(x, list) and all(isinstance(n, str) for n in x) for x in rows):
            raise RecordingError(
                "Labels are no lists of names.", advice='Give {"labels": {"wheel": ["rw1", "rw2"]}}.'
            )
        self.labels, self._maps = {k: tuple(v) for k, v in labels.items()}, {}
        return True

    def ordered(self, sample: Sample) -> Sample:
        """Return the sample in the spacecraft's order. Raises `RecordingError` for unknown labels."""
        if not self.labels:
            return sample
        channels = {}
        for name, x in sample.channels.items():
            if (key := (name, len(x))) not in self._maps:
                self._maps[key] = column_map(self.labels, *key, self.model)
            matrix, offset = self._maps[key]
            # by entries that matter: a column that is missing, NaN, says nothing of the others
            channels[name] = np.where(matrix != 0.0, matrix * x, 0.0).sum(axis=1) + offset
        return Sample(sample.time, channels)


def growing_lines(
    path: str | os.PathLike[str], *, ended: Callable[[], bool], pause: float = PAUSE
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
