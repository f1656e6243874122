"""Joint motion as a smoothing spline: angle, rate and acceleration with the noise of all three.

The motion is an integrated Wiener process (one of its derivatives is white), the encoder adds white noise.
Both strengths, and which derivative it is, maximise the likelihood of the samples (Wahba 1985). A measured
rate is a second measurement of the same spline. Cutoff and noise are estimates, not choices.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.linalg.blas import dsbmv
from scipy.optimize import minimize_scalar
from scipy.sparse import csr_matrix, diags_array

from smsid._short_repr import short_repr

ORDERS = (3, 4, 6, 8)
"""Derivatives tried as the white one: jerk and up; a few sines are far smoother than their jerk says."""

KNOTS_PER_PERIOD = 8.0
"""Knots per period of the frequency above which the spline follows no more."""

COARSEST = 5.0
"""Rate of knots to start with [Hz]."""

LOG_RATIO = (-24.0, 40.0)
"""Bounds of the natural logarithm of the smoothing parameter, in knot spacings."""

SWEEPS = 3
"""Rounds of finding the noise of measured rates."""

LEAST = 20
"""Samples that a stretch must have."""

EDGE = 4.0
"""Correlation times of the spline's error that are left out at either end."""


@dataclass(frozen=True)
class Samples:
    """One stretch without gaps: ``time`` (n,) [s] and ``value`` (n,) of a joint, with the rate's own samples.

    ``rate_time`` (m,), ``rate`` (m,); both empty where no rate is measured.
    """

    time: np.ndarray
    value: np.ndarray
    rate_time: np.ndarray
    rate: np.ndarray


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


def smooth_joint(pieces: Sequence[Samples]) -> SmoothJoint:
    """Return the smoothing splines of a joint with smoothness and noise of greatest likelihood.

    All stretches share both. Knots are as many as the motion found asks for, at most one per sample.

    Args:
        pieces: stretches of at least `LEAST` samples each.
    """
    fits = []
    for order in ORDERS:
        fits.append(_fitted(pieces, order, 0.5 * fits[-1].cutoff if fits else 0.0))
        if len(fits) > 1 and fits[-1].criterion > fits[-2].criterion:
            break
    best = min(fits, key=lambda f: f.criterion)
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

    @cached_property
    def variance(self) -> float:
        return _variance(self.bases, self.log_ratio)

    @property
    def noise(self) -> float:
        return float(np.sqrt(self.variance))

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

    def reweighted(self) -> float:
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


def _fitted(pieces: Sequence[Samples], order: int, cutoff: float) -> _Fit:
    """Fit splines of an order with as many knots as they ask for; ``cutoff`` is what to begin with [Hz]."""
    step = float(np.median(np.concatenate([np.diff(p.time) for p in pieces])))
    shortest = min(float(p.time[-1] - p.time[0]) for p in pieces)
    knots = min(max(COARSEST, 4.0 / shortest, KNOTS_PER_PERIOD * cutoff), 1.0 / step)
    weight = step**2 if any(p.rate.size for p in pieces) else 0.0
    while True:
        bases = [_Basis(p, knots, order) for p in pieces]
        found = _Fit(bases, _likeliest(bases, weight), weight, step, knots)
        for _ in range(SWEEPS if weight > 0.0 else 0):
            weight = found.reweighted()
            found = _Fit(bases, _likeliest(bases, weight), weight, step, knots)
        if knots >= 0.999 / step or found.cutoff * KNOTS_PER_PERIOD <= knots:
            return found
        knots = min(max(2.0 * knots, KNOTS_PER_PERIOD * min(found.cutoff, 4.0 * knots)), 1.0 / step)


