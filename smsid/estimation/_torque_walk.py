"""How torques that nobody recorded wander, told by what they drive: maximum likelihood.

A prior that is wider or smoother than the torques were makes inertias wrong, not only uncertain: with a wide
one the readings' noise is taken for motion, which pulls inertias as errors in a regressor do, and with a
smooth one the motion is taken for noise. So its spectrum is the readings' own: a random walk of the
acceleration, or of its rate, whichever explains the angles or rates of a joint better, by a scalar Kalman
filter (Harvey, *Forecasting, Structural Time Series Models and the Kalman Filter* (1989), 3.4 and 4.2).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np

SPAN, SPANS = 1000, 4  # samples that are read at a time; spans of a long recording
DECADES = np.arange(-3.0, 3.51, 0.5)  # of a walk, about what acceleration and jerk alone would have it
UNKNOWN_FACTOR = 3.0  # times its root mean square that an acceleration which is not known may be
MOST_KEPT = 1000  # readings of which what was found is kept


@dataclass(frozen=True)
class AccelerationWalk:
    """How the acceleration of a joint wanders: ``walk`` [rad/s^2/sqrt(s)] of itself, or [rad/s^3/sqrt(s)] of
    its rate, whose standard deviation at the start is ``slope`` [rad/s^3] then and zero else.
    """

    walk: float
    slope: float


_found: dict[bytes, AccelerationWalk] = {}


def acceleration_walks(
    times: np.ndarray,
    readings: np.ndarray,
    sigma: np.ndarray,
    integrations: int,
    scales: tuple[np.ndarray, np.ndarray],
) -> list[AccelerationWalk]:
    """Return how accelerations behind readings (N, k) of noise ``sigma`` (k,) wander, at ``times`` (N,) [s].

    Readings are rates, or after two ``integrations`` angles; those that are missing are NaN. ``scales`` are
    the root mean squares (k,) of acceleration and jerk, which the search begins about. What was found of a
    reading is kept: a search for exchanged columns asks for the same ones again and again.
    """
    read = np.isfinite(readings).any(axis=1)  # others' clocks are no samples
    times, readings = times[read], readings[read]
    keys = [
        hashlib.sha256(b"".join(np.ascontiguousarray(x).tobytes() for x in (times, y, *of_one))).digest()
        for y, *of_one in zip(readings.T, sigma, *scales, np.full(len(sigma), integrations), strict=True)
    ]
    own = {key: _found[key] for key in keys if key in _found}
    new = [i for i, key in enumerate(keys) if key not in own]
    if new:
        of_new = scales[0][new], scales[1][new]
        walks = _walks(times, readings[:, new], sigma[new], integrations, of_new)
        own.update(zip((keys[i] for i in new), walks, strict=True))
    if len(_found) > MOST_KEPT:
        _found.clear()
    _found.update(own)
    return [own[key] for key in keys]


def _walks(
    times: np.ndarray,
    readings: np.ndarray,
    sigma: np.ndarray,
    integrations: int,
    scales: tuple[np.ndarray, np.ndarray],
) -> list[AccelerationWalk]:
    acceleration, jerk = (np.maximum(x, 1e-12) for x in scales)
    guesses = (np.sqrt(2.0 * acceleration * jerk), jerk * np.sqrt(2.0 * jerk / acceleration))
    ladder = 10.0**DECADES
    found = []
    for order, guess in enumerate(guesses, start=1):
        start = np.stack([UNKNOWN_FACTOR * acceleration, UNKNOWN_FACTOR * jerk][:order], axis=1)
        likely = _log_likelihood(times, readings, sigma, integrations, start, np.outer(ladder, guess))
        best = np.argmax(likely, axis=0)
        found.append((guess * 10.0 ** (_peak(likely, best)), likely[best, np.arange(len(best))]))
    (plain, as_walk), (smooth, as_slope) = found
    return [
        AccelerationWalk(float(s), float(UNKNOWN_FACTOR * j)) if b > a else AccelerationWalk(float(p), 0.0)
        for p, a, s, b, j in zip(plain, as_walk, smooth, as_slope, jerk, strict=True)
    ]


def _peak(likely: np.ndarray, best: np.ndarray) -> np.ndarray:
    """Return the logarithms (k,) to base 10 at which likelihoods (ladder, k) are largest, by parabolas."""
    out = DECADES[best]
    for i in np.flatnonzero((best > 0) & (best < len(DECADES) - 1)):
        low, top, high = likely[best[i] - 1 : best[i] + 2, i]
        curvature = low - 2.0 * top + high
        if np.isfinite(curvature) and curvature < 0.0:
            out[i] += 0.5 * (DECADES[1] - DECADES[0]) * (low - high) / curvature
    return out


def _log_likelihood(
    times: np.ndarray,
    readings: np.ndarray,
    sigma: np.ndarray,
    integrations: int,
    start: np.ndarray,
    walks: np.ndarray,
) -> np.ndarray:
    """Return log-likelihoods (ladder, k) without constants of readings (N, k) for ``walks`` (ladder, k).

    The state is what is read, its derivatives up to the acceleration and, of order two, its rate; ``start``
    (k, order) are standard deviations of the last ones. What wanders jumps at the samples.
    """
    ladder, k = walks.shape
    order = start.shape[1]
    width = integrations + order
    spans = 1 if len(times) <= SPANS * SPAN else SPANS
    count = len(times) if spans == 1 else SPAN
    first = np.linspace(0, len(times) - count, spans).astype(int)
    total = np.zeros((spans, ladder, k))
    state = np.zeros((spans, ladder, k, width))
    begins = readings[first][:, None]
    state[..., 0] = np.where(np.isfinite(begins), begins, np.nanmean(readings, axis=0))
    p = np.zeros((spans, ladder, k, width, width))
    p[..., 0, 0] = np.where(np.isfinite(begins), 0.0, np.nanvar(readings, axis=0)) + sigma**2
    for i in range(1, integrations):
        reach = times[first + 1] - times[first]  # a rate that was not read: as of two readings
        p[..., i, i] = (2.0 * sigma / reach[:, None, None]) ** 2 + 1.0
    for i in range(order):
        p[..., integrations + i, integrations + i] = start[:, i] ** 2
    steps = np.arange(width)
    powers = np.maximum(steps[None, :] - steps[:, None], 0)
    factorial = np.where(steps[None, :] >= steps[:, None], 1.0 / _factorials(powers), 0.0)
    variance = sigma**2
    for n in range(1, count):
        h = times[first + n] - times[first + n - 1]
        move = factorial * h[:, None, None] ** powers
        move = move[:, None, None]
        state = (move @ state[..., None])[..., 0]
        p = move @ p @ np.swapaxes(move, -1, -2)
        jump = move[..., -1]
        p += (walks**2 * h[:, None, None])[..., None, None] * (jump[..., :, None] * jump[..., None, :])
        error = readings[first + n][:, None] - state[..., 0]
        s = p[..., 0, 0] + variance
        there = np.isfinite(error)
        total -= np.where(there, 0.5 * (error**2 / s + np.log(s)), 0.0)
        gain = np.where(there, 1.0 / s, 0.0)[..., None] * p[..., 0]
        state = state + gain * np.where(there, error, 0.0)[..., None]
        p = p - gain[..., :, None] * p[..., 0, :][..., None, :]
    return total.sum(axis=0)


def _factorials(n: np.ndarray) -> np.ndarray:
    return np.cumprod([1.0, *range(1, int(n.max()) + 1)])[n]
