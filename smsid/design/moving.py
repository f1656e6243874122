"""Designs Exp. 2: joints and wheels in motion, free floating."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from smsid.design.forecast import Forecast
from smsid.design.goal import Criterion, Goal, goal_of
from smsid.design.limits import Limits, experiment_use
from smsid.design.series import SeriesSpace
from smsid.design.watch import Watch
from smsid.errors import ExperimentError, SmsidError
from smsid.experiments import Experiment, LimitUse
from smsid.likelihood.prediction import Prediction
from smsid.model.spacecraft import SpacecraftModel
from smsid.simulate.trajectory import States

HARMONICS, PERIODS = 5, 2  # as in the paper
DRAWS = 30  # random series that the search begins with
STEPS = 240  # of the search
WIDTH, NARROWEST = 0.3, 0.02  # of its steps, in the size of a joint's coefficients
GROW, SHRINK = 1.5, 1.5**-0.25  # after a success, and after a failure
STEEP = 1.5  # price of a limit passed: a little more than what keeping it costs
LEAST = 1e-3  # share of the motion below which limits leave nothing to measure
PASSES = 8


@dataclass(frozen=True)
class Moving:
    """A motion that was found, as an experiment, with what is predicted of it."""

    experiment: Experiment
    goal: Goal
    covariance: np.ndarray
    point: np.ndarray
    shrink: float = 1.0


def design_motion(
    model: SpacecraftModel,
    wanted: Sequence[str],
    criterion: Criterion,
    limits: Limits,
    duration: float,
    rng: np.random.Generator,
    watch: Watch[Moving],
    start: np.ndarray | None = None,
    effort: float = 1.0,
) -> tuple[Moving, Moving]:
    """Return the best motion of a duration [s] that the search finds, and the first random one.

    Random Fourier series first, then steps of random directions from the best, longer after a success and
    shorter after failures (Rechenberg 1973). An interrupt leaves the best in the watch. ``start``: a point to
    begin from instead of random ones, (size,).

    Raises `ExperimentError` when no motion keeps the limits.
    """
    space = SeriesSpace(model, limits, duration, HARMONICS, PERIODS)
    if not space.size:
        raise ExperimentError(
            f"'{model.description.name}' has neither arm joints nor wheels to move.",
            advice="Design a thrust: --mode thrust.",
        )
    forecast = Forecast.of(model, duration)
    first = space.random(rng)
    _, generic = forecast.motion(space.experiment(first))
    goal = goal_of(forecast.parameters, wanted, criterion, generic)

    def look(point: np.ndarray) -> tuple[float, Moving]:
        experiment = space.experiment(point)
        normal, prediction = forecast.motion(experiment)
        covariance = normal.covariance()
        share = max(limits.share(u) for u in limits.use(model, as_states(model, prediction), False))
        cost = goal.cost(covariance) + STEEP * np.log(max(share, 1.0))
        return cost, Moving(experiment, goal, covariance, point)

    def tried(point: np.ndarray) -> tuple[float, Moving]:
        try:
            cost, made = look(point)
        except SmsidError:
            return np.inf, Moving(space.experiment(point), goal, np.eye(1), point)
        watch.tried(made, cost, float(np.exp(cost)))
        return cost, made

    origin = tried(first)
    best = origin if start is None else min(origin, tried(start), key=lambda x: x[0])
    for _ in range(0 if start is not None else max(1, int(effort * DRAWS)) - 1):
        best = min(best, tried(space.random(rng)), key=lambda x: x[0])
    cost, made = best
    x, width = _normed(made.point, space), WIDTH
    for _ in range(int(effort * STEPS)):
        step = width / np.sqrt(2.0 * HARMONICS) * rng.normal(size=x.size)
        new, better = tried(x + step)
        if new < cost:
            x, cost, made = better.point, new, better
            width *= GROW
        else:
            width = max(NARROWEST, width * SHRINK)
    return made, origin[1]


def within_limits(
    model: SpacecraftModel, made: Moving, limits: Limits
) -> tuple[Moving, tuple[LimitUse, ...]]:
    """Return a motion shrunk until its simulation keeps all limits, and what it uses of them.

    Raises `ExperimentError` naming the limits that next to no motion would keep.
    """
    space = SeriesSpace(model, limits, made.experiment.duration, HARMONICS, PERIODS)
    shrink = made.shrink
    for _ in range(PASSES):
        experiment = space.experiment(made.point, shrink, made.experiment.name)
        uses = experiment_use(model, experiment, limits)
        broken = limits.broken(uses)
        if not broken:
            return Moving(experiment, made.goal, made.covariance, made.point, shrink), uses
        if shrink <= LEAST:
            break
        shrink = max(LEAST, shrink * 0.995 / max(limits.share(u) for u in broken))
    raise ExperimentError(
        "No motion keeps these limits: " + "; ".join(map(str, broken)) + ".",
        advice="Loosen them, or design for a longer duration.",
        limits=broken,
    )


def as_states(model: SpacecraftModel, prediction: Prediction) -> States:
    """Return a predicted motion at every other node, the torques it takes as reactions."""
    kept = slice(None, None, 2)
    q, v, a = prediction.q[kept], prediction.v[kept], prediction.a[kept]
    timeline = prediction.timeline
    times = timeline.evaluations[timeline.node_evaluation][kept]
    reaction = np.array([pin.rnea(model.pin, model.data, *row) for row in zip(q, v, a, strict=True)])
    reaction[:, :6] = 0.0
    return States(times, q, v, a, np.zeros_like(v), reaction)


def _normed(point: np.ndarray, space: SeriesSpace) -> np.ndarray:
    """The point with the coefficients of every joint and wheel of unit length or less."""
    parts = point.reshape(-1, 2 * space.harmonics)
    size = np.linalg.norm(parts, axis=1, keepdims=True)
    return (parts / np.maximum(size, 1.0)).ravel()
