"""How much later one signal is than another: cross-correlation, finer than a sample, with an interval."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike
from scipy.optimize import minimize_scalar
from scipy.signal import correlate

from smsid.errors import RecordingError
from smsid.recording._clock import check_order
from smsid.recording._resampling import linear

LEAST_CORRELATION = 0.3
MIN_SAMPLES = 16
BLOCKS = 8
PEAK_SHARE = 0.8
LEAST_HALF = 4


@dataclass(frozen=True)
class Lag:
    """``value`` [s] is how much later the second signal is; ``sigma`` its standard deviation [s].

    ``correlation`` is that of the signals once aligned; ``gain`` the second over the first.
    """

    value: float
    sigma: float
    correlation: float
    gain: float

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval, Gaussian [s]."""
        return self.value - 1.959964 * self.sigma, self.value + 1.959964 * self.sigma


def estimate_lag(
    first: tuple[ArrayLike, ArrayLike],
    second: tuple[ArrayLike, ArrayLike],
    *,
    largest: float,
    rate: float | None = None,
) -> Lag:
    """Estimate how much ``second`` lags ``first``, two signals of the same motion with clocks of their own.

    Both are brought to one rate, linearly, so the clocks may jitter; the peak of their normalised
    cross-correlation is interpolated between samples. The standard deviation is that of the lags of
    eight blocks of the record, over the root of their number. A steady lag only: drifting clocks widen the
    interval.

    Args:
        first: times (N,) [s] and samples (N,) of the reference.
        second: times (M,) [s] and samples (M,); any unit, either sign.
        largest: lags are sought up to this size [s].
        rate: common rate [Hz]; default the higher median rate of the two.

    Raises:
        RecordingError: clocks that do not increase, samples that are not finite, less than ``4 * largest`` in
            common, a constant signal, a correlation below 0.3, or a peak at the end of the search.
    """
    t1, x1 = _checked(first, "first")
    t2, x2 = _checked(second, "second")
    common = float(rate or 1.0 / min(float(np.median(np.diff(t))) for t in (t1, t2)))
    begin, end = max(t1[0], t2[0]) + largest, min(t1[-1], t2[-1]) - largest
    if largest <= 0.0 or (end - begin) < max(2.0 * largest, MIN_SAMPLES / common):
        raise RecordingError(
            f"The signals have {end - begin + 2 * largest:.6g} s in common; lags up to {largest:g} s need "
            "more.",
            advice="Seek smaller lags, or correct the clocks' offset first.",
            common=float(end - begin + 2 * largest),
        )
    times = np.arange(begin, end, 1.0 / common)
    reference = linear(t1, x1[:, None], times)[:, 0]
    steps = int(np.ceil(largest * common))
    longer = begin + np.arange(-steps, times.size + steps) / common
    wide = linear(t2, x2[:, None], np.clip(longer, t2[0], t2[-1]))[:, 0]
    value, correlation, gain = _peak(reference, wide, steps, common)
    if abs(correlation) < LEAST_CORRELATION:
        raise RecordingError(
            f"The signals are not alike at any lag up to {largest:g} s: best correlation {correlation:.2f}.",
            advice="Are they of the same motion, and is one the derivative of the other?",
            correlation=correlation,
        )
    if abs(value) > largest - 1.0 / common:
        raise RecordingError(
            f"The best lag, {value:.6g} s, is at the end of the search.",
            advice="Seek larger lags.",
            lag=value,
        )
    middle, reach = round(value * common), steps
    blocks = []
    for piece in np.array_split(np.arange(times.size), BLOCKS):
        begin_, last = piece[0] + steps + middle - reach, piece[-1] + steps + middle + reach + 1
        if begin_ >= 0 and last <= wide.size and np.ptp(reference[piece]) > 0.0:
            blocks.append(_peak(reference[piece], wide[begin_:last], reach, common)[0])
    sigma = float(np.std(blocks, ddof=1) / np.sqrt(len(blocks))) if len(blocks) > 1 else float("inf")
    return Lag(value, sigma, correlation, gain)


def _peak(reference: np.ndarray, wide: np.ndarray, steps: int, rate: float) -> tuple[float, float, float]:
    """Lag [s], correlation and gain at the highest peak; ``wide`` reaches ``steps`` samples farther.

    A polynomial of fourth degree is fitted to the correlation at whole samples, over the peak down to
    ``PEAK_SHARE`` of its height: noise common to neighbouring lags does not draw it to a spike, nor to where
    interpolating a noisy signal would smooth it.
    """
    a = reference - reference.mean()
    n = a.size
    product = correlate(wide, a, mode="valid", method="fft")
    ones = np.concatenate([[0.0], np.cumsum(wide)]), np.concatenate([[0.0], np.cumsum(wide**2)])
    sums, squares = (c[n:] - c[:-n] for c in ones)
    spread = np.sqrt(np.maximum(squares - sums**2 / n, 0.0)) * np.linalg.norm(a)
    if not (np.linalg.norm(a) > 0.0 and spread.max() > 1e-12 * n * np.abs(wide).max()):
        raise RecordingError("A signal is constant.", advice="It has no lag: choose one that moves.")
    share = product / np.maximum(spread, 1e-12 * spread.max())
    k = int(np.argmax(np.abs(share)))
    low = np.flatnonzero(np.abs(share) < PEAK_SHARE * np.abs(share[k]))
    half = int(np.abs(low - k).min()) if low.size else share.size
    half = min(max(half, LEAST_HALF), k, share.size - 1 - k)
    if half < 3:
        return (k - steps) / rate, float(share[k]), float(product[k] / (a @ a))
    for _ in range(3):
        x = np.arange(-half, half + 1)
        curve = Polynomial.fit(x, share[k - half : k + half + 1], 4)
        top = minimize_scalar(lambda t: -abs(float(curve(t))), bounds=(-half, half), method="bounded")  # noqa: B023
        moved = min(max(k + round(float(top.x)), half), share.size - 1 - half)
        if moved == k:
            break
        k = moved
    at = k + float(top.x)
    gain = float(np.interp(at, np.arange(share.size), product)) / float(a @ a)
    return (at - steps) / rate, float(curve(float(top.x))), gain


def _checked(signal: tuple[ArrayLike, ArrayLike], name: str) -> tuple[np.ndarray, np.ndarray]:
    t, x = (np.asarray(s, dtype=float) for s in signal)
    if t.ndim != 1 or t.shape != x.shape or t.size < 2:
        raise RecordingError(
            f"The {name} signal has times {t.shape} and samples {x.shape}; both must be (N,).",
            advice="Pick one component: recording[channel][:, k].",
        )
    check_order(t, name)
    if not np.isfinite(x).all():
        raise RecordingError(f"The {name} signal is not finite.", advice="Cut or mend it first.")
    return t, x
