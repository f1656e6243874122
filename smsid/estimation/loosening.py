"""A model that may err a little: process noise as a share of what drives the motion."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from scipy.optimize import minimize_scalar

from smsid.errors import SmsidError
from smsid.estimation._normal_equations import log_likelihood_of
from smsid.estimation.flight import Flight, longest_step, longest_substep
from smsid.estimation.parameter_vector import Point
from smsid.estimation.problem import Problem, recordings_of
from smsid.estimation.process_model import inverse_inertias
from smsid.model.spacecraft import SpacecraftModel

LOGGER = logging.getLogger(__name__)
# share of what drives the motion that a model may err by at most, and by how much others differ; with more,
# slopes along states lead astray: they do not know that a likelihood falls with the mass, as noise is a force
FIRST_SHARE, SHARE_RATIO, FURTHEST = 0.3, 0.1, 5
NEARLY_AS_LIKELY = 0.1  # of log-likelihood a reading, that a model without errors may lack at the start
SMALL, COARSE = (-5.0, -4.0, -3.0, -2.0), {"xatol": 0.2}  # powers of ten: shares that a fit may err by
CLEAR_GAIN = 5.0  # gain of the log-likelihood with which a model errs

MOST_SAMPLES = 1000
"""Samples of a flight that first searches need: of more, those that the filter's linearisation does not."""


def thin_flight(flight: Flight) -> Flight:
    """Return a flight with no more samples than the first searches need, itself where it has no more.

    Sensors of other rates would be missed by every n-th sample: all samples are kept then.
    """
    data = flight.problem.data
    fewer, share = data.thinned(1.0 / longest_step(flight.model)), np.isfinite(data.values).mean(axis=0)
    if len(fewer.times) < MOST_SAMPLES or np.any((share > 0.0) & (share < 0.9)):
        return flight
    return replace(flight, problem=replace(flight.problem, data=fewer, substep=longest_substep(fewer)))


def likeliest_share(point: Point, flights: Sequence[Flight], most: float) -> float:
    """Return by which share of what drives it, at ``most``, a model at a point errs likeliest; 0 for hardly
    at all.
    """

    @cache
    def likely(power: int) -> float:
        return _likelihood(point, flights, most * SHARE_RATIO**power)

    power = 0
    while power < FURTHEST and likely(power + 1) > likely(power):
        power += 1
    share = most * SHARE_RATIO**power
    strict = _likelihood(point, flights, 0.0)
    LOGGER.info("errs by %.2g: %.1f, strict %.1f", share, likely(power), strict)
    readings = sum(int(np.isfinite(f.problem.data.values).sum()) for f in flights)
    return share if likely(power) > strict + NEARLY_AS_LIKELY * readings else 0.0


def with_likeliest_error(point: Point, flights: Sequence[Flight]) -> tuple[list[Flight], float]:
    """Return the flights with a model that may err by the share of what drives it that is likeliest at a
    point, and that share; 0 where none is clearly likelier than a model that does not err.
    """
    strict = _likelihood(point, flights, 0.0)

    @cache
    def gained(power: float) -> float:
        return _likelihood(point, flights, 10.0**power) - strict

    best = max(SMALL, key=gained)
    if gained(best) > 0.0:
        ends = best - 1.0, best + 1.0
        near = minimize_scalar(lambda x: -gained(x), bounds=ends, method="bounded", options=COARSE)
        best = max(best, float(near.x), key=gained)
    share, more = 10.0**best, gained(best)
    LOGGER.info("errs by %.2g: log-likelihood %+.1f", share, more)
    if more < CLEAR_GAIN:
        return list(flights), 0.0
    return [replace(f, problem=loosen_model(f.model, f.problem, share)) for f in flights], share


def _likelihood(point: Point, flights: Sequence[Flight], share: float) -> float:
    try:
        loose = [replace(f, problem=loosen_model(f.model, f.problem, share)) for f in flights]
        return log_likelihood_of(point, loose)
    except SmsidError as error:
        LOGGER.info("not with %.2g: %s", share, error)
        return -np.inf


def loosen_model(model: SpacecraftModel, problem: Problem, share: float) -> Problem:
    """Return a problem whose model may err, from sample to sample, by a share of what drives it.

    Errors are those of accelerations, as the forces that drive it would be at ``model``: were they forces, a
    heavier craft would be moved less by them, and seem likelier for that.
    """
    applied: list[np.ndarray] = []
    for own in recordings_of(problem):
        drive, times = own.inputs(model).applied(model), own.data.times
        applied += [drive(float(t)) for t in times[:: max(1, len(times) // 500)]]
    size = np.sqrt(np.mean(np.square(applied), axis=0))
    for unknown in problem.unknown_inputs:
        size[unknown.dof] = max(size[unknown.dof], unknown.sigma / 3.0)
    if model.free:
        inner = float(np.linalg.norm(size[6:]))
        lever = float(np.linalg.norm(model.thrust_point)) + 1.0
        force = float(np.linalg.norm(size[:3])) + inner / lever
        torque = float(np.linalg.norm(size[3:6])) + inner + lever * float(np.linalg.norm(size[:3]))
        size[:3], size[3:6] = np.hypot(size[:3], force), np.hypot(size[3:6], torque)
    moved = share * size * inverse_inertias(model, problem.locked)
    accelerations = tuple((int(v), float(moved[v])) for v in np.flatnonzero(moved))
    return replace(problem, noise=replace(problem.noise, accelerations=accelerations))
