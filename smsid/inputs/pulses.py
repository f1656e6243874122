"""Shares of a sample that valves are open for, as what valves do: open, and shut."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

Pulse = Literal["spread", "begin", "middle", "end"]
IDLE_BEFORE = {"begin": 0.0, "middle": 0.5, "end": 1.0}  # share of what a valve is shut for, before it opens
SAME = 1e-9  # share of the shortest sample within which two switching times are one


def switched(times: np.ndarray, shares: np.ndarray, pulses: Sequence[Pulse]) -> tuple[np.ndarray, np.ndarray]:
    """Return rows (M,) [s], (M, k) of what holds until the next, of ``shares`` (N, k) at ``times`` (N,) [s].

    A sample lasts from its time to the next, the last as long as most. A valve with a pulse is open (1) once
    in each sample, from its ``"begin"`` on, about its ``"middle"`` or to its ``"end"``; what is ``"spread"``
    is its share all through.
    """
    lengths = np.diff(times)
    ends = np.append(times[1:], times[-1] + np.median(lengths))
    at = np.array([IDLE_BEFORE.get(p, 0.0) for p in pulses])
    idle = (1.0 - shares) * (ends - times)[:, None]
    opens, shuts = times[:, None] + at * idle, ends[:, None] - (1.0 - at) * idle
    pulsed = np.array([p != "spread" for p in pulses])
    edges = np.concatenate([times, ends[-1:], opens[:, pulsed].ravel(), shuts[:, pulsed].ravel()])
    same = SAME * lengths.min()
    rows = np.sort(edges)
    rows = rows[np.diff(rows, prepend=-np.inf) > same]
    sample = np.searchsorted(times, rows + same, side="right") - 1
    middle = 0.5 * (rows + np.append(rows[1:], np.inf))[:, None]
    is_open = (opens[sample] < middle) & (middle < shuts[sample])
    return rows, np.where(pulsed, is_open, shares[sample])
