"""Faults that the samples of one component show by themselves: outliers, full turns, held or stuck values."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from smsid._time_text import time_text


@dataclass(frozen=True)
class SampleFault:
    """A fault of one or more components of a channel.

    ``kind`` is ``outlier``, ``stuck``, ``saturated``, ``held``, ``full turn``, ``swapped``, ``turned``,
    ``sign``, ``unit``, ``scale``, ``delay`` or ``quaternion``. ``other`` is the channel it was compared with
    (empty: none); a pair of channels alone cannot tell which of the two is wrong. ``numbers`` is the
    evidence, all finite. ``clear`` says that the fault is beyond doubt; otherwise it is a note.
    """

    channel: str
    components: tuple[str, ...]
    kind: str
    other: str
    numbers: tuple[float, ...]
    clear: bool
    sentence: str
    mend: str

    @property
    def of_a_sensor(self) -> bool:
        """Whether a sensor that fails gives it, a hypothesis to a diagnosis; others are units and axes."""
        return OF_A_SENSOR.get(self.kind, False)


OF_A_SENSOR: dict[str, bool] = dict.fromkeys(("stuck", "outlier", "sign", "scale", "delay", "turned"), True)

FloatArray = NDArray[np.float64]

WILD = 1e3  # times the largest of the rest: no reading of a sensor
OUTLIER_SIGMAS, OUTLIER_RANGE = 20.0, 0.5
"""An outlier stands off the running median by both: noise sigmas, and share of the range of the rest."""
MAX_OUTLIERS = 0.1
"""More than this share of samples is another kind of signal, not isolated outliers."""
NEIGHBOURS = 12
"""Steps on each side of an outlier whose median is noise as well: what a knock makes ring is no outlier."""
MIN_SAMPLES = 50
TURN_TOLERANCE = 0.05
HELD_SHARE = 0.95


def running_median(x: FloatArray) -> FloatArray:
    """Return the medians (N,) of seven samples each of x (N,), its ends repeated beyond them."""
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(x, 3, mode="edge"), 7)
    return np.partition(windows, 3, axis=1)[:, 3]


def outliers(x: FloatArray, floor: float = 0.0) -> NDArray[np.bool_]:
    """Mark isolated outliers above ``floor``; x: (N,). All False where the signal has another character."""
    none = np.zeros(x.size, dtype=bool)
    if x.size < MIN_SAMPLES:
        return none
    # Differences of values near the largest float overflow: clip far beyond anything measured.
    scale = float(np.quantile(np.abs(x), 0.9)) or 1.0
    x = np.clip(x / scale, -1e30, 1e30)
    smooth = running_median(x)
    off = np.abs(x - smooth)
    steps = np.abs(np.diff(x))
    moved = steps[steps > 0.0]
    if not moved.size:
        return none
    sigma = max(1.4826 * float(np.median(off)), float(moved.min()))
    low, high = np.quantile(smooth, [0.01, 0.99])
    marked = off > max(OUTLIER_SIGMAS * sigma, OUTLIER_RANGE * float(high - low), floor / scale)
    share = float(np.mean(marked))
    if not share or share > MAX_OUTLIERS:
        return none
    at = np.flatnonzero(marked)
    near = np.clip(at[:, None] + np.arange(-NEIGHBOURS, NEIGHBOURS), 0, steps.size - 1)
    marked[at] = off[at] > OUTLIER_SIGMAS * np.median(steps[near], axis=1)
    return marked


def outlier_finding(channel: str, component: str, t: FloatArray, x: FloatArray) -> SampleFault | None:
    """Name isolated outliers of a component; t, x: (N,)."""
    marked = outliers(x, 1e-9)
    count = int(np.count_nonzero(marked))
    if not count:
        return None
    first = int(np.flatnonzero(marked)[0])
    worst = float(np.max(np.abs(x[marked])))
    rest = float(np.max(np.abs(x[~marked])))
    # Within the range of the rest an outlier is told by how far it is off the samples around it.
    off = np.abs(x - running_median(x))
    shown = (
        f"up to {worst:.4g} where the rest stays below {rest:.4g}"
        if worst > rest
        else f"up to {np.max(off[marked]):.4g} off the samples around them, the rest at most "
        f"{np.max(off[~marked]):.4g}"
    )
    sentence = (
        f"'{channel}' {component} has {count} isolated outliers of {x.size} samples, the first at "
        f"t = {time_text(t[first], t[0])}: {shown}."
    )
    mend = "Remove these samples, or cut the log with window(t0, t1)."
    numbers, clear = (float(count), worst, rest), worst > WILD * rest  # identification leaves others out
    return SampleFault(channel, (component,), "outlier", "", numbers, clear, sentence, mend)


def full_turn_finding(channel: str, component: str, t: FloatArray, x: FloatArray) -> SampleFault | None:
    """Name jumps of an angle by a full turn within one sample; t, x: (N,) [s | rad]."""
    if x.size < MIN_SAMPLES:
        return None
    steps = np.diff(np.clip(x, -1e12, 1e12))
    usual = float(np.quantile(np.abs(steps), 0.95))
    turn = 2.0 * math.pi
    jumps = np.flatnonzero(np.abs(np.abs(steps) - turn) < TURN_TOLERANCE * turn + usual)
    if not jumps.size or usual > 0.15 * turn:
        return None
    size, count = float(steps[jumps[0]]), float(jumps.size)
    sentence = (
        f"'{channel}' {component} jumps by a full turn ({size:.4g} rad in one sample) {jumps.size} times, "
        f"first at t = {time_text(float(t[jumps[0] + 1]), float(t[0]))}."
    )
    mend = "The angle was logged within one turn: unwrap it (numpy.unwrap) before the import."
    return SampleFault(channel, (component,), "full turn", "", (count, size), True, sentence, mend)


def held_finding(channel: str, t: FloatArray, x: FloatArray) -> SampleFault | None:
    """Name samples that are held: t, x: (N,), (N, k); all components change at every n-th sample only."""
    if x.shape[0] < MIN_SAMPLES:
        return None
    changes = np.flatnonzero(np.any(x[1:] != x[:-1], axis=1))
    if changes.size < 20:
        return None
    between = np.diff(changes)
    usual = int(np.median(between))
    if usual < 2 or float(np.mean(between == usual)) < HELD_SHARE:
        return None
    rate = (t.size - 1) / float(t[-1] - t[0])
    sentence = (
        f"'{channel}' is logged at {rate:.4g} Hz, but changes at every {usual}th sample only: it holds data "
        f"of {rate / usual:.4g} Hz."
    )
    mend = "Import it on a clock of its own with the samples at which it changes."
    return SampleFault(channel, (), "held", "", (rate, rate / usual), False, sentence, mend)


def longest_constant_run(x: FloatArray) -> tuple[int, int]:
    """Give begin and end (exclusive) of the longest run of one value; x: (N,)."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(x) != 0.0) + 1, [x.size]])
    k = int(np.argmax(np.diff(edges)))
    return int(edges[k]), int(edges[k + 1])


