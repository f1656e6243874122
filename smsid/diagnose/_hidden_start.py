"""Whether slosh and panels rest or move as a recording that is diagnosed begins.

A recording that begins at rest tells more if that is known, and a start in motion takes the place of much
that a model lacks; one that begins in motion and is taken for rest shows causes that are none.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from smsid.diagnose.thresholds import THRESHOLDS
from smsid.errors import SimulationError
from smsid.estimation.initial_state import InitialPrior
from smsid.estimation.innovations import normalised_rmse
from smsid.estimation.input_timing import CLEAR_GAIN, FOLLOWED_RATIO, MISFIT_RATIO
from smsid.estimation.joint_problem import at_point
from smsid.estimation.kalman import run_filter
from smsid.estimation.map_estimate import MapFit, fit
from smsid.estimation.moving_start import LOOKS, begun_so, in_motion, moving_joints, starts_of
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.estimation.problem import MovingStart, Problem, ProcessNoise

LOGGER = logging.getLogger(__name__)
STEPS = 3  # of a fit


def with_likely_start(point: Point, problem: Problem, unknowns: Sequence[Unknown] = ()) -> Problem:
    """Return a problem of a diagnosis whose hidden joints begin at rest, or in motion where that explains it.

    In motion they begin about where all readings put them, with the standard deviations of `InitialPrior`. A
    recording that begins at rest tells more if that is known, and a start in motion takes the place of much
    that a model lacks: it is believed only where it is far from rest, and where the model does not follow
    from rest and leaves noise from there, some steps of a fit of ``unknowns`` on.
    """
    rests = begun_so(problem, ProcessNoise().hidden, [()] * max(1, len(problem.parts)))
    if not len(moving_joints(point.model())):
        return rests
    try:
        if normalised_rmse(run_filter(point.model(), at_point(point, rests))) < FOLLOWED_RATIO:
            return rests
        moving = in_motion(point, problem)
        left = normalised_rmse(run_filter(point.model(), at_point(point, moving)))
        if THRESHOLDS.noise_left < left <= MISFIT_RATIO and unknowns:
            there = fit(point, unknowns, moving, iterations=STEPS)
            moving, left = in_motion(there.point, problem), normalised_rmse(there.run)
    except (SimulationError, np.linalg.LinAlgError) as error:
        LOGGER.info("not moving: %s", error)
        return rests
    far = max(map(_distance, starts_of(moving)))
    LOGGER.info("begun in motion, %.3g sigma from rest: %.3g times the noise is left", far, left)
    return moving if left <= THRESHOLDS.noise_left and far > THRESHOLDS.far_start else rests


def likelier_start(nominal: MapFit, last: MapFit, *, left: bool) -> Problem | None:
    """Return the problem of a diagnosis with hidden joints that move as recordings begin, where that explains
    them better than what was found from rest: without any cause the likelihood of a ``nominal`` model is
    larger than that of the ``last``, with causes, or, where something is ``left``, with the causes it is
    clearly larger; ``None`` elsewhere.

    It is the mean over starts about rest, each coordinate's variance being about the likeliest
    (`_about_rest`).
    """
    problem = last.problem
    if any(starts_of(problem)) or not len(moving_joints(nominal.point.model())):
        return None
    begun = replace(problem, noise=nominal.problem.noise)
    try:
        cost = _with_causes(last.objective, nominal, last)
        there = _fitted_about_rest(nominal, begun, at_most=cost)
        LOGGER.info("begun about rest: %.7g, from rest with causes %.7g", there.objective, cost)
        if there.objective < cost:
            return in_motion(there.point, begun)
        if left and last is not nominal:
            there = _fitted_about_rest(last, problem, at_most=last.objective - CLEAR_GAIN)
            LOGGER.info("with causes about rest: %.7g, from rest %.7g", there.objective, last.objective)
            if there.objective < last.objective - CLEAR_GAIN:
                return in_motion(there.point, problem)
        return None
    except (SimulationError, np.linalg.LinAlgError) as error:
        LOGGER.info("not moving: %s", error)
        return None


def start_beside_causes(last: MapFit) -> Problem | None:
    """Return the problem of a diagnosis begun where its ``last`` fit, with causes, puts hidden joints, where
    it begins in motion and is clearly likelier so; ``None`` elsewhere.

    Before there were causes, what these do bent where they were put: a tank by 0.2 m, beside a gyro's bias.
    """
    if not any(starts_of(last.problem)):
        return None
    found = last
    try:
        for _ in range(LOOKS):  # the fit is bent by where it was begun, and this by the fit
            begun = in_motion(found.point, found.problem)
            there = fit(found.point, found.unknowns, begun, iterations=2 * STEPS)
            LOGGER.info("begun where causes put it: %.7g, was %.7g", there.objective, found.objective)
            if there.objective > found.objective - CLEAR_GAIN:
                break
            found = there
    except (SimulationError, np.linalg.LinAlgError) as error:
        LOGGER.info("not begun elsewhere: %s", error)
    return None if found is last else found.problem


Fits = tuple[MapFit, MapFit]
"""The nominal and the last fit of a search."""


def rest_is_likelier(rests: Fits, moves: Fits) -> bool:
    """Whether what a search found from rest explains a recording about as well as what one found from a start
    in motion, the likelihood of that being as in `likelier_start`.
    """
    try:
        there = _fitted_about_rest(moves[1], moves[1].problem).objective
    except (SimulationError, np.linalg.LinAlgError) as error:
        LOGGER.info("not about rest: %s", error)
        return False
    costs = _with_causes(rests[1].objective, *rests), _with_causes(there, *moves)
    LOGGER.info("from rest %.7g, begun about rest %.7g", *costs)
    return costs[0] < costs[1] + CLEAR_GAIN


def _fitted_about_rest(found: MapFit, problem: Problem, at_most: float = np.inf) -> MapFit:
    """Return a fit of the same parameters to a problem that begins about rest; given up where it does not
    come to the objective ``at_most``.
    """
    for _ in range(LOOKS):
        begun = _about_rest(found.point, problem)
        found = fit(found.point, found.unknowns, begun, iterations=STEPS, at_most=at_most)
        if found.objective > at_most:
            break
    return found


def _with_causes(objective: float, nominal: MapFit, last: MapFit) -> float:
    """Return an objective without what causes have more of it at their most likely values than in the mean.

    Source: Schwarz, Ann. Statist. 6 (1978) 461: half the logarithm of the number of samples a parameter.
    """
    more = len(last.unknowns) - len(nominal.unknowns)
    return objective + 0.5 * more * math.log(len(last.problem.data.times))


def start_like(point: Point, problem: Problem, like: Problem) -> Problem:
    """Return a problem of a held-out recording that begins as is likeliest under a point: at rest, in motion
    where that explains it (`with_likely_start`), or, after others that begin in motion (``like``), about
    rest.
    """
    begun = with_likely_start(point, problem)
    if begun.moves or like.noise.hidden == ProcessNoise().hidden or not len(moving_joints(point.model())):
        return begun
    try:
        about = _about_rest(point, problem)
        rests, moves = (run_filter(point.model(), at_point(point, p)).log_likelihood for p in (begun, about))
        return in_motion(point, problem) if moves > rests + CLEAR_GAIN else begun
    except (SimulationError, np.linalg.LinAlgError) as error:
        LOGGER.info("not begun about rest: %s", error)
        return begun


def _about_rest(point: Point, problem: Problem) -> Problem:
    """Return a problem whose hidden joints begin at rest, each coordinate and rate with a standard deviation
    of what all readings have it at, but for those that begin closer to rest than that is known.

    Source: the relevance of MacKay, Neural Comput. 4 (1992) 415, section 5: variances of single parameters.
    """
    rest, parts, model = ProcessNoise().hidden, [], point.model()
    for moves in starts_of(in_motion(point, problem)):
        own = []
        for m in moves:
            if not model.pin.existJointName(m.joint):
                continue
            joint = model.pin.joints[model.pin.getJointId(m.joint)]
            if joint.nq != joint.nv:  # it turns without limits, and begins as any hidden joint at rest
                continue
            home = model.home[joint.idx_q : joint.idx_q + joint.nq]
            away = np.abs(m.at - home), np.abs(m.rate)
            sigmas = np.concatenate([np.maximum(x, s) for x, s in zip(away, rest, strict=True)])
            nothing = (0.0,) * joint.nv
            own.append(MovingStart(m.joint, tuple(home.tolist()), nothing, tuple(sigmas.tolist())))
        parts.append(tuple(own))
    return begun_so(problem, rest, parts)


def _distance(moves: Sequence[MovingStart]) -> float:
    """Return how far from rest hidden joints begin at most, in standard deviations of `InitialPrior`."""
    place, rate = InitialPrior().hidden
    return max((max(*np.abs(m.at) / place, *np.abs(m.rate) / rate) for m in moves), default=0.0)
