"""The likelihood of several recordings at a point: its value, slope and Gauss-Newton curvature, in pieces."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid.estimation._smoothed_motion import SmoothedRun, smoothed_runs
from smsid.estimation._unread_start import derivative, initial_knowledge
from smsid.estimation._walks_by_gain import WalkDerivatives, walks_as_read
from smsid.estimation.filter_run import FilterRun
from smsid.estimation.flight import Flight
from smsid.estimation.kalman import KalmanFilter
from smsid.estimation.map_estimate import columns_of
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.estimation.problem import Problem
from smsid.estimation.sensitivities import Sensitivities, propagate

SAMPLES_AT_ONCE = 2000  # samples whose derivatives are in memory at once
SLOPE_PARTS = 40  # parts of a recording whose slopes are compared
LAGS = 20  # of the autocorrelation of the innovations


@dataclass(frozen=True)
class InnovationSums:
    """Sums over the normalised innovations of one recording, by row of its measurements.

    ``count``, ``squares``, ``fourths`` (their fourth powers) (rows,) and ``products`` (rows, LAGS) at lags 1
    to `LAGS`, outliers limited.
    """

    names: tuple[str, ...]
    channels: tuple[str, ...]
    count: np.ndarray
    squares: np.ndarray
    fourths: np.ndarray
    products: np.ndarray
    pairs: np.ndarray
    parts: int = SLOPE_PARTS

    @property
    def excess(self) -> float:
        """Excess kurtosis of the slope of a part: that of innovations, the largest, over how many it has."""
        read = self.squares > 0.0
        kurtosis = self.fourths[read] * self.count[read] / self.squares[read] ** 2
        each = np.maximum(1.0, self.count[read] / self.parts)
        return float(np.max((kurtosis - 3.0) / each, initial=0.0))


@dataclass(frozen=True)
class Term:
    """A recording's part of the normal equations, or that of a piece of it: data alone, no prior.

    ``volume`` is what of ``log_likelihood`` does not count where parameters are compared (`profiled`).
    ``scatter`` (m, m) is the sum of the outer products of the slopes of `SLOPE_PARTS` parts of the recording:
    where the model is right and innovations are white, its mean is the Gram matrix.
    """

    label: str
    gram: np.ndarray
    slope: np.ndarray
    scatter: np.ndarray
    log_likelihood: float
    samples: int
    innovations: InnovationSums
    volume: float = 0.0


@dataclass(frozen=True)
class NormalEquations:
    """All recordings and the prior at a point.

    ``gram`` (m, m) and ``slope`` (m,) are in units of `Unknown.scale`; ``objective`` is minus the
    log-posterior without constants. ``information`` (m, m) is the data's share of the Gram matrix. ``exact``
    ones are by differences of whole runs (`smsid.estimation._differences`).
    """

    point: Point
    unknowns: tuple[Unknown, ...]
    terms: tuple[Term, ...]
    gram: np.ndarray
    slope: np.ndarray
    objective: float
    exact: bool = False

    @property
    def recordings(self) -> tuple[Term, ...]:
        """The terms, with the pieces of a recording, which share its label, summed."""
        out: dict[str, Term] = {}
        for t in self.terms:
            own = out.get(t.label)
            if own is not None:
                a, b = own.innovations, t.innovations
                names = ("count", "squares", "fourths", "products", "pairs")
                sums = replace(a, **{n: getattr(a, n) + getattr(b, n) for n in names})
                t = Term(
                    t.label,
                    own.gram + t.gram,
                    own.slope + t.slope,
                    own.scatter + t.scatter,
                    own.log_likelihood + t.log_likelihood,
                    own.samples + t.samples,
                    sums,
                    own.volume + t.volume,
                )
            out[t.label] = t
        return tuple(out.values())

    @property
    def log_posterior(self) -> float:
        """The log-posterior with all that counts where noise is compared, or timing, without constants."""
        return sum(t.volume for t in self.terms) - self.objective

    @property
    def information(self) -> np.ndarray:
        """What the data say (m, m), without the prior."""
        return np.sum([t.gram for t in self.terms], axis=0)

    @property
    def scales(self) -> np.ndarray:
        """Scales of the parameters (m,)."""
        return np.array([u.scale for u in self.unknowns])

    @property
    def samples(self) -> int:
        """Number of readings that count."""
        return sum(t.samples for t in self.terms)


def objective_of(point: Point, unknowns: Sequence[Unknown], flights: Sequence[Flight]) -> float:
    """Return minus the log-posterior at a point, without constants.

    Raises `SimulationError` where a filter loses its recording.
    """
    likely = sum(_compared(run, f.problem) for f in flights for run in _runs(point, f))
    return 0.5 * float(np.sum(prior_offset(point, unknowns) ** 2)) - likely


def log_likelihood_of(point: Point, flights: Sequence[Flight]) -> float:
    """Return the log-likelihood at a point, without constants, by which noise and timing are compared.

    Raises `SimulationError` where a filter loses its recording.
    """
    return sum(run.log_likelihood for f in flights for run in _runs(point, f))


def log_determinant_of(point: Point, flights: Sequence[Flight]) -> float:
    """Return what of the log-likelihood at a point is by the volume of the innovations alone, in recordings
    whose joints or wheels follow their measured motion.

    Raises `SimulationError` where a filter loses its recording.
    """
    own = (f for f in flights if replace(f.problem, averaged=False).profiled)
    return sum(run.volume for f in own for run in _runs(point, f))


def _compared(run: FilterRun, problem: Problem) -> float:
    """Return the log-likelihood by which parameters are compared, without constants."""
    if problem.at_likeliest_motion:
        return run.fit
    return run.log_likelihood - problem.profiled * run.volume


def _runs(point: Point, flight: Flight) -> Iterator[FilterRun]:
    kalman = KalmanFilter(point.model(), problem_at(point, flight))
    for _ in range(0, len(flight.problem.data.times), SAMPLES_AT_ONCE):
        yield kalman.advance(SAMPLES_AT_ONCE)


def _runs_along(kalman: KalmanFilter) -> Iterator[SmoothedRun]:
    """Yield a filter's runs, and of each what is differentiated along: itself, or the likeliest motion where
    the likelihood is that of it.
    """
    if kalman.problem.at_likeliest_motion:
        yield from smoothed_runs(kalman, SAMPLES_AT_ONCE)
        return
    for _ in range(0, len(kalman.problem.data.times), SAMPLES_AT_ONCE):
        run = kalman.advance(SAMPLES_AT_ONCE)
        yield SmoothedRun(run, run)


def normal_equations(point: Point, unknowns: Sequence[Unknown], flights: Sequence[Flight]) -> NormalEquations:
    """Return value, slope and curvature of the log-posterior at a point.

    Source: Gauss-Newton on the innovations (prediction-error method; Ljung, System Identification, ch. 7).
    Raises `SimulationError` where a filter loses its recording.
    """
    terms = tuple(_term(point, tuple(unknowns), f) for f in flights)
    off = prior_offset(point, unknowns)
    rate = np.array([u.scale / u.sigma for u in unknowns])
    gram = np.sum([t.gram for t in terms], axis=0) + np.diag(rate**2)
    slope = np.sum([t.slope for t in terms], axis=0) - rate * off
    objective = 0.5 * float(off @ off) - sum(t.log_likelihood - t.volume for t in terms)
    return NormalEquations(point, tuple(unknowns), terms, gram, slope, objective)


def prior_offset(point: Point, unknowns: Sequence[Unknown]) -> np.ndarray:
    """Return how far parameters are from their priors' means, in standard deviations (m,)."""
    return np.array([(point.value(u) - u.nominal) / u.sigma for u in unknowns])