class _Basis:
    """B-splines on one stretch, with the bands of their normal equations."""

    def __init__(self, piece: Samples, rate: float, order: int) -> None:
        self.order, self.degree = order, order + 2
        start, end = piece.time[0], piece.time[-1]
        count = max(int(np.ceil((end - start) * rate)), 1)
        self.spacing = (end - start) / count
        self.knots = start + self.spacing * np.arange(-self.degree, count + self.degree + 1)
        self.size = count + self.degree
        self.unit = 1.0 / rate  # spacing that ratios of all stretches are in
        self.offset = float(np.mean(piece.value))
        value = piece.value - self.offset
        own = self._design(piece.time, 0)
        self.bands = _bands(own.T @ own, self.degree + 1)
        self.design, self.value = own, value
        self.square = float(value @ value)
        self.samples = value.size
        self.rate_samples = piece.rate.size
        if piece.rate.size:
            inside = np.clip(piece.rate_time, start, end)
            rates = self._design(inside, 1)
            self.rate_bands = _bands(rates.T @ rates, self.degree + 1)
            self.rate_design, self.rate = rates, piece.rate
            self.rate_square = float(piece.rate @ piece.rate)
        else:
            self.rate_bands, self.rate_square = 0.0 * self.bands, 0.0
        scale = (self.unit / self.spacing) ** (2 * self.order - 1)
        self.roughness = self._roughness(count) * np.sqrt(scale)
        self.penalty = _bands(self.roughness.T @ self.roughness, self.degree + 1)

    def _design(self, times: np.ndarray, derivative: int) -> csr_matrix:
        at = (times - self.knots[0]) / self.spacing
        grid = np.arange(self.size + self.degree + 1, dtype=float)
        if derivative == 0:
            return csr_matrix(BSpline.design_matrix(np.clip(at, self.degree, self.size), grid, self.degree))
        out = csr_matrix(
            BSpline.design_matrix(
                np.clip(at, self.degree, self.size), grid[derivative:-derivative], self.degree - derivative
            )
        )
        for k in range(derivative):
            n = self.size - derivative + k + 1
            rows = np.repeat(np.arange(n - 1), 2)
            columns = np.column_stack([np.arange(n - 1), np.arange(1, n)]).ravel()
            out = csr_matrix(out @ csr_matrix((np.tile([-1.0, 1.0], n - 1), (rows, columns)), (n - 1, n)))
        return csr_matrix(out / self.spacing**derivative)

    def _roughness(self, count: int) -> csr_matrix:
        """Rows whose squares sum to the integral of the squared white derivative, time in knot spacings.

        Gauss's rule with three points is exact for squares of quadratic pieces.
        """
        nodes, weights = np.polynomial.legendre.leggauss(3)
        at = (
            self.knots[self.degree] + self.spacing * (np.arange(count)[:, None] + 0.5 * (nodes + 1.0)).ravel()
        )
        white = self._design(at, self.order) * self.spacing**self.order
        weight = diags_array(np.sqrt(np.tile(0.5 * weights, count)))
        return csr_matrix(weight @ white)

    def weigh(self, weight: float) -> None:
        """Fix the weight of measured rates, and take a rough fit to measure all others from.

        Noise is a millionth of the motion: sums of squares are taken of residuals, and of differences from
        the rough fit, never as differences of large sums.
        """
        self.weight = weight
        self.normal = self.bands + weight * self.rate_bands
        ratio = 1e-9
        bands = self.normal + ratio * self.penalty
        bands[0] += 1e-12 * bands[0].max()
        root = cholesky_banded(bands, lower=True)
        self.rough = np.zeros(self.size)
        for _ in range(3):
            self.slope, self.rest = self._misfit(self.rough)
            step = self.slope - ratio * _times(self.penalty, self.rough)
            self.rough = self.rough + cho_solve_banded((root, True), step)
        self.slope, self.rest = self._misfit(self.rough)

    def _misfit(self, found: np.ndarray) -> tuple[np.ndarray, float]:
        left = self.value - self.design @ found
        slope, square = self.design.T @ left, float(left @ left)
        if self.rate_samples:
            behind = self.rate - self.rate_design @ found
            slope = slope + self.weight * (self.rate_design.T @ behind)
            square += self.weight * float(behind @ behind)
        return np.asarray(slope), square

    def solve(self, log_ratio: float) -> tuple[np.ndarray, float, float]:
        """Return coefficients, the penalised sum of squares, and the log-determinant of what is left free."""
        ratio = float(np.exp(log_ratio))
        bands = self.normal + ratio * self.penalty
        bands[0] += 1e-13 * bands[0].max()
        root = cholesky_banded(bands, lower=True)
        more = np.zeros(self.size)
        for _ in range(2):
            rough = ratio * _times(self.penalty, self.rough + more)
            more = more + cho_solve_banded((root, True), self.slope - _times(self.normal, more) - rough)
        found = self.rough + more
        bent = self.roughness @ found
        square = self.rest - 2.0 * float(self.slope @ more) + float(more @ _times(self.normal, more))
        square = max(square, 0.0) + ratio * float(bent @ bent)
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


def _times(bands: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Product of a symmetric banded matrix, by its lower bands, with x."""
    return dsbmv(bands.shape[0] - 1, 1.0, bands, x, lower=1)


def _bands(matrix: csr_matrix, width: int) -> np.ndarray:
    """Lower bands of a symmetric banded matrix, as LAPACK keeps them: (width, n)."""
    n = int(matrix.get_shape()[0])
    out = np.zeros((width, n))
    for k in range(min(width, n)):
        out[k, : n - k] = matrix.diagonal(-k)
    return out


def _objective(bases: Sequence[_Basis], log_ratio: float, weight: float) -> float:
    """Minus twice the log-likelihood, the noise's variance at its best."""
    left = free = 0.0
    count = -bases[0].order * len(bases)
    rates = 0
    for b in bases:
        _, own, determinant = b.solve(log_ratio)
        left, free = left + own, free + determinant
        count += b.samples + b.rate_samples
        rates += b.rate_samples
    value = count * np.log(left / count) + free
    return value - rates * np.log(weight) if rates else value


def _likeliest(bases: Sequence[_Basis], weight: float) -> float:
    for b in bases:
        b.weigh(weight)
    grid = np.linspace(*LOG_RATIO, 15)
    values = [_objective(bases, x, weight) for x in grid]
    k = int(np.argmin(values))
    bounds = (grid[max(k - 1, 0)], grid[min(k + 1, grid.size - 1)])
    found = minimize_scalar(
        lambda x: _objective(bases, x, weight), bounds=bounds, method="bounded", options={"xatol": 0.05}
    )
    return float(found.x)


def _variance(bases: Sequence[_Basis], log_ratio: float) -> float:
    left = sum(b.solve(log_ratio)[1] for b in bases)
    return left / max(sum(b.samples + b.rate_samples for b in bases) - bases[0].order * len(bases), 1)
