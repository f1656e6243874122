"""Intervals of causes' strengths by the profile of the likelihood, where that is bent.

A mass at an unknown place acts by its mass times the square of its distance, and little besides: along that
ridge a standard deviation from the curvature says too little, and slopes along the filter's states do not
lead to the top.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid.diagnose.model_comparison import Cause
from smsid.diagnose.stepwise import Search
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.errors import SmsidError
from smsid.estimation.joint_problem import at_point
from smsid.estimation.kalman import run_filter
from smsid.estimation.likelihood_profile import (
    BetterMaximum,
    at_rest,
    bent_intervals,
    poorly_known,
)
from smsid.estimation.map_estimate import MapFit, evaluate, fit, objective
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.estimation.problem import Problem

LOGGER = logging.getLogger(__name__)

Interval = tuple[float, float]


@dataclass(frozen=True)
class PosteriorOfProblem:
    """That of the recordings of a problem, see `smsid.estimation.likelihood_profile.Posterior`."""

    unknowns: tuple[Unknown, ...]
    problem: Problem

    def objective(self, point: Point) -> float:
        """Return minus the log-posterior of all parameters at a point."""
        run = run_filter(point.model(), at_point(point, self.problem))
        return objective(point, self.unknowns, self.problem, run)

    def at_best(self, start: Point, others: Sequence[Unknown]) -> tuple[Point, float]:
        """Return the most likely point near a start with ``others`` free, and their objective."""
        best = fit(start, others, self.problem, iterations=20, enough=0.02)
        at_rest(best)
        return best.point, best.objective


def with_profile_intervals(found: Search) -> Search:
    """Return a search with its last fit at the top of its ridge, and intervals of its causes from there.

    Misfit that is counted as noise has no likelihood to follow.
    """
    if found.misfit or not found.causes:
        return found
    try:
        last, bent = profile_intervals(found.last, found.causes)
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("no profiles: %s", error, exc_info=True)
        told = f"following the likelihood along what is poorly known failed and was left out: {error}"
        return replace(found, failed=(*found.failed, told))
    return replace(found, last=last, bent=bent)


def profile_intervals(found: MapFit, causes: Sequence[Cause]) -> tuple[MapFit, dict[str, Interval]]:
    """Return the fit at the top of its ridge, and intervals (95 %) that no Gaussian describes, by name."""
    if found.problem.noise.shapes:  # their errors are none of the likelihood's
        return found, {}
    for _ in range(THRESHOLDS.restarts):
        covariance = found.covariance() / np.outer(found.scales, found.scales)
        names = [u.name for u in found.unknowns]
        own = [
            names.index(n)
            for c in causes
            if _is_quick(found, c)
            for n in c.score.candidate.free
            if n in names
        ]
        doubtful = poorly_known(found, covariance, own, THRESHOLDS.poorly_known)
        if not doubtful:
            return found, {}
        posterior = PosteriorOfProblem(found.unknowns, found.problem)
        also = [names.index(n) for c in causes for n in c.score.candidate.also if n in names]
        rows = [*own, *also]
        try:
            bent = bent_intervals(
                found, posterior, doubtful, np.eye(len(names))[rows], covariance, more=THRESHOLDS.more_likely
            )
        except BetterMaximum as better:
            LOGGER.info("a more likely point was met along %s", [names[i] for i in doubtful])
            found = evaluate(better.point, found.unknowns, found.problem)
            continue
        return found, {
            names[i]: _from(found, found.unknowns[i], b.ends)
            for i, b in ((rows[k], b) for k, b in bent.items())
        }
    # its top was not reached: how far they go is not known
    doubtful = poorly_known(found, covariance, own, THRESHOLDS.poorly_known)
    return found, {names[i]: _from(found, found.unknowns[i], (-np.inf, np.inf)) for i in doubtful}


def _is_quick(found: MapFit, cause: Cause) -> bool:
    """Whether a fit with a cause takes seconds: where it swings between samples, fits take minutes, and a
    profile is many of them.
    """
    effect = cause.score.candidate.effect
    return effect is None or not cause.score.candidate.instance(found.point).has_fast_dynamics()


def _from(found: MapFit, unknown: Unknown, ends: Interval) -> Interval:
    value = found.point.value(unknown)
    low, high = (value + end * unknown.scale for end in ends)
    return max(float(low), unknown.lower), min(float(high), unknown.upper)
