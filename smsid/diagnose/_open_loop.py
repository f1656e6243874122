"""A model that simulates a recording by itself, from the initial state that fits the recording best."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import pinocchio as pin

from smsid.diagnose.thresholds import THRESHOLDS
from smsid.errors import SimulationError
from smsid.estimation.filter_run import FilterRun
from smsid.estimation.initial_state import InitialPrior, initial_belief
from smsid.estimation.joint_problem import at_point
from smsid.estimation.kalman import KalmanFilter, run_filter, with_moves
from smsid.estimation.map_estimate import MapFit
from smsid.estimation.measurements import Measurements
from smsid.estimation.moving_start import smoothed_start
from smsid.estimation.problem import Belief, Problem, ProcessNoise, recordings_of
from smsid.model.spacecraft import SpacecraftModel

LOGGER = logging.getLogger(__name__)
STEPS = 5  # of Gauss and Newton
TRUE = 0.5  # share of the predicted decrease above which the derivatives still hold
ENOUGH = 1e-2  # predicted decrease of the sum of squares, relative to it, that no longer matters
EXACT = 1e-9  # standard deviation of a start that is not to be corrected along the motion


def open_loop(model: SpacecraftModel, problem: Problem, closed: FilterRun | None = None) -> FilterRun:
    """Return a simulation of a recording from the initial state that the model fits to all of it.

    Readings of the first samples are the prior of that state, five standard deviations of noise wide; errors
    of a channel count in units of what the model leaves there, so that a wrong model does not bend its start
    to what it cannot follow. Nothing is corrected on the way. The search begins where the filter, whose run
    ``closed`` is where it is known, thinks in the end that the motion began.

    Raises `SimulationError` when the motion is lost.
    """
    data = problem.data
    prior = initial_belief(model, data, problem.locked, InitialPrior(hidden=problem.noise.hidden))
    prior = Belief(*with_moves(problem.moves, model, prior.q, prior.v), prior.covariance)
    weight = np.linalg.pinv(prior.covariance, hermitian=True)
    closed, alone = closed or run_filter(model, problem), _Alone(model, problem)
    at = smoothed_start(model, problem, closed)
    used, best = closed.used, replace(alone.simulated(at), used=closed.used)
    by_start, exact = _by_start(closed, model.nv), False
    level = _levels(data, best)
    cost = _squared_errors(best, level)
    for _ in range(STEPS):
        jacobian = by_start / level[None, :, None]
        flat = jacobian.reshape(-1, jacobian.shape[2])
        error = np.where(used, best.errors, 0.0) / level
        away = np.concatenate([pin.difference(model.pin, prior.q, at.q), at.v - prior.v])
        gram = flat.T @ flat + weight
        step = np.linalg.solve(gram, flat.T @ error.ravel() - weight @ away)
        promised = float(step @ gram @ step)
        if not promised > ENOUGH * cost:
            break
        better = None
        for share in (1.0, 0.3, 0.1):
            q = pin.integrate(model.pin, at.q, share * step[: model.nv])
            trial = replace(at, q=q, v=at.v + share * step[model.nv :])
            try:
                run = replace(alone.simulated(trial), used=used)
            except SimulationError as error:
                LOGGER.info("initial state refused: %s", error)
                continue
            if _squared_errors(run, level) < cost:
                better = trial, run
                break
        if better is None and exact:
            break
        at, best = better or (at, best)
        exact = cost - _squared_errors(best, level) < TRUE * promised
        if exact:  # curved, or not followed as the filter does: derivatives are those of here
            by_start = _by_start(alone.simulated(at, derive=True), model.nv)
        level = _levels(data, best)
        cost = _squared_errors(best, level)
    return best


class _Alone:
    """Runs from starts that no reading corrects."""

    def __init__(self, model: SpacecraftModel, problem: Problem) -> None:
        no_noise = ProcessNoise(force=0.0, torque=0.0, joint=0.0, wheel=0.0)
        deaf = replace(problem.data, sigma=np.full(problem.data.rows, 1.0 / EXACT))
        self._exact = np.diag(np.full(2 * model.nv, EXACT**2))
        self._filter = KalmanFilter(model, replace(problem, data=deaf, noise=no_noise, bias_walks=()))

    def simulated(self, start: Belief, *, derive: bool = False) -> FilterRun:
        """Return the run from a start; if asked, with derivatives along the motion."""
        until = np.inf if derive else -np.inf
        self._filter = self._filter.restarted(Belief(start.q, start.v, self._exact), until=until)
        return self._filter.advance(len(self._filter.problem.data.times))


def _by_start(run: FilterRun, nv: int) -> np.ndarray:
    """Return how the readings change with the initial state (N, rows, 2 nv)."""
    n, rows, _ = run.sensitivity.shape
    state = slice(2 * nv)  # without unknown inputs and biases that wander
    out, carried = np.zeros((n, rows, 2 * nv)), np.eye(2 * nv)
    for k in range(n):
        out[k] = run.sensitivity[k, :, state] @ carried
        if k < len(run.transition):
            carried = run.transition[k, state, state] @ carried
    return out * run.used[:, :, None]


def _levels(data: Measurements, run: FilterRun) -> np.ndarray:
    """Return the size of the errors (rows,) by channel: what is left, but at least the noise."""
    out = data.sigma.copy()
    for block in data.blocks:
        errors = np.where(run.used, run.errors, np.nan)[:, block.rows]
        if np.isfinite(errors).any():
            left = float(np.sqrt(np.nanmean((errors / data.sigma[block.rows]) ** 2)))
            out[block.rows] *= max(left, 1.0)
    return out


def _squared_errors(run: FilterRun, level: np.ndarray) -> float:
    return float(np.sum((np.where(run.used, run.errors, 0.0) / level) ** 2))


SETTLE = 5.0  # [s] corrected before the model runs by itself
QUANTITIES = ("joint_velocity", "angular_rate", "velocity")


def unexplained_fraction(fit: MapFit, noise: dict[str, float]) -> float:
    """Return the share of the motion that a model does not follow, open loop: the median of all rates.

    ``noise`` are noise levels over the stated ones by channel, as the fit has them. Not a number where
    nothing moves, or where the model runs away.
    """
    left: list[float] = []
    model = fit.point.model()
    here = at_point(fit.point, fit.problem)
    models = [part.model or model for part in here.parts] or [model]
    for own, problem in zip(models, recordings_of(here), strict=True):
        data = problem.data
        until = float(data.times[0]) + SETTLE
        try:
            run = run_filter(own, problem, until=until)
        except SimulationError:  # it runs away by itself: that says nothing of what it follows when corrected
            return float("nan")
        later = data.times > until
        for block in data.blocks:
            values = data.values[later, block.rows]
            if block.quantity not in QUANTITIES or not np.isfinite(values).any(axis=0).all():
                continue
            moved = np.nanstd(values, axis=0)
            off = np.sqrt(np.nanmean(run.errors[later, block.rows] ** 2, axis=0))
            stated = data.sigma[block.rows] / noise[block.channel]
            left += [o / m for o, m, s in zip(off, moved, stated, strict=True) if m > THRESHOLDS.moves * s]
    return float(np.median(left)) if left else float("nan")
