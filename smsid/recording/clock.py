"""What can be wrong with a clock: order and gaps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from smsid._time_text import time_text
from smsid.errors import RecordingError

FloatArray = NDArray[np.float64]

GAP_STEPS = 5.0
"""A step longer than this many median steps is a gap."""


@dataclass(frozen=True)
class Gap:
    """A hole in a clock between the samples at ``start`` and ``end`` [s]; ``step`` [s] is the median step.

    ``first`` [s] is the time of the clock's first sample.
    """

    clock: str
    start: float
    end: float
    step: float
    first: float | None = None

    @property
    def duration(self) -> float:
        """How long it lasts [s]."""
        return self.end - self.start

    def __str__(self) -> str:
        at = time_text(self.start, self.first)
        return f"{self.duration:.6g} s from t = {at} ({self.duration / self.step:.1f} steps)"


def find_gaps(times: FloatArray, clock: str = "time") -> tuple[Gap, ...]:
    """Find the steps of ``times`` (N,) [s] that are longer than `GAP_STEPS` median steps."""
    if times.size < 3:
        return ()
    steps = np.diff(times)
    step = float(np.median(steps))
    return tuple(
        Gap(clock, float(times[k]), float(times[k + 1]), step, float(times[0]))
        for k in np.flatnonzero(steps > GAP_STEPS * step)
    )


def check_order(times: FloatArray, clock: str = "time") -> None:
    """Raise `RecordingError` unless ``times`` (N,) [s] is finite and strictly increasing."""
    finite = np.isfinite(times)
    if not finite.all():
        index = int(np.flatnonzero(~finite)[0])
        raise RecordingError(
            f"Clock '{clock}' is {times[index]} at index {index} ({np.count_nonzero(~finite)} such samples).",
            advice="Remove these samples before building the recording.",
            clock=clock,
            index=index,
            count=int(np.count_nonzero(~finite)),
        )
    late = np.flatnonzero(np.diff(times) <= 0.0)
    if late.size:
        index = int(late[0]) + 1
        before, value = float(times[index - 1]), float(times[index])
        what = "stands still" if value == before else "goes back"
        advice = "Sort the samples and drop repeated ones, or split the recording where a new run starts."
        if value == before:
            advice = (
                "Two samples have one time: delete the wrong row, or, where stamps are rounded, name a finer "
                "column of times or state a rate."
            )
        raise RecordingError(
            f"Clock '{clock}' {what} at index {index}: {before!r} s, then {value!r} s "
            f"({late.size} such steps).",
            advice=advice,
            clock=clock,
            index=index,
            values=(before, value),
            count=int(late.size),
        )