def problem_at(point: Point, flight: Flight) -> Problem:
    """Return the problem with the sensors, and the state at its beginning, as they are at the point."""
    sensors = point.for_recording(flight.label).sensors()
    data = flight.problem.data.with_blocks(sensors)
    return walks_as_read(replace(flight.problem, data=data, begin=initial_knowledge(point, flight)))


def _term(point: Point, unknowns: tuple[Unknown, ...], flight: Flight) -> Term:
    here = point.for_recording(flight.label)
    start = f"{flight.label}: "
    own = [
        (i, replace(u, name=u.name.removeprefix(start)) if u.of_recording else u)
        for i, u in enumerate(unknowns)
        if not u.of_recording or u.name.startswith(start)
    ]
    index, mine = np.array([i for i, _ in own], dtype=int), [u for _, u in own]
    model, problem = here.model(), problem_at(point, flight)
    kalman = KalmanFilter(model, problem)
    delta = np.zeros((kalman.covariance.shape[0], len(mine)))
    for k, u in enumerate(mine):
        if u.kind == "start":
            delta[: 2 * flight.model.nv, k] = derivative(here, flight, u)
    scales = np.array([u.scale for u in mine])
    gram, likely, volume, samples = np.zeros((len(mine),) * 2), 0.0, 0.0, 0
    sums = _Sums(problem.data)
    count = len(problem.data.times)
    blocks = np.zeros((SLOPE_PARTS, len(mine)))
    walks = WalkDerivatives.of(here, mine, kalman)
    for first, smoothed in zip(range(0, count, SAMPLES_AT_ONCE), _runs_along(kalman), strict=True):
        run = smoothed.ran
        changes = Sensitivities(here, model, problem, smoothed.along, kalman.driving)
        whitened = propagate(run, walks.with_walks(columns_of(changes, mine), smoothed, delta), delta)
        if not problem.at_likeliest_motion:
            whitened[:, run.given] = 0.0
        scores = np.einsum("nrm,nr->nm", whitened, run.innovations)
        np.add.at(blocks, np.arange(first, first + len(scores)) * SLOPE_PARTS // count, scores)
        flat = whitened.reshape(-1, len(mine))
        gram += flat.T @ flat
        likely += run.log_likelihood
        volume += run.log_likelihood - _compared(run, problem)
        samples += run.samples
        sums.add(np.where(run.used, run.normalised, np.nan))
    slope, scatter = blocks.sum(axis=0), blocks.T @ blocks
    whole = np.zeros((len(unknowns),) * 2)
    whole[np.ix_(index, index)] = gram * np.outer(scales, scales)
    spread = np.zeros_like(whole)
    spread[np.ix_(index, index)] = scatter * np.outer(scales, scales)
    tilt = np.zeros(len(unknowns))
    tilt[index] = slope * scales
    return Term(flight.label, whole, tilt, spread, likely, samples, sums.done(), volume)


class _Sums:
    """Sums over normalised innovations, some samples at a time."""

    LIMIT = 5.0  # standard deviations beyond which an innovation counts no more

    def __init__(self, data) -> None:
        self.data = data
        self.count, self.squares, self.fourths = np.zeros((3, data.rows))
        self.products, self.pairs = np.zeros((2, data.rows, LAGS))
        self.last = np.full((LAGS, data.rows), np.nan)

    def add(self, normalised: np.ndarray) -> None:
        x = np.vstack([self.last, normalised])
        self.count += np.isfinite(normalised).sum(axis=0)
        self.squares += np.nansum(normalised**2, axis=0)
        self.fourths += np.nansum(normalised**4, axis=0)
        scale = np.sqrt(np.maximum(self.squares / np.maximum(self.count, 1.0), 1e-300))
        x = np.clip(x, -self.LIMIT * scale, self.LIMIT * scale)
        for lag in range(1, LAGS + 1):
            both = x[LAGS:] * x[LAGS - lag : len(x) - lag]
            self.products[:, lag - 1] += np.nansum(both, axis=0)
            self.pairs[:, lag - 1] += np.isfinite(both).sum(axis=0)
        self.last = x[-LAGS:]

    def done(self) -> InnovationSums:
        blocks = self.data.blocks
        channels = tuple(b.channel for b in blocks for _ in range(b.rows.stop - b.rows.start))
        sums = self.count, self.squares, self.fourths, self.products, self.pairs
        return InnovationSums(self.data.names, channels, *sums)
