"""Joint motion as a smoothing spline: angle, rate and acceleration with the noise of all three.

The motion is an integrated Wiener process (one of its derivatives is white), the encoder adds white noise.
Both strengths, and which derivative it is, maximise the likelihood of the samples (Wahba 1985). A measured
rate is a second measurement of the same spline. Cutoff and noise are estimates, not choices.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from math import factorial

import numpy as np
from numpy.polynomial import polynomial
from scipy.interpolate import BSpline
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.linalg.blas import dsbmv

from smsid._short_repr import short_repr

ORDERS = (3, 4, 6, 8)
"""Derivatives tried as the white one: jerk and up; a few sines are far smoother than their jerk says."""

KNOTS_PER_PERIOD = 5.0
"""Knots per period of the frequency above which the spline follows no more."""

SAMPLES_PER_KNOT = 3
"""Samples per knot from which on twice as many are averaged two by two, and so on."""

COARSEST = 5.0
"""Rate of knots to start with [Hz]."""

LOG_RATIO = (-24.0, 40.0)
"""Bounds of the natural logarithm of the smoothing parameter, in knot spacings."""

AVERAGED = 16
"""Neighbours in the spectrum that are averaged for a first look at where the noise begins."""

COARSE, FINE = 1.5, 0.4
"""Distances of points through which the likelihood's logarithm is taken for a parabola."""

SWEEPS = 3
"""Rounds of finding the noise of measured rates."""

LEAST = 20
"""Samples that a stretch must have."""

EDGE = 4.0
"""Correlation times of the spline's error that are left out at either end."""


@dataclass(frozen=True)
class JointSamples:
    """One stretch without gaps: ``time`` (n,) [s] and ``value`` (n,) of a joint, with the rate's own samples.

    ``rate_time`` (m,), ``rate`` (m,); both empty where no rate is measured.
    """

    time: np.ndarray
    value: np.ndarray
    rate_time: np.ndarray
    rate: np.ndarray

    def neighbour_means(self, count: int) -> JointSamples:
        """Return the means of ``count`` neighbours each, where no rate is measured."""
        if count == 1 or self.rate.size:
            return self
        whole = self.time.size // count * count
        time, value = (x[:whole].reshape(-1, count).mean(axis=1) for x in (self.time, self.value))
        return JointSamples(time, value, self.rate_time, self.rate)


@short_repr
@dataclass(frozen=True)
class SmoothJoint:
    """Smoothing splines of one joint, one per stretch.

    ``cutoff`` [Hz] is where signal and noise are alike: above, the spline follows no more. ``noise`` and
    ``rate_noise`` are one standard deviation of an angle's and a rate's sample (NaN: no rate measured);
    ``sigma`` (3,) those of the spline's angle, rate and acceleration away from the ends.
    """

    splines: tuple[BSpline, ...]
    cutoff: float
    noise: float
    rate_noise: float
    sigma: np.ndarray

    @property
    def edge(self) -> float:
        """Time at either end of a stretch where the spline is less certain than ``sigma`` says [s]."""
        return EDGE / (2.0 * np.pi * self.cutoff)


def smooth_joint(pieces: Sequence[JointSamples]) -> SmoothJoint:
    """Return the smoothing splines of a joint with smoothness and noise of greatest likelihood.

    All stretches share both. Knots are as many as the motion found asks for, at most one per sample; samples
    that are far closer are averaged, which the spline's cutoff leaves nothing of.

    Args:
        pieces: stretches of at least `LEAST` samples each.
    """
    fits: list[_Fit] = []
    for order in ORDERS:
        fits.append(_fit_order(pieces, order, fits[-1] if fits else None))
        if len(fits) > 1 and fits[-1].criterion > fits[-2].criterion:
            break
    best = min(fits, key=lambda f: f.criterion)
    best = replace(best, log_ratio=_vertex(best.bases, best.weight, best.log_ratio, FINE))
    splines = tuple(b.spline(best.log_ratio) for b in best.bases)
    return SmoothJoint(splines, best.cutoff, best.noise, best.rate_noise, best.sigma)


