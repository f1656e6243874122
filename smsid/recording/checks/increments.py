"""Increments of one channel against integrals of its rate over the same spans, component by component.

Both are low-passed alike by the span, so noise is not amplified, and neither is differentiated.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from smsid.recording.attitude import conjugate, rotate, slerp, turn_between
from smsid.recording.clock import Gap, find_gaps

FloatArray = NDArray[np.float64]

MIN_SPANS = 20
"""Fewer independent spans correlate by chance."""
MAX_SPANS = 2_000
"""Of a longer recording spans begin at every so many samples: more tell no more."""
MAX_TURN = 0.7
"""Rotation over a span [rad] above which rotation vectors and integrals of body rates differ."""


@dataclass(frozen=True)
class SpanPair:
    """Increments (M, k) of ``x`` and integrals (M, k) of its rate over ``span`` from ``begins`` (M,) [s].

    ``count`` samples are a span.
    """

    count: int
    span: float
    begins: FloatArray
    increments: FloatArray
    integrals: FloatArray


@dataclass(frozen=True)
class KinematicPair:
    """Samples of a channel and of its rate.

    ``kind`` is ``plain``, ``attitude`` (t, x: (N,), (N, 4); rate in body axes) or ``inertial`` (x in
    inertial, v in body axes, ``attitude`` = (times, quaternions) between them).
    """

    t: FloatArray
    x: FloatArray
    times: FloatArray
    v: FloatArray
    kind: str = "plain"
    attitude: tuple[FloatArray, FloatArray] | None = None

    @cached_property
    def spans(self) -> tuple[SpanPair, ...]:
        """The spans, doubling from one sample."""
        found: list[SpanPair] = []
        while (pair := self.shifted(2 ** len(found))) is not None:
            found.append(pair)
        return tuple(found)

    def shifted(self, count: int, lag: float = 0.0, column: slice = slice(None)) -> SpanPair | None:
        """Return the spans of so many samples, a power of two, or ``None`` where they are too few or long.

        ``lag`` [s] takes the rate that much later; of a ``column`` of both alone.
        """
        low, high = self.times[0] - lag, self.times[-1] - lag
        if self.attitude is not None:
            low, high = max(low, self.attitude[0][0]), min(high, self.attitude[0][-1])
        first, stop = np.searchsorted(self.t, low, side="left"), np.searchsorted(self.t, high, side="right")
        size = int(stop - first)
        if size <= 2 * MIN_SPANS or count > size // MIN_SPANS:
            return None
        stride = max(1, count // 4, size // MAX_SPANS)
        first += -first % stride if stride > max(1, count // 4) else 0  # so that `_turned` is of these alone
        starts, stops = slice(first, stop - count, stride), slice(first + count, stop, stride)
        a = self._increments(starts, count, column, kept=lag != 0.0)
        if a is None:
            return None
        begins, ends = self.t[starts], self.t[stops]
        (own, rate), late = self._gaps, (begins + lag, ends + lag)
        if lag == 0.0 and self._one_clock:
            b = self._driven[stops, column] - self._driven[starts, column]
        else:
            b = self._driven_at(late[1], column) - self._driven_at(late[0], column)
        whole = ~(crosses_a_gap(own, begins, ends) | crosses_a_gap(rate, *late))
        if np.count_nonzero(whole) < MIN_SPANS:
            return None
        a, b = a[whole], b[whole]
        return SpanPair(count, count * self._step, begins[whole], a - a.mean(axis=0), b - b.mean(axis=0))

    @cached_property
    def _driven(self) -> FloatArray:
        return np.asfortranarray(integral(self.times, self.v))  # read by column

    @cached_property
    def _one_clock(self) -> bool:
        return np.array_equal(self.t, self.times)

    def _driven_at(self, times: FloatArray, column: slice) -> FloatArray:
        at = np.clip(times, self.times[0], self.times[-1])
        return np.column_stack([np.interp(at, self.times, own) for own in self._driven.T[column]])

    @cached_property
    def _step(self) -> float:
        return float(np.median(np.diff(self.t)))

    @cached_property
    def _gaps(self) -> tuple[tuple[Gap, ...], tuple[Gap, ...]]:
        return find_gaps(self.t), find_gaps(self.times)

    def _increments(self, begins: slice, count: int, column: slice, *, kept: bool) -> FloatArray | None:
        """Increments (M, k) from some samples on; ``kept``: of all samples at once, for other lags too."""
        if kept and self.kind != "plain":
            thin = begins.step if begins.start % begins.step == 0 else 1
            begin, stop = begins.start // thin, -(-begins.stop // thin)
            found = self._turned(count, thin)[begin : stop : begins.step // thin]
        else:
            ends = slice(begins.start + count, begins.stop + count, begins.step)
            found = self._increment_between(begins, ends)
        if self.kind == "attitude" and np.linalg.norm(found, axis=1).max() > MAX_TURN:
            return None
        return found[:, column]

    @cached_property
    def _turned(self) -> Callable[[int, int], FloatArray]:
        return cache(
            lambda count, thin: self._increment_between(
                slice(0, self.t.size - count, thin), slice(count, None, thin)
            )
        )

    def _increment_between(self, begins: slice, ends: slice) -> FloatArray:
        before, after = self.x[begins], self.x[ends]
        if self.kind == "attitude":
            return turn_between(before, after)
        if self.attitude is None:
            return after - before
        times, values = self.attitude
        middle = np.clip(0.5 * (self.t[begins] + self.t[ends]), times[0], times[-1])
        return rotate(conjugate(slerp(times, values, middle)), after - before)


def crosses_a_gap(gaps: Sequence[Gap], begins: FloatArray, ends: FloatArray) -> NDArray[np.bool_]:
    """Mark spans from ``begins`` (M,) to ``ends`` (M,) that reach over one of the gaps of a clock [s]."""
    if not gaps:
        return np.zeros(begins.size, dtype=bool)
    opens, closes = (np.array([getattr(g, end) for g in gaps]) for end in ("start", "end"))
    # The first gap that closes after a span begins is crossed where it opens before the span ends.
    after = np.searchsorted(closes, begins, side="right")
    return np.append(opens, np.inf)[after] < ends


def integral(t: FloatArray, v: FloatArray) -> FloatArray:
    """Integrate by trapezia; t: (N,) [s], v: (N, k); gives (N, k) starting from zero."""
    steps = 0.5 * (v[1:] + v[:-1]) * np.diff(t)[:, None]
    return np.concatenate([np.zeros((1, v.shape[1])), np.cumsum(steps, axis=0)])
