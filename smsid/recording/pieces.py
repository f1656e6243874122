"""Stretches of a recording in which nothing is missing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from smsid.errors import RecordingError
from smsid.recording.clock import check_order, find_gaps
from smsid.recording.recording import Recording


def complete_spans(recording: Recording) -> tuple[tuple[float, float], ...]:
    """Find the spans (t0, t1) [s] in which no clock has a gap and every sample is finite, in order of time.

    A span is as long as all clocks cover it, and holds two samples of each clock at least.

    Raises:
        RecordingError: a clock does not increase.
    """
    holes: list[tuple[float, float]] = []
    starts, ends = [], []
    for clock, times in recording.times().items():
        check_order(times, clock)
        starts.append(float(times[0]))
        ends.append(float(times[-1]))
        holes += [(gap.start, gap.end) for gap in find_gaps(times, clock)]
    for name in recording.channels:
        times, values = recording.time(name), recording[name]
        bad = np.flatnonzero(~np.isfinite(values.reshape(len(values), -1)).all(axis=1))
        before, after = np.append(-np.inf, times), np.append(times, np.inf)
        holes += [(float(before[k]), float(after[k + 1])) for k in bad]
    spans, at, end = [], max(starts), min(ends)
    for low, high in sorted(holes):
        if low > at:
            spans.append((at, min(low, end)))
        at = max(at, high)
    spans.append((at, end))
    return tuple(span for span in spans if span[1] > span[0] and _is_sampled(recording, *span))


def complete_pieces(recording: Recording) -> tuple[Recording, ...]:
    """Cut a recording at its gaps and where samples are not finite; each piece is without either.

    Raises:
        RecordingError: a clock does not increase, or nothing is left.
    """
    spans = complete_spans(recording)
    if not spans:
        raise RecordingError(
            "No stretch of the recording has two samples of every clock without a gap between them.",
            advice="Leave out the channels with most gaps or samples that are not finite.",
        )
    return tuple(recording.window(*span) for span in spans)


def even_with_gaps(recording: Recording, names: Sequence[str]) -> tuple[np.ndarray, float]:
    """Bring channels to one even clock, piece by piece; a row of NaN stands for each gap.

    Args:
        recording: with gaps or samples that are not finite, or without.
        names: of its channels.

    Returns:
        values (N, columns) of the channels side by side, and their rate [Hz], that of the longest piece.

    Raises:
        RecordingError: no such channel, a clock that does not increase, or nothing is left.
    """
    recording.require(*names)
    pieces = complete_pieces(recording.without(*(n for n in recording.channels if n not in names)))
    longest = max((piece.time(names[0]) for piece in pieces), key=len)
    rate = float((longest.size - 1) / (longest[-1] - longest[0]))
    rows: list[np.ndarray] = []
    for piece in pieces:
        even = piece.resampled(rate)
        values = [even[name].reshape(len(even[name]), -1) for name in names]
        rows += [np.hstack(values), np.full((1, sum(v.shape[1] for v in values)), np.nan)]
    return np.vstack(rows[:-1]), rate


def _is_sampled(recording: Recording, t0: float, t1: float) -> bool:
    clocks = list(recording.times().values())
    return all(np.count_nonzero((times >= t0) & (times <= t1)) >= 2 for times in clocks)
