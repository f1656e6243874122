"""A motion that is measured, not predicted: least-squares B-splines through positions and rates.

A quintic spline on uniform knots gives angle, rate and acceleration that belong together. Positions carry the
slow part of the motion (at frequency f a position noise s is a rate noise of 2 pi f s only), rates the fast
part; least squares with their noise as weights takes both. The number of intervals is the one that Akaike's
criterion prefers: misfit of the motion biases every parameter, while noise of the motion is averaged.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline
from scipy.linalg import cholesky_banded, solveh_banded
from scipy.sparse import csr_array, diags_array

from smsid.identify.gap_filling import with_spikes
from smsid.identify.valid_samples import outliers

DEGREE = 5
CLEANINGS = 3
COARSEST = 20.0  # [s] between the knots that are tried first
LOOKS, ENOUGH = 4, 2500  # stretches of a long record, and samples of each, that its knots are chosen by
SMOOTH = 1e-12  # weight of third differences of coefficients, relative to that of samples
SLACK = 1e-9  # [s]
ROWS = 1 << 16  # of a design at a time
WINDOW = DEGREE + 2  # functions that act somewhere in a stretch no longer than the spacing of the knots


@dataclass(frozen=True)
class DerivativeSamples:
    """Measurements of one derivative (0: angle, 1: rate): times (N,) [s], values (N, k), sigma (k,)."""

    derivative: int
    times: np.ndarray
    values: np.ndarray
    sigma: np.ndarray

    def only(self, kept: np.ndarray | slice) -> DerivativeSamples:
        """Return some of the samples (N,)."""
        return replace(self, times=self.times[kept], values=self.values[kept])


@dataclass(frozen=True)
class FittedMotion:
    """A fitted motion of k coordinates.

    ``spline`` gives (N, k). ``angle_density`` and ``rate_density`` (k,) are the standard deviations that
    white noise on samples of the angle, or of the rate, taken ``per`` second, would need to be as uncertain
    in band as the fit: its mean variance times samples over coefficients. ``information`` (k, 6, m) of the
    coefficients (m, k) as `bands`. ``samples`` are what it was fitted to, ``sensor`` what took them.
    ``clock`` (offset [s], drift [1]) is what their clock shows too much: the spline runs by that clock,
    `values` by the true one. ``rate`` [Hz] is that of the densities.
    """

    spline: BSpline
    intervals: int
    angle_density: np.ndarray
    rate_density: np.ndarray
    information: np.ndarray
    samples: tuple[DerivativeSamples, ...] = ()
    sensor: str = ""
    clock: tuple[float, float] = (0.0, 0.0)
    rate: float = 1.0

    @property
    def spacing(self) -> float:
        """Distance of the knots [s]."""
        t = self.spline.t
        return float((t[-1] - t[0]) / self.intervals)

    @property
    def coefficients(self) -> np.ndarray:
        """Coefficients of the basis (m, k)."""
        return self.spline.c

    def with_coefficients(self, coefficients: np.ndarray) -> FittedMotion:
        """Return the motion with other coefficients (m, k)."""
        return replace(self, spline=BSpline(self.spline.t, coefficients, DEGREE))

    def divided(self, factor: int) -> FittedMotion:
        """Return the same motion on knots that are so many times as dense."""
        t = self.spline.t
        knots = _knots(float(t[0]), float(t[-1]), factor * self.intervals)
        # averages of the inner knots: collocation there determines every coefficient
        places = np.array([knots[i + 1 : i + DEGREE + 1].mean() for i in range(len(knots) - DEGREE - 1)])
        spline = make_interp_spline(places, self.spline(places), k=DEGREE, t=knots)
        return replace(self, spline=spline, intervals=factor * self.intervals)

    def refitted(self, intervals: int) -> FittedMotion:
        """Return the motion that its samples have on so many intervals."""
        t = self.spline.t
        found = _Fitted.of(list(self.samples), float(t[0]), float(t[-1]), intervals).motion(self.rate)
        return replace(found, samples=self.samples, sensor=self.sensor, clock=self.clock)

    def with_clock(self, clock: np.ndarray) -> FittedMotion:
        """Return the motion as it was if the sensor's ``clock`` (2,) shows so much [s, 1] too much."""
        return replace(self, clock=(float(clock[0]), float(clock[1])))

    def windows(self, starts: np.ndarray) -> np.ndarray:
        """Return the first (N,) of the functions that act from ``starts`` (N,) [s] to one spacing on."""
        t = self.spline.t
        interval = np.clip(((starts - t[0]) / self.spacing + 1e-9).astype(int), 0, self.intervals - 1)
        return np.minimum(interval, len(self.spline.c) - WINDOW)

    def basis(self, times: np.ndarray, first: np.ndarray) -> np.ndarray:
        """Return values and two derivatives (3, N, WINDOW) of the functions from ``first`` (N,) on.

        At ``times`` (N,) [s].
        """
        out = np.zeros((3, len(times), WINDOW))
        row = np.arange(len(times))
        for d, own in enumerate(out):
            values, start = _acting_functions(times, self.spline.t, d)
            for k, column in enumerate(values.T):
                place = start + k - first
                inside = (place >= 0) & (place < WINDOW)  # what lies outside is zero there
                own[row[inside], place[inside]] = column[inside]
        return out

    def values(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return angle, rate and acceleration (N, k) each, at true ``times`` (N,) [s].

        Where another clock asks beyond the ends the spline goes on.
        """
        own, pace, e = self._own(times)
        angle, rate, acceleration = (self._derivative(own, d) * pace ** (e - d) for d in range(3))
        return angle, rate, acceleration

    def by_clock(self, times: np.ndarray) -> np.ndarray:
        """Return the derivatives of `values` (3, N, k, 2) by offset and drift of the clock."""
        own, pace, e = self._own(times)
        late = (own - self.spline.t[0])[:, None]
        out = []
        for d in range(3):
            by_time = self._derivative(own, d + 1)
            by_drift = by_time * late - (e - d) * self._derivative(own, d)
            out.append(np.stack([by_time, by_drift], axis=-1) * pace ** (e - d - 1))
        return np.stack(out)

    def _own(self, times: np.ndarray) -> tuple[np.ndarray, float, int]:
        """What the sensor's clock shows at true times (N,) [s], its pace, which derivative it reads as is."""
        start, pace = self.spline.t[0], 1.0 - self.clock[1]
        read = min((s.derivative for s in self.samples), default=0)
        return start + (times - start + self.clock[0]) / pace, pace, read

    def _derivative(self, times: np.ndarray, order: int) -> np.ndarray:
        return self.spline.derivative(order)(times) if order else self.spline(times)


def fit_motion(
    samples: list[DerivativeSamples],
    start: float,
    stop: float,
    rate: float,
    shortest: float,
    sensor: str = "",
) -> FittedMotion:
    """Fit a motion between start and stop [s]; ``rate`` [Hz] is that of the densities.

    Knots are no closer than ``shortest`` [s]. Rates alone leave the angle free by a constant; it starts at
    zero then. Samples that are not finite are left out, those after the stop (before the start all is at
    rest), and those far outside of their noise; where there are none the motion goes on smoothly.
    """
    samples = [s.only(s.times < stop + SLACK) for s in samples]
    lost = [np.asarray(~np.isfinite(s.values).all(axis=1)) for s in samples]
    samples = [s.only(~with_spikes(s.values, x, s.sigma)) for s, x in zip(samples, lost, strict=True)]
    fitted = _best(samples, start, stop, shortest)
    for _ in range(CLEANINGS):
        bad = [outliers(s.values - along(fitted.spline, s.times, s.derivative))[0] for s in samples]
        if not any(b.any() for b in bad):
            break
        samples = [s.only(~b) if b.any() else s for s, b in zip(samples, bad, strict=True)]
        long = len(_stretches(samples, start, stop)) > 1  # then few samples do not decide on the knots
        fitted = (
            _Fitted.of(samples, start, stop, fitted.intervals)
            if long
            else _best(samples, start, stop, shortest)
        )
    return replace(fitted.motion(rate), samples=tuple(samples), sensor=sensor)


def _best(samples: list[DerivativeSamples], start: float, stop: float, shortest: float) -> _Fitted:
    best: tuple[float, int] | None = None
    intervals, worse = 4, 0
    stretches = _stretches(samples, start, stop)
    length = stretches[0][2] - stretches[0][1]
    while length / intervals > COARSEST:
        intervals = int(np.ceil(intervals * 1.3))
    while length / intervals >= shortest and worse < 3:
        score = sum(_Fitted.of(*stretch, intervals).score for stretch in stretches)
        if best is None or score < best[0]:
            best, worse = (score, intervals), 0
        else:
            worse += 1
        intervals = int(np.ceil(intervals * 1.3))
    assert best is not None
    return _Fitted.of(samples, start, stop, int(best[1] * (stop - start) / length + SLACK))


def _stretches(
    samples: list[DerivativeSamples], start: float, stop: float
) -> list[tuple[list[DerivativeSamples], float, float]]:
    """The whole; of a long record stretches of one length, spread over it, and where most moves."""
    count = int(max(len(s.times) for s in samples) / ENOUGH)
    if count < 2 * LOOKS:
        return [(samples, start, stop)]
    edges, lively, full = np.linspace(start, stop, count + 1), np.zeros(count), np.ones(count, dtype=bool)
    cuts = [np.searchsorted(s.times, edges) for s in samples]
    for s, cut in zip(samples, cuts, strict=True):
        full &= np.diff(cut) > ENOUGH // 2
        first, scaled = np.minimum(cut[:-1], len(s.times) - 1), s.values / s.sigma
        lively += (np.maximum.reduceat(scaled, first) - np.minimum.reduceat(scaled, first)).sum(axis=1)
    able = np.flatnonzero(full)
    if len(able) < LOOKS:
        return [(samples, start, stop)]
    chosen = {*able[np.linspace(0, len(able) - 1, LOOKS).astype(int)], able[np.argmax(lively[able])]}
    return [
        ([s.only(slice(*cut[k : k + 2])) for s, cut in zip(samples, cuts, strict=True)], *edges[k : k + 2])
        for k in sorted(chosen)
    ]


@dataclass(frozen=True)
class _Fitted:
    """Least squares with so many intervals: coefficients (m, k), information (k, 6, m), Akaike's score."""

    knots: np.ndarray
    intervals: int
    coefficients: np.ndarray
    information: np.ndarray
    score: float

    @classmethod
    def of(cls, samples: list[DerivativeSamples], start: float, stop: float, intervals: int) -> _Fitted:
        knots = _knots(start, stop, intervals)
        size, width = intervals + DEGREE, samples[0].values.shape[1]
        sums = [basis_sums(s.times, knots, s.derivative, s.values) for s in samples]
        weights = [1.0 / s.sigma**2 for s in samples]
        smooth = bands(smoothness(size))
        anchored = any(s.derivative == 0 for s in samples)
        right = sum((x * w for (_, x), w in zip(sums, weights, strict=True)), np.zeros((size, width)))
        coefficients, information = np.empty((size, width)), np.empty((width, DEGREE + 1, size))
        for k in range(width):
            normal = sum((w[k] * g for (g, _), w in zip(sums, weights, strict=True)), np.zeros(smooth.shape))
            normal = normal + normal[0].max() * smooth
            if not anchored:
                normal[0, 0] += normal[0].max()
            information[k] = normal
            coefficients[:, k] = solveh_banded(normal, right[:, k], lower=True)
        score, spline = 2.0 * size * width, BSpline(knots, coefficients, DEGREE)
        for s in samples:
            score += float(np.sum(((s.values - along(spline, s.times, s.derivative)) / s.sigma) ** 2))
        return cls(knots, intervals, coefficients, information, score)

    @property
    def spline(self) -> BSpline:
        """The fitted motion."""
        return BSpline(self.knots, self.coefficients, DEGREE)

    def motion(self, rate: float) -> FittedMotion:
        """Return the motion with its densities per sample at ``rate`` [Hz]."""
        start, stop = float(self.knots[0]), float(self.knots[-1])
        size, width = self.coefficients.shape
        grid = np.linspace(start, stop, 4 * self.intervals + 1)
        covariance = inverse_bands(self.information)
        covariance[:, 1:] *= 2.0  # both halves
        densities = np.empty((2, width))
        for d, out in enumerate(densities):
            gram, _ = basis_sums(grid, self.knots, d, np.zeros((len(grid), 0)))
            total = np.sum(covariance * gram, axis=(1, 2))
            out[:] = np.sqrt(total / len(grid) * rate * (stop - start) / size)
        return FittedMotion(
            self.spline, self.intervals, densities[0], densities[1], self.information, rate=rate
        )


def inverse_bands(information: np.ndarray) -> np.ndarray:
    """Return the diagonal and lower diagonals (k, 6, m) of the inverses of k banded matrices, given as such.

    Source: Takahashi, Fagan and Chen (1973): from the last column to the first, within the band alone.
    """
    out = np.zeros_like(information)
    lower = np.stack([cholesky_banded(x, lower=True) for x in information])
    pivot, below = lower[:, 0], lower[:, 1:] / lower[:, :1]
    later = np.zeros((len(lower), DEGREE, DEGREE))  # the inverse by the next columns
    for i in range(lower.shape[2] - 1, -1, -1):
        own = -(later @ below[:, :, i, None])[..., 0]
        out[:, 0, i] = pivot[:, i] ** -2.0 - np.sum(below[:, :, i] * own, axis=1)
        out[:, 1:, i] = own
        later[:, 1:, 1:] = later[:, :-1, :-1].copy()
        later[:, 0, 0], later[:, 0, 1:] = out[:, 0, i], own[:, :-1]
        later[:, 1:, 0] = own[:, :-1]
    return out


def _knots(start: float, stop: float, intervals: int) -> np.ndarray:
    inner = np.linspace(start, stop, intervals + 1)
    return np.concatenate([[start] * DEGREE, inner, [stop] * DEGREE])


def bands(symmetric: csr_array) -> np.ndarray:
    """Return diagonal and lower diagonals (6, m) of a matrix whose functions act on common intervals only."""
    out = np.zeros((DEGREE + 1, symmetric.shape[0]))  # type: ignore[misc]
    for d in range(DEGREE + 1):
        out[d, : out.shape[1] - d] = symmetric.diagonal(-d)
    return out


def smoothness(size: int) -> csr_array:
    """Return the information (size, size) against third differences, relative to the samples' largest."""
    third = diags_array([-1.0, 3.0, -3.0, 1.0], offsets=[0, 1, 2, 3], shape=(size - 3, size))  # type: ignore[arg-type]
    return csr_array(SMOOTH * (third.T @ third))


def along(spline: BSpline, times: np.ndarray, derivative: int) -> np.ndarray:
    """Return a derivative (N, k) of a spline at times (N,) [s]; before the first knot that at it."""
    return spline(np.maximum(times, spline.t[0]), derivative)


def basis_sums(
    times: np.ndarray, knots: np.ndarray, derivative: int, columns: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return X^T X as `bands` (6, m) and X^T columns (m, k); X the basis on ``knots`` at rising ``times``."""
    size = len(knots) - DEGREE - 1
    gram, sums = np.zeros((DEGREE + 1, size)), np.zeros((size, columns.shape[1]))
    for start in range(0, len(times), ROWS):
        own = columns[start : start + ROWS]
        values, first = _acting_functions(times[start : start + ROWS], knots, derivative)
        values, begins = np.ascontiguousarray(values.T), np.flatnonzero(np.diff(first, prepend=-1))
        interval = first[begins]
        for i, x in enumerate(values):
            for d in range(DEGREE + 1 - i):
                gram[d, interval + i] += np.add.reduceat(x * values[i + d], begins)
            sums[interval + i] += np.add.reduceat(x[:, None] * own, begins, axis=0)
    return gram, sums


def _acting_functions(times: np.ndarray, knots: np.ndarray, derivative: int) -> tuple[np.ndarray, np.ndarray]:
    """Values (N, 6) of the functions that act at times (N,), and the first (N,) of them."""
    inner = knots[derivative : len(knots) - derivative]
    degree = DEGREE - derivative
    found = BSpline.design_matrix(np.maximum(times, knots[0]), inner, degree, extrapolate=True)
    values, first = found.data.reshape(-1, degree + 1), found.indices[:: degree + 1]
    # the derivative of a B-spline is one of lower degree on the inner knots, of scaled differences
    for d in range(derivative, 0, -1):
        own, degree = knots[d - 1 : len(knots) - d + 1], degree + 1
        place = first[:, None] + np.arange(degree)
        scaled = values * (degree / (own[place + degree + 1] - own[place + 1]))
        values = np.pad(scaled, ((0, 0), (1, 0))) - np.pad(scaled, ((0, 0), (0, 1)))
    return values, first
