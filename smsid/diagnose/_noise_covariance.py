"""Noise levels from what a fit leaves: the sensors' own, and where the model cannot follow, its misfit."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.signal import welch

from smsid.diagnose._unknown_input import with_unknown
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.errors import SimulationError, SmsidError
from smsid.estimation.filter_run import FilterRun
from smsid.estimation.innovations import normalised_rmse
from smsid.estimation.joint_problem import at_point
from smsid.estimation.kalman import run_filter
from smsid.estimation.loosening import loosen_model
from smsid.estimation.map_estimate import ENOUGH_GAIN, MapFit, continue_fit, evaluate, fit
from smsid.estimation.measurements import ChannelSlice, Measurements, matrix
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.estimation.problem import Problem, ProcessNoise

LOGGER = logging.getLogger(__name__)
LOOSE = ProcessNoise(force=0.1, torque=0.1, joint=0.1, wheel=1e-3)
MISFIT = THRESHOLDS.misfit
FOLLOWED = THRESHOLDS.followed
LEVELLED = 15  # times at most that levels and fit are brought together; five to ten are common
FEW = THRESHOLDS.noise_told
SHARES = (1.0, 0.1, 0.01, 1e-3)  # process noise, as a share of what drives the motion
NEAR = 10.0  # gain of the log-posterior below which a first, loose fit is near enough


@dataclass(frozen=True)
class InflatedFit:
    """A fit with the noise levels it was made with: factors on the stated ones (rows,).

    ``misfit`` is ``True`` where they count what the model cannot follow, not the sensors' noise alone;
    ``alone`` where a component or a channel was not fitted, as it strays by itself. ``unknown`` names the
    structure whose motion was taken as unknown; where ``local`` is ``False``, none may be. ``strict`` is the
    process noise as stated where the model of the fit may err by more.
    """

    fit: MapFit
    factors: np.ndarray
    misfit: bool = False
    alone: bool = False
    unknown: str = ""
    local: bool = True
    strict: ProcessNoise | None = None

    @property
    def stated(self) -> Problem:
        """The problem with the noise as stated."""
        problem, noise = self.fit.problem, self.strict or self.fit.problem.noise
        return replace(problem, data=problem.data.scaled(1.0 / self.factors), noise=noise, coloured=False)

    @property
    def by_channel(self) -> dict[str, float]:
        """Noise level over the stated one, by channel: root mean square over its components."""
        blocks = self.fit.problem.data.blocks
        return {b.channel: float(np.sqrt(np.mean(self.factors[b.rows] ** 2))) for b in blocks}

    @property
    def left(self) -> float:
        """The sum of squared errors, in stated noise."""
        left = self.fit.residual[: self.fit.run.innovations.size].reshape(-1, len(self.factors))
        return float(self.factors**2 @ (left**2).sum(axis=0))

    def explained(self, columns: np.ndarray, estimate: np.ndarray) -> float:
        """Return by how much columns (N rows + priors, d) times their estimate (d,) lower the sum of squared
        errors in stated noise.
        """
        rows = self.fit.run.innovations.size
        done, left = (columns @ estimate)[:rows], self.fit.residual[:rows]
        gained = (done * (2.0 * left - done)).reshape(-1, len(self.factors)).sum(axis=0)
        return float(self.factors**2 @ gained)


def first_fit(point: Point, problem: Problem, unknowns: Sequence[Unknown]) -> InflatedFit:
    """Fit parameters to the noise as stated, not to the end.

    Raises `SimulationError` when the start cannot be filtered.
    """
    try:
        found = fit(point, unknowns, problem, iterations=3)
        if normalised_rmse(found.run) <= MISFIT:
            return InflatedFit(found, np.ones(problem.data.rows))
    except SimulationError as error:
        LOGGER.info("not at once: %s", error)
    # far off, the motion drifts too far for a linear step: first with inputs that are not quite believed
    near = fit(point, unknowns, replace(problem, noise=LOOSE), iterations=4, enough=NEAR).point
    return InflatedFit(fit(near, unknowns, problem, iterations=2), np.ones(problem.data.rows))


def erring_fit(point: Point, problem: Problem, unknowns: Sequence[Unknown]) -> InflatedFit | None:
    """Return a fit of a model that may err by the least share of what drives the motion with which it follows
    a recording that it loses; nothing where it never does.
    """
    for share in reversed(SHARES):
        try:
            found = fit(point, unknowns, loosen_model(point.model(), problem, share), iterations=4)
        except (SmsidError, np.linalg.LinAlgError) as error:
            LOGGER.info("nor if the model errs by %.2g of what drives it: %s", share, error)
            continue
        LOGGER.info("followed by a model that errs by %.2g of what drives it", share)
        return InflatedFit(found, np.ones(problem.data.rows), misfit=True, strict=problem.noise)
    return None


def strays_by_row(run: FilterRun, factors: np.ndarray) -> np.ndarray:
    """Return the root mean square of every component's prediction errors (rows,), in stated noise, outliers
    left out as in `normalised_rmse`; ``factors`` (rows,) are levels of the run's noise over that. Zero where
    little more than the start is read.
    """
    out = np.zeros(len(factors))
    for row in np.flatnonzero(run.used.sum(axis=0) >= FEW):
        x = run.normalised[run.used[:, row], row] ** 2
        out[row] = factors[row] * np.sqrt(np.minimum(x, np.quantile(x, 0.99)).mean())
    return out


def with_levels(found: InflatedFit, given: Point | None = None) -> InflatedFit:
    """Return a first fit with the noise level of every channel fitted, too; ``given`` is where it began.

    Where what is left is `MISFIT` times the noise or more, the model cannot follow, and no fit to the noise
    means anything: levels are then those of the misfit, over its slow frequencies, so that it weighs as much
    as noise that is as slow.
    """
    if normalised_rmse(found.fit.run) > MISFIT:
        own = found.fit
        alone = but_for_one(given or own.point, own.problem, own.unknowns, found.factors, own.run)
        return alone or with_misfit(replace(found, misfit=True))
    return with_noise(replace(found, fit=continue_fit(found.fit, iterations=8)))


def but_for_one(
    given: Point,
    whole: Problem,
    unknowns: Sequence[Unknown],
    factors: np.ndarray,
    first_run: FilterRun | None = None,
) -> InflatedFit | None:
    """Return the fit of all channels but one that strays by itself, where the others are followed; ``given``
    is where it begins, ``factors`` (rows,) are levels of the noise, ``first_run`` is the run of a first fit.

    That is a faulty sensor then: fitted with it, the rest would bend to it. The rest has its own levels,
    perhaps but for another one; what was left out is back with the noise of what it is off by, so that
    nothing follows it.
    """
    try:
        lost = _suspect(given, whole, first_run)
        if lost is None:
            return None
        problem = with_unknown(whole, lost.channel)
        fitted = continue_fit(first_fit(given, problem, unknowns).fit, iterations=8)
        if normalised_rmse(fitted.run) > FOLLOWED:
            return None
        LOGGER.info("%s strays by itself", lost.channel)
        levels = with_levels(InflatedFit(fitted, factors))
        run, values = levels.fit.run, whole.data.values.copy()
        seen = zip(run.predicted, run.states.q, strict=True)
        turns = [(x, matrix(q[3:7]) if levels.fit.changes.model.free else None) for x, q in seen]
        off = [whole.data.residual(k, *x)[lost.rows] for k, x in enumerate(turns)]
        size = np.sqrt(np.nanmean(np.square(off), axis=0)) / whole.data.sigma[lost.rows]
        own = levels.factors.copy()
        own[lost.rows] = np.maximum(factors[lost.rows] * size, 1.0)
        values[list(run.begins)] = problem.data.values[list(run.begins)]  # nor is its start read from it
        data = replace(whole.data, values=values).scaled(own / factors)
        again = evaluate(levels.fit.point, unknowns, replace(whole, data=data))
        return replace(levels, fit=again, factors=own, misfit=True, alone=True)
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("no channel strays by itself: %s", error)
        return None


def _suspect(given: Point, whole: Problem, first_run: FilterRun | None) -> ChannelSlice | None:
    """Return the channel that contradicts the others, or else the one with most of the errors of a first fit.

    Of a model that may err as much as it is driven, only sensors that contradict each other stray: without
    which one do they least?
    """
    blocks, model = whole.data.blocks, given.model()
    loose = loosen_model(model, at_point(given, whole), 1.0)

    def left(problem: Problem) -> float:
        try:
            return float(np.sum(run_filter(model, problem).innovations ** 2))
        except SimulationError:  # without its angles an arm is lost
            return np.inf

    if len(blocks) == 1:
        return None
    rest = [left(with_unknown(loose, b.channel)) for b in blocks]
    if min(rest) < THRESHOLDS.alone * left(loose):
        return blocks[int(np.argmin(rest))]
    if first_run is None:
        return None
    squares = np.where(first_run.used, first_run.normalised**2, 0.0).sum(axis=0)
    most = max(blocks, key=lambda b: squares[b.rows].sum())
    return most if squares[most.rows].sum() > THRESHOLDS.alone * squares.sum() else None


def exact_fit(found: InflatedFit) -> InflatedFit | None:
    """Return the fit to the noise as it is stated, where the model follows the recording that far."""
    exact = fit_to_stated_noise(found.fit.point, found.fit.unknowns, found.stated)
    return None if exact is None else with_noise(InflatedFit(exact, np.ones_like(found.factors)))


def fit_to_stated_noise(point: Point, unknowns: Sequence[Unknown], problem: Problem) -> MapFit | None:
    """Return a fit to the noise as stated, or nothing where the model does not follow that far: where one
    component alone is left far off, all would be known too well.
    """
    try:
        found, before = fit(point, unknowns, problem, iterations=2), np.inf
        while MISFIT < normalised_rmse(found.run) < THRESHOLDS.closer * before:
            before = normalised_rmse(found.run)
            found = continue_fit(found, iterations=2)
        if normalised_rmse(found.run) > MISFIT:
            return None
        found = continue_fit(found, iterations=6)
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("not to the noise: %s", error)
        return None
    left = strays_by_row(found.run, np.ones(problem.data.rows)).max()
    LOGGER.info("to the noise as stated, up to %.3g times that is left", left)
    return found if left < THRESHOLDS.own_channel and normalised_rmse(found.run) <= FOLLOWED else None


def with_noise(found: InflatedFit) -> InflatedFit:
    """Return a fit that follows with the noise level of every channel as large as its errors are."""
    for _ in range(2):
        factor = noise_factors(found.fit.problem.data, _told_by_noise(found.fit.problem, found.fit.run))
        if np.abs(factor - 1.0).max() < 0.03:
            break
        found = _fit_scaled_noise(found, factor)
    return found


def _told_by_noise(problem: Problem, run: FilterRun) -> FilterRun:
    """Return the run with the readings alone whose errors are mostly their sensor's noise, where an input is
    unknown or the shape of a law is left open: with that, others err by less than they are taken to.
    """
    if not (problem.noise.shapes or problem.noise.more):
        return run
    mostly = run.errors**2 <= 2.0 * (problem.data.sigma * run.normalised) ** 2
    return replace(run, used=run.used & mostly)


def with_misfit(found: InflatedFit) -> InflatedFit:
    """Return the fit whose noise levels are those of what it leaves, the likeliest of both; where little is
    left, that to the noise as stated.

    At first every channel bears what one of them has bent the fit to; only where levels and fit agree is
    misfit where it belongs.
    """
    for _ in range(LEVELLED):
        factor = misfit_factors(found.fit.problem.data, found.fit.run)
        factor = np.maximum(found.factors * factor, 1.0) / found.factors
        LOGGER.info("misfit: factors %.3g to %.3g more", factor.min(), factor.max())
        # what candidates are scored on is linear anyway: no need to be nearer than that
        found = replace(
            _fit_scaled_noise(found, factor, iterations=4, enough=NEAR, coloured=True), misfit=True
        )
        if np.abs(np.log(factor)).max() < 0.1:
            break
    near = normalised_rmse(found.fit.run, found.factors) <= FOLLOWED
    return (exact_fit(found) if near else None) or found


def _fit_scaled_noise(
    found: InflatedFit,
    factor: np.ndarray,
    iterations: int = 8,
    enough: float = ENOUGH_GAIN,
    *,
    coloured: bool = False,
) -> InflatedFit:
    problem = replace(found.fit.problem, data=found.fit.problem.data.scaled(factor), coloured=coloured)
    again = partial(fit, unknowns=found.fit.unknowns, problem=problem, iterations=iterations, enough=enough)
    try:
        fitted = again(found.fit.point)
    except SimulationError as error:  # where the last step of a fit goes is not filtered again
        LOGGER.info("from the step before: %s", error)
        fitted = again(found.fit.changes.point)
    return replace(found, fit=fitted, factors=found.factors * factor)


def noise_factors(data: Measurements, run: FilterRun) -> np.ndarray:
    """Return what every channel's stated noise is off by (rows,), from its prediction errors.

    From their variance, or where that is clearly larger, from that of their differences: what varies slowly
    is no noise. One factor a channel; components read in steps keep theirs.
    """
    out = np.ones(data.rows)
    for block in data.blocks:
        rows = np.arange(block.rows.start, block.rows.stop)
        if data.coarse is not None:
            rows = rows[~data.coarse[rows]]
        shares = []
        for row in rows:
            x = run.normalised[run.used[:, row], row]
            if len(x) < FEW:
                continue
            x = x[len(x) // 50 :]
            middle = np.abs(x) < 5.0 * np.median(np.abs(x)) + 1e-12  # outliers are no noise either
            rough = np.diff(x)
            calm = np.abs(rough) < 5.0 * np.median(np.abs(rough)) + 1e-12
            whole, fast = float(np.mean(x[middle] ** 2)), 0.5 * float(np.mean(rough[calm] ** 2))
            shares.append(whole if whole < THRESHOLDS.slow * fast else fast)
        if shares:
            out[rows] = np.sqrt(np.mean(shares))
    return out


def misfit_factors(data: Measurements, run: FilterRun) -> np.ndarray:
    """Return by what the noise of every component (rows,) is to grow for its misfit to weigh as noise.

    White noise of that level has as much power as the prediction errors at the frequency where they have
    most (Welch's, of `THRESHOLDS.spectrum` segments): a slow error is one error, however often it is sampled.
    """
    out = np.ones(data.rows)
    for row in range(data.rows):
        x = run.normalised[run.used[:, row], row]
        if len(x) < FEW:
            continue
        _, power = welch(x, nperseg=max(len(x) // THRESHOLDS.spectrum, FEW // 2), detrend=False)  # pyright: ignore
        out[row] = float(np.sqrt(0.5 * power[:-1].max()))
    return out
