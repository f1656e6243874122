"""Rows that a logger wrote twice."""

from __future__ import annotations

import numpy as np

from smsid.recording.recording import Recording


def without_repeats(recording: Recording) -> tuple[Recording, dict[str, int]]:
    """Leave out rows that repeat the one before: the same time, and the same values in all of its channels.

    They say nothing new. Rows of the same time with other values are kept: which one is right is not known.

    Returns:
        The recording, and how many rows were left out by clock.
    """
    rows, counts = {}, {}
    for clock, times in recording.times().items():
        again = np.append(False, np.diff(times) == 0.0)
        for name in recording.channels:
            if again.any() and recording.clock_of(name) == clock:
                flat = recording[name].reshape(len(times), -1)
                same = (flat[1:] == flat[:-1]) | (np.isnan(flat[1:]) & np.isnan(flat[:-1]))
                again[1:] &= same.all(axis=1)
        count = int(np.count_nonzero(again))
        if count and len(times) - count > 1:  # a clock that never goes on is another fault
            rows[clock], counts[clock] = np.flatnonzero(~again), count
    return (recording.at_rows(rows) if rows else recording), counts
