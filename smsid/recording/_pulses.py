"""Shares of a sample that valves are open for, as the times at which they open and close."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Pulses = Literal["begin", "middle", "end"]
SAME = 1e-9  # share of a sample within which two switching times are one


def switching_times(
    times: NDArray[np.float64], shares: NDArray[np.float64], pulses: Pulses
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return rows (M,), (M, k) of valves that are open (1) or shut (0) of ``shares`` (N, k) of samples.

    A sample lasts from its time [s] to the next, the last as long as most. In it a valve is open once, from
    its ``"begin"`` on, about its ``"middle"`` or to its ``"end"``. Samples are rows, too.
    """
    lengths = np.diff(times)
    ends = np.append(times[1:], times[-1] + np.median(lengths))
    idle = (1.0 - shares) * (ends - times)[:, None]
    before = {"begin": 0.0, "middle": 0.5, "end": 1.0}[pulses] * idle
    opens, shuts = times[:, None] + before, ends[:, None] - (idle - before)
    rows = np.sort(np.concatenate([times, ends[-1:], opens.ravel(), shuts.ravel()]))
    rows = rows[np.diff(rows, prepend=-np.inf) > SAME * lengths.min()]
    sample = np.clip(np.searchsorted(times, rows + SAME * lengths.min(), side="right") - 1, 0, None)
    middle = 0.5 * (rows + np.append(rows[1:], np.inf))[:, None]  # what is so until the next row
    return rows, np.where((opens[sample] < middle) & (middle < shuts[sample]), 1.0, 0.0)
