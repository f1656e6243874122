"""How much later one signal is than another: cross-correlation, finer than a sample, with an interval."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike
from scipy.optimize import minimize_scalar

from smsid._statistics import NORMAL95
from smsid.errors import RecordingError
from smsid.recording.clock import check_order
from smsid.recording.resampling import linear

LEAST_CORRELATION = 0.3
MIN_SAMPLES = 16
BLOCKS = 20
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
        return self.value - NORMAL95 * self.sigma, self.value + NORMAL95 * self.sigma


def estimate_lag(
    first: tuple[ArrayLike, ArrayLike],
    second: tuple[ArrayLike, ArrayLike],
    *,
    largest: float,
) -> Lag:
    """Estimate how much ``second`` lags ``first``, two signals of the same motion with clocks of their own.

    Both are brought to the higher of their median rates, linearly, so the clocks may jitter; the peak of
    their normalised cross-correlation is interpolated between samples. The standard deviation is that of the
    lags of eight blocks of the record, over the root of their number. A steady lag only: drifting clocks
    widen the interval.

    Args:
        first: times (N,) [s] and samples (N,) of the reference.
        second: times (M,) [s] and samples (M,); any unit, either sign.
        largest: lags are sought up to this size [s].

    Raises:
        RecordingError: clocks that do not increase, samples that are not finite, less than ``4 * largest`` in
            common, a constant signal, a correlation below 0.3, or a peak at the end of the search.
    """
    t1, x1 = _check_signal(first, "first")
    t2, x2 = _check_signal(second, "second")
    common = 1.0 / min(float(np.median(np.diff(t))) for t in (t1, t2))
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
    sigma = _jackknife(reference, wide, round(value * common) + steps, steps, common)
    return Lag(value, sigma, correlation, gain)


def _peak(reference: np.ndarray, wide: np.ndarray, steps: int, rate: float) -> tuple[float, float, float]:
    """Lag [s], correlation and gain at the highest peak; ``wide`` reaches ``steps`` samples farther.

    A polynomial of fourth degree is fitted to the correlation at whole samples, over the peak down to
    ``PEAK_SHARE`` of its height: noise common to neighbouring lags does not draw it to a spike, nor to where
    interpolating a noisy signal would smooth it.
    """
    a = reference - reference.mean()
    n = a.size
    size = 2 ** (wide.size - 1).bit_length()
    product = np.fft.irfft(np.fft.rfft(wide, size) * np.fft.rfft(a, size).conj(), size)[: wide.size - n + 1]
    ones = np.concatenate([[0.0], np.cumsum(wide)]), np.concatenate([[0.0], np.cumsum(wide**2)])
    sums, squares = (c[n:] - c[:-n] for c in ones)
    spread = np.sqrt(np.maximum(squares - sums**2 / n, 0.0)) * np.linalg.norm(a)
    if not (np.linalg.norm(a) > 0.0 and spread.max() > 1e-12 * n * np.abs(wide).max()):
        raise RecordingError("A signal is constant.", advice="It has no lag: choose one that moves.")
    share = product / np.maximum(spread, 1e-12 * spread.max())
    at, correlation = _top(share)
    gain = float(np.interp(at, np.arange(share.size), product)) / float(a @ a)
    return (at - steps) / rate, correlation, gain


def _top(share: np.ndarray) -> tuple[float, float]:
    """Place of the highest peak of correlations (M,), in samples, and its height."""
    k = int(np.argmax(np.abs(share)))
    low = np.flatnonzero(np.abs(share) < PEAK_SHARE * np.abs(share[k]))
    half = int(np.abs(low - k).min()) if low.size else share.size
    half = min(max(half, LEAST_HALF), k, share.size - 1 - k)
    if half < 3:
        return float(k), float(share[k])
    for _ in range(3):
        curve = Polynomial.fit(np.arange(-half, half + 1), share[k - half : k + half + 1], 4)
        top = minimize_scalar(lambda t: -abs(float(curve(t))), bounds=(-half, half), method="bounded")  # noqa: B023
        moved = min(max(k + round(float(top.x)), half), share.size - 1 - half)
        if moved == k:
            break
        k = moved
    return k + float(top.x), float(curve(float(top.x)))


def _jackknife(reference: np.ndarray, wide: np.ndarray, middle: int, steps: int, rate: float) -> float:
    """Standard deviation of the lag [s] from leaving out one after another of blocks of equal energy."""
    n = reference.size
    energy = np.cumsum((reference - reference.mean()) ** 2)
    cuts = np.searchsorted(energy, energy[-1] * np.arange(1, BLOCKS) / BLOCKS)
    edges = np.unique(np.concatenate([[0], cuts]))
    reach = min(steps, max(20, round(0.05 * rate)))
    lags = np.arange(max(middle - reach, 0), min(middle + reach, 2 * steps) + 1)
    windows = np.lib.stride_tricks.sliding_window_view(wide, n)[lags]
    parts = [np.add.reduceat(x, edges, axis=1) for x in (windows * reference, windows, windows**2)]
    a1, a2, counts = (np.add.reduceat(x, edges) for x in (reference, reference**2, np.ones(n)))
    found = []
    for k in range(edges.size):
        ab, b, bb = (p.sum(axis=1) - p[:, k] for p in parts)
        m = n - counts[k]
        sa, saa = a1.sum() - a1[k], a2.sum() - a2[k]
        spread = np.sqrt(np.maximum(bb - b**2 / m, 1e-300) * max(saa - sa**2 / m, 1e-300))
        found.append(_top((ab - sa * b / m) / spread)[0])
    blocks = len(found)
    if blocks < 3:
        return float("inf")
    return float(np.sqrt((blocks - 1) / blocks * np.sum((np.array(found) - np.mean(found)) ** 2))) / rate


def _check_signal(signal: tuple[ArrayLike, ArrayLike], name: str) -> tuple[np.ndarray, np.ndarray]:
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