def beyond_the_end(marked: NDArray[np.bool_], x: FloatArray, driven: FloatArray) -> NDArray[np.bool_]:
    """Keep of ``marked`` (N,) stretches at an extreme of ``x`` (N,) those whose rate goes out and comes back.

    ``driven`` (N,) is the integral of the rate. Where it only goes out, the rate is late: the component
    rests at a turn of its motion.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], marked, [False]]).astype(int)))
    kept = marked.copy()
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        if begin == 0 or end == x.size:
            continue
        sign = 1.0 if x[begin] > x[begin - 1] else -1.0
        beyond = sign * (driven[begin:end] - driven[begin])
        out, back = float(beyond.max()), float(beyond.max() - beyond[-1])
        kept[begin:end] = min(out, back) > 0.5 * max(out, back)
    return kept


def clipped_samples(x: FloatArray) -> NDArray[np.bool_]:
    """Mark samples that rest at the largest or smallest value for five samples or more; x: (N,)."""
    marked = np.zeros(x.size, dtype=bool)
    for extreme in (float(x.max()), float(x.min())):
        at = np.concatenate([[False], x == extreme, [False]]).astype(int)
        begins, ends = np.flatnonzero(np.diff(at) == 1), np.flatnonzero(np.diff(at) == -1)
        for begin, end in zip(begins, ends, strict=True):
            if end - begin >= 5:
                marked[begin:end] = True
    return marked