@dataclass(frozen=True)
class _Fit:
    """A smoothing spline of one order at its likeliest; ``criterion`` is minus twice its log-likelihood."""

    bases: list[_Basis]
    log_ratio: float
    weight: float
    step: float
    knots: float
    merged: int

    @cached_property
    def variance(self) -> float:
        return _variance(self.bases, self.log_ratio)

    @property
    def noise(self) -> float:
        return float(np.sqrt(self.variance * self.merged))

    @property
    def rate_noise(self) -> float:
        return self.noise / np.sqrt(self.weight) if self.weight > 0.0 else float("nan")

    @cached_property
    def _spectra(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Frequencies [rad/s], what the samples tell, and what smoothness does, both times the variance."""
        order = self.bases[0].order
        omega = 2.0 * np.pi * np.geomspace(1e-4, 0.5 / self.step, 4000)
        share = sum(b.rate_samples for b in self.bases) / sum(b.samples for b in self.bases)
        known = (1.0 + self.weight * share * omega**2) / self.step
        smooth = np.exp(self.log_ratio + (1 - 2 * order) * np.log(self.knots) + 2 * order * np.log(omega))
        return omega, known, smooth

    @cached_property
    def cutoff(self) -> float:
        """Frequency where the spline's gain is one half [Hz]."""
        omega, known, smooth = self._spectra
        above = np.flatnonzero(smooth > known)
        return float(omega[above[0]] / (2.0 * np.pi)) if above.size else 0.5 / self.step

    @property
    def sigma(self) -> np.ndarray:
        """Standard deviations (3,) of the spline's angle, rate and acceleration, far from the ends."""
        omega, known, smooth = self._spectra
        density = self.variance / (known + smooth)
        return np.sqrt([np.trapezoid(omega ** (2 * d) * density, omega) / np.pi for d in range(3)])

    def noise_ratio(self) -> float:
        """Return the squared ratio of an angle's noise to a rate's, from what the spline leaves of both."""
        omega, known, smooth = self._spectra
        angles, rates = sum(b.samples for b in self.bases), sum(b.rate_samples for b in self.bases)
        left = np.sum([b.left(self.log_ratio) for b in self.bases], axis=0)
        told = 1.0 / (known + smooth)  # shares of its samples' freedom that the spline takes
        of_angles = np.trapezoid(told, omega) / np.pi * angles
        of_rates = np.trapezoid(self.weight * omega**2 * told, omega) / np.pi * rates
        square = left / np.maximum([angles - of_angles, rates - of_rates], [0.05 * angles, 0.05 * rates])
        return float(square[0] / max(square[1], 1e-300))

    @property
    def criterion(self) -> float:
        """Kolmogorov's formula for the variance of one-step predictions: comparable between orders."""
        omega, known, smooth = self._spectra
        samples = sum(b.samples for b in self.bases)
        rates = sum(b.rate_samples for b in self.bases)
        gain = np.trapezoid(np.log1p(known / smooth), omega) / np.pi * self.step
        value = (samples + rates) * np.log(self.variance) + samples * gain
        return float(value - rates * np.log(self.weight) if rates else value)


def _fit_order(pieces: Sequence[JointSamples], order: int, before: _Fit | None) -> _Fit:
    """Fit splines of an order with as many knots as they ask for, from a fit ``before`` of another order."""
    step = float(np.median(np.concatenate([np.diff(p.time) for p in pieces])))
    shortest = min(float(p.time[-1] - p.time[0]) for p in pieces)
    rates = any(p.rate.size for p in pieces)
    guess, merged, near = min(_first_cutoff(p, step) for p in pieces), 1, None
    if before:  # likelihoods are of the same samples
        guess, merged = before.cutoff, before.merged
    most = 1.0 / (step * merged)
    knots = min(max(COARSEST, 4.0 / shortest, KNOTS_PER_PERIOD * guess), most)
    weight = before.weight if before else step**2 if rates else 0.0
    if guess > 0.0:
        near = (2 * order - 1) * np.log(knots) - 2 * order * np.log(2.0 * np.pi * guess)
    while True:
        if not before and not rates:
            merged = max(1, int(1.0 / (SAMPLES_PER_KNOT * knots * step)))
        bases = [_Basis(p.neighbour_means(merged), knots, order) for p in pieces]
        for _ in range(SWEEPS + 1 if rates else 1):
            near = _likeliest(bases, weight, None if near is None else near - np.log(step * merged))
            found = _Fit(bases, near, weight, step * merged, knots, merged)
            near += np.log(step * merged)
            weight = found.noise_ratio() if rates else 0.0
        if knots >= 0.999 * most or found.cutoff * KNOTS_PER_PERIOD <= knots:
            return found
        more = min(max(2.0 * knots, KNOTS_PER_PERIOD * min(found.cutoff, 4.0 * knots)), most)
        near += (2 * order - 1) * np.log(more / knots)
        knots = more


def _first_cutoff(piece: JointSamples, step: float) -> float:
    """Return about where the spectrum of samples comes down to their noise [Hz]: where to begin."""
    n = piece.value.size
    window = np.sin(np.pi * (np.arange(n) + 0.5) / n) ** 4
    power = np.abs(np.fft.rfft((piece.value - piece.value.mean()) * window)) ** 2
    power = np.add.reduceat(power, np.arange(0, power.size, AVERAGED)) / AVERAGED
    first = int(np.argmax(power < 4.0 * np.median(power[power.size // 2 :])))
    return AVERAGED * first / (n * step)


class _Basis:
    """B-splines on one stretch, with the bands of their normal equations.

    Between knots, which are equally far apart, all splines are the same polynomials.
    """

    def __init__(self, piece: JointSamples, rate: float, order: int) -> None:
        self.order, self.degree = order, order + 2
        start, end = piece.time[0], piece.time[-1]
        count = max(int(np.ceil((end - start) * rate)), 1)
        self.spacing = (end - start) / count
        self.knots = start + self.spacing * np.arange(-self.degree, count + self.degree + 1)
        self.size = count + self.degree
        self.offset = float(np.mean(piece.value))
        self.value, self.rate = piece.value - self.offset, piece.rate
        self.samples, self.rate_samples = piece.value.size, piece.rate.size
        self.square = float(self.value @ self.value)
        shares = _cardinal(self.degree)
        self.design = _Rows((piece.time - start) / self.spacing, count, shares)
        self.bands = self.design.normal()
        if self.rate_samples:
            slopes = polynomial.polyder(shares) / self.spacing
            inside = np.clip((piece.rate_time - start) / self.spacing, 0.0, count)
            self.rate_design = _Rows(inside, count, slopes)
            self.rate_bands = self.rate_design.normal()
        white = polynomial.polyder(shares, order)  # of degree 2
        scale = (1.0 / (rate * self.spacing)) ** (2 * order - 1)  # in spacings that all stretches share
        powers = np.arange(len(white))
        self.roughness = np.linalg.cholesky(scale / (1.0 + powers[:, None] + powers)).T @ white
        own = self.roughness.T @ self.roughness
        self.penalty = _bands(np.broadcast_to(own[:, :, None], (*own.shape, count)))

    def weigh(self, weight: float) -> None:
        """Fix the weight of measured rates, and take a rough fit to measure all others from.

        Noise is a millionth of the motion: sums of squares are taken of residuals, and of differences from
        the rough fit, never as differences of large sums.
        """
        self.weight = weight
        self.normal = self.bands + weight * self.rate_bands if self.rate_samples else self.bands
        bands = self.normal + 1e-9 * self.penalty
        bands[0] += 1e-12 * bands[0].max()
        root = cholesky_banded(bands, overwrite_ab=True, lower=True, check_finite=False)
        slope = self.design.transpose_product(self.value)
        if self.rate_samples:
            slope += weight * self.rate_design.transpose_product(self.rate)
        self.rough = cho_solve_banded((root, True), slope, check_finite=False)
        self.slope, self.rest = self._misfit(self.rough)
        self.bent = _times(self.penalty, self.rough)

    def _misfit(self, found: np.ndarray) -> tuple[np.ndarray, float]:
        left = self.value - self.design @ found
        slope, square = self.design.transpose_product(left), float(left @ left)
        if self.rate_samples:
            behind = self.rate - self.rate_design @ found
            slope = slope + self.weight * self.rate_design.transpose_product(behind)
            square += self.weight * float(behind @ behind)
        return slope, square

    def solve(self, log_ratio: float, *, refined: bool = True) -> tuple[np.ndarray, float, float]:
        """Return coefficients, the penalised sum of squares, and the log-determinant of what is left free.

        The sum is least at the coefficients: it needs none that are ``refined``.
        """
        ratio = float(np.exp(log_ratio))
        bands = self.normal + ratio * self.penalty
        bands[0] += 1e-13 * bands[0].max()
        root = cholesky_banded(bands, lower=True, check_finite=False)
        wanted = self.slope - ratio * self.bent
        more = cho_solve_banded((root, True), wanted, check_finite=False)
        if refined:
            more = more + cho_solve_banded((root, True), wanted - _times(bands, more), check_finite=False)
        found = self.rough + more
        square = self.rest - 2.0 * float(self.slope @ more) + float(more @ _times(self.normal, more))
        square = max(square, 0.0) + ratio * float(np.sum((_local(found, self.roughness)) ** 2))
        free = 2.0 * float(np.sum(np.log(root[0]))) - (self.size - self.order) * log_ratio
        return found, square + 1e-30 * self.square + 1e-300, free

    def left(self, log_ratio: float) -> tuple[float, float]:
        """Return the sums of squares that the spline leaves of angles and of rates."""
        found, _, _ = self.solve(log_ratio)
        angle = self.value - self.design @ found
        rate = self.rate - self.rate_design @ found if self.rate_samples else np.zeros(0)
        return float(angle @ angle), float(rate @ rate)

    def spline(self, log_ratio: float) -> BSpline:
        found, _, _ = self.solve(log_ratio)
        return BSpline(self.knots, found + self.offset, self.degree, extrapolate=True)


class _Rows:
    """Values of cardinal B-splines, or of their derivative, at samples: polynomials in the share ``phase`` of
    a knot's spacing, whose coefficients (powers, splines) are the same everywhere.
    """

    def __init__(self, at: np.ndarray, count: int, polynomials: np.ndarray) -> None:
        self.index = np.clip(np.floor(at).astype(np.intp), 0, count - 1)
        self.phase, self.count, self.polynomials = at - self.index, count, polynomials

    def __matmul__(self, coefficients: np.ndarray) -> np.ndarray:
        """Values (n,) of the spline with coefficients (size,)."""
        *others, out = (part[self.index] for part in _local(coefficients, self.polynomials))
        for part in reversed(others):
            out *= self.phase
            out += part
        return out

    def moments(self, values: np.ndarray | None, powers: int) -> np.ndarray:
        """Sums (powers, count) over each interval's samples of values (n,) times powers of the phase."""
        out, weight = np.empty((powers, self.count)), values
        for k in range(powers):
            out[k] = np.bincount(self.index, weight, self.count)
            weight = self.phase if weight is None else weight * self.phase
        return out

    def transpose_product(self, values: np.ndarray) -> np.ndarray:
        """Sums (size,) over the samples of values (n,) times each spline."""
        local = self.polynomials.T @ self.moments(values, len(self.polynomials))
        out = np.zeros(self.count + len(local) - 1)
        for k, part in enumerate(local):
            out[k : k + self.count] += part
        return out

    def normal(self) -> np.ndarray:
        """Lower bands of the normal equations."""
        powers, width = self.polynomials.shape
        products = np.zeros((2 * powers - 1, width, width))
        for k, row in enumerate(self.polynomials):
            products[k : k + powers] += row[:, None] * self.polynomials[:, None, :]
        local = products.reshape(-1, width * width).T @ self.moments(None, 2 * powers - 1)
        return _bands(local.reshape(width, width, -1))


@cache
def _cardinal(degree: int) -> np.ndarray:
    """Coefficients (degree + 1 powers, degree + 1 splines) of the B-splines between two integer knots."""
    element = BSpline.basis_element(np.arange(degree + 2.0))
    starts = np.arange(degree, -1.0, -1.0)
    return np.array([element(starts, nu=k) / factorial(k) for k in range(degree + 1)])


def _local(coefficients: np.ndarray, polynomials: np.ndarray) -> np.ndarray:
    """Coefficients (powers, intervals) of a spline's polynomial between each two knots."""
    return np.array([np.correlate(coefficients, row, "valid") for row in polynomials])


def _bands(local: np.ndarray) -> np.ndarray:
    """Lower bands (splines, size), as LAPACK keeps them, of sums of what each interval says of the products
    of the splines on it, (splines, splines, intervals).
    """
    width, _, count = local.shape
    out = np.zeros((width, count + width - 1), order="F")
    for k in range(width):
        for other in range(k, width):
            out[other - k, k : k + count] += local[k, other]
    return out


def _times(bands: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Product of a symmetric banded matrix, by its lower bands, with x."""
    return dsbmv(bands.shape[0] - 1, 1.0, bands, x, lower=1)


def _objective(bases: Sequence[_Basis], log_ratio: float, weight: float) -> float:
    """Minus twice the log-likelihood, the noise's variance at its best."""
    left = free = 0.0
    count = -bases[0].order * len(bases)
    rates = 0
    for b in bases:
        _, own, determinant = b.solve(log_ratio, refined=False)
        left, free = left + own, free + determinant
        count += b.samples + b.rate_samples
        rates += b.rate_samples
    value = count * np.log(left / count) + free
    return value - rates * np.log(weight) if rates else value


def _likeliest(bases: Sequence[_Basis], weight: float, near: float | None) -> float:
    """Return the logarithm of the ratio of greatest likelihood, from one that is ``near``, or from a grid."""
    for b in bases:
        b.weigh(weight)
    if near is not None:
        return _vertex(bases, weight, near, COARSE)
    return float(min(np.linspace(*LOG_RATIO, 15), key=lambda x: _objective(bases, x, weight)))


def _vertex(bases: Sequence[_Basis], weight: float, near: float, width: float) -> float:
    """Return where a parabola through three points is least, ``width`` apart and about the least of them."""

    def value(x: float) -> float:
        return _objective(bases, x, weight)

    low, high = LOG_RATIO
    x = np.clip(near, low + width, high - width) + width * np.array([-1.0, 0.0, 1.0])
    f = np.array([value(p) for p in x])
    while (k := int(f.argmin())) != 1 and low < x[k] < high:
        new = float(np.clip(x[k] + (x[2] - x[0]) * (k - 1), low, high))
        x, f = np.insert(x, k + k // 2, new), np.insert(f, k + k // 2, value(new))
        x, f = (x[:3], f[:3]) if k == 0 else (x[1:], f[1:])
    if k != 1:
        return float(x[k])
    slopes = np.diff(f) / np.diff(x)
    bend = (slopes[1] - slopes[0]) / (x[2] - x[0])
    return float(0.5 * (x[0] + x[1]) - 0.5 * slopes[0] / bend) if bend > 0.0 else float(x[1])


def _variance(bases: Sequence[_Basis], log_ratio: float) -> float:
    left = sum(b.solve(log_ratio)[1] for b in bases)
    return left / max(sum(b.samples + b.rate_samples for b in bases) - bases[0].order * len(bases), 1)
