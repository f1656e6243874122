"""Increments of one channel against integrals of its rate over the same spans, component by component.

Both are low-passed alike by the span, so noise is not amplified, and neither is differentiated.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from smsid.recording._attitude import conjugate, multiply, rotate, rotation_vector, slerp
from smsid.recording._clock import find_gaps
from smsid.recording._resampling import linear

FloatArray = NDArray[np.float64]

MIN_SPANS = 20
"""Fewer independent spans correlate by chance."""
MAX_TURN = 0.7
"""Rotation over a span [rad] above which rotation vectors and integrals of body rates differ."""


@dataclass(frozen=True)
class SpanPair:
    """Increments (M, k) of ``x`` and integrals (M, k) of its rate over ``span`` from ``begins`` (M,) [s]."""

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

    def spans(self, lag: float = 0.0, only: float | None = None) -> Iterator[SpanPair]:
        """Yield the spans, doubling from one sample; ``lag`` [s] takes the rate that much later."""
        driven = integral(self.times, self.v)
        low, high = self.times[0] - lag, self.times[-1] - lag
        if self.attitude is not None:
            low, high = max(low, self.attitude[0][0]), min(high, self.attitude[0][-1])
        inside = (self.t >= low) & (self.t <= high)
        t, x = self.t[inside], self.x[inside]
        if t.size <= 2 * MIN_SPANS:
            return
        s = linear(self.times, driven, np.clip(t + lag, self.times[0], self.times[-1]))
        step = float(np.median(np.diff(t)))
        span = 1
        while span <= t.size // MIN_SPANS:
            if only is None or abs(span * step - only) < 0.25 * step:
                stride = max(1, span // 4)
                a = self._increments(t, x, span, stride)
                if a is None:
                    return
                b = s[span::stride] - s[:-span:stride]
                begins, ends = t[:-span:stride], t[span::stride]
                whole = ~(crosses_a_gap(self.t, begins, ends) | crosses_a_gap(self.times - lag, begins, ends))
                if np.count_nonzero(whole) < MIN_SPANS:
                    return
                a, b = a[whole], b[whole]
                yield SpanPair(span * step, begins[whole], a - a.mean(axis=0), b - b.mean(axis=0))
            span *= 2

    def _increments(self, t: FloatArray, x: FloatArray, span: int, stride: int) -> FloatArray | None:
        before, after = x[:-span:stride], x[span::stride]
        if self.kind == "attitude":
            turned = rotation_vector(multiply(conjugate(before), after))
            return None if np.linalg.norm(turned, axis=1).max() > MAX_TURN else turned
        if self.kind == "inertial":
            assert self.attitude is not None
            middle = 0.5 * (t[:-span:stride] + t[span::stride])
            return rotate(conjugate(slerp(*self.attitude, middle)), after - before)
        return after - before


def crosses_a_gap(t: FloatArray, begins: FloatArray, ends: FloatArray) -> NDArray[np.bool_]:
    """Mark spans from ``begins`` (M,) to ``ends`` (M,) that reach over a gap of the clock ``t`` (N,) [s]."""
    gaps = find_gaps(t)
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
