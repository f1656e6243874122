"""Whether slosh and panels rest or move as a recording begins: no sensor says so, its likelihood does.

A window of a flight may begin with a tank that is a metre off its place. A prior of some decimetres about
rest would bend masses and springs until less of that is needed, and a filter that begins so far off does not
know by how much its derivatives mislead it.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from smsid.errors import SimulationError
from smsid.estimation.filter_run import FilterRun
from smsid.estimation.flight import Flight
from smsid.estimation.initial_state import InitialPrior
from smsid.estimation.innovations import normalised_rmse
from smsid.estimation.input_timing import CLEAR_GAIN, FOLLOWED_RATIO, MISFIT_RATIO, NOISE_RATIO
from smsid.estimation.joint_problem import at_point
from smsid.estimation.kalman import KalmanFilter, hidden_coordinates, run_filter
from smsid.estimation.loosening import loosen_model, thin_flight
from smsid.estimation.map_estimate import MapFit, fit
from smsid.estimation.normal_equations import problem_at
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.estimation.problem import Belief, MovingStart, Problem, ProcessNoise, recordings_of
from smsid.model.spacecraft import SpacecraftModel

LOGGER = logging.getLogger(__name__)
STEPS = 3  # of a fit
LOOKS = 2  # at how it begins, each from where the one before has it
FAR = 3.0  # standard deviations of what is known of the start, beyond which that is wrong
FAR_AND_LACKING = 4.0  # the same where a cause may be lacking, which is taken for a start: a judgement
STATED = 1e-4  # standard deviation below which somebody has said that a coordinate rests
FIRST_SAMPLES = 2000  # of a flight, which tell how it begins: of a thinned one, if that is enough


def with_likely_start(point: Point, problem: Problem, unknowns: Sequence[Unknown] = ()) -> Problem:
    """Return a problem of a diagnosis whose hidden joints begin at rest, or in motion where that explains it.

    In motion they begin about where all readings put them, with the standard deviations of `InitialPrior`. A
    recording that begins at rest tells more if that is known, and a start in motion takes the place of much
    that a model lacks: it is believed only where it is far from rest, and where the model does not follow
    from rest and leaves noise from there, some steps of a fit of ``unknowns`` on.
    """
    rests = _begun(problem, ProcessNoise().hidden, [()] * max(1, len(problem.parts)))
    if not len(_moving_joints(point.model())):
        return rests
    try:
        if normalised_rmse(run_filter(point.model(), at_point(point, rests))) < FOLLOWED_RATIO:
            return rests
        moving = _in_motion(point, problem)
        left = normalised_rmse(run_filter(point.model(), at_point(point, moving)))
        if NOISE_RATIO < left <= MISFIT_RATIO and unknowns:
            there = fit(point, unknowns, moving, iterations=STEPS)
            moving, left = _in_motion(there.point, problem), normalised_rmse(there.run)
    except (SimulationError, np.linalg.LinAlgError) as error:
        LOGGER.info("not moving: %s", error)
        return rests
    far = max(map(_distance, _starts(moving)))
    LOGGER.info("begun in motion, %.3g sigma from rest: %.3g times the noise is left", far, left)
    return moving if left <= NOISE_RATIO and far > FAR_AND_LACKING else rests


def likelier_start(nominal: MapFit, last: MapFit) -> Problem | None:
    """Return the problem of a diagnosis with hidden joints that move as recordings begin, where that explains
    them better than what was found from rest: without any cause the likelihood of a ``nominal`` model is
    larger than that of the ``last``, with causes; ``None`` elsewhere.

    It is the mean over starts about rest, each coordinate's variance being about the likeliest
    (`_about_rest`). What causes have more of it at their most likely values than in the mean is taken off
    after Schwarz (Ann. Statist. 6 (1978) 461): half the logarithm of the number of samples a parameter.
    """
    problem = last.problem
    if problem.moves or any(p.moves for p in problem.parts) or not len(_moving_joints(nominal.point.model())):
        return None
    more = len(last.unknowns) - len(nominal.unknowns)
    cost = last.objective + 0.5 * more * math.log(len(problem.data.times))
    begun, point = replace(problem, noise=nominal.problem.noise), nominal.point
    try:
        for _ in range(LOOKS):
            there = fit(point, nominal.unknowns, _about_rest(point, begun), iterations=STEPS)
            point = there.point
            LOGGER.info("begun about rest: %.7g, from rest with causes %.7g", there.objective, cost)
        return _in_motion(point, begun) if there.objective < cost else None
    except (SimulationError, np.linalg.LinAlgError) as error:
        LOGGER.info("not moving: %s", error)
        return None


def start_like(point: Point, problem: Problem, like: Problem) -> Problem:
    """Return a problem of a held-out recording that begins as is likeliest under a point: at rest, in motion
    where that explains it (`with_likely_start`), or, after others that begin in motion (``like``), about
    rest.
    """
    begun = with_likely_start(point, problem)
    if begun.moves or like.noise.hidden == ProcessNoise().hidden or not len(_moving_joints(point.model())):
        return begun
    try:
        about = _about_rest(point, problem)
        rests, moves = (run_filter(point.model(), at_point(point, p)).log_likelihood for p in (begun, about))
        return _in_motion(point, problem) if moves > rests + CLEAR_GAIN else begun
    except (SimulationError, np.linalg.LinAlgError) as error:
        LOGGER.info("not begun about rest: %s", error)
        return begun


def _about_rest(point: Point, problem: Problem) -> Problem:
    """Return a problem whose hidden joints begin at rest, each coordinate and rate with a standard deviation
    of what all readings have it at, but for those that begin closer to rest than that is known.

    Source: the relevance of MacKay, Neural Comput. 4 (1992) 415, section 5: variances of single parameters.
    """
    rest, parts = ProcessNoise().hidden, []
    for moves in _starts(_in_motion(point, problem)):
        own = []
        for m in moves:
            sigmas = [max(abs(x), s) for values, s in zip((m.at, m.rate), rest, strict=True) for x in values]
            own.append(MovingStart(m.joint, (0.0,) * len(m.at), (0.0,) * len(m.rate), tuple(sigmas)))
        parts.append(tuple(own))
    return _begun(problem, rest, parts)


def _starts(problem: Problem) -> list[tuple[MovingStart, ...]]:
    return [p.moves for p in problem.parts] or [problem.moves]


def _distance(moves: Sequence[MovingStart]) -> float:
    """Return how far from rest hidden joints begin at most, in standard deviations of `InitialPrior`."""
    place, rate = InitialPrior().hidden
    return max((max(*np.abs(m.at) / place, *np.abs(m.rate) / rate) for m in moves), default=0.0)


def with_moving_start(point: Point, flight: Flight, share: float) -> Flight:
    """Return a flight of an identification that begins about where its first samples put slosh and panels,
    where that is far from what is known of it and likelier; itself elsewhere. The model errs by a ``share``
    of what drives it.
    """
    begin, nv = flight.problem.begin, flight.model.nv
    if begin is None:
        return flight
    place, rate = np.sqrt(begin.covariance.diagonal()).reshape(2, nv)
    hidden = np.setdiff1d(_moving_joints(flight.model), flight.problem.locked)
    hidden = hidden[(place[hidden] >= STATED) & (rate[hidden] >= STATED)]
    if not len(hidden):
        return flight
    loose = loosen_model(flight.model, flight.problem, share) if share else flight.problem
    some = thin_flight(replace(flight, problem=loose))
    some = replace(some, problem=replace(some.problem, data=some.problem.data.first(FIRST_SAMPLES)))
    model, away, likely = point.for_recording(flight.label).model(), np.zeros((2, nv)), []
    try:
        for look in range(LOOKS + 1):
            here = replace(some, problem=replace(some.problem, begin=_displaced(model, begin, away)))
            run = run_filter(model, problem := problem_at(point, here))
            likely.append(run.log_likelihood)
            if look == LOOKS:
                break
            start = smoothed_start(model, problem, run)
            away[0, hidden] = pin.difference(model.pin, begin.q, start.q)[hidden]
            away[1, hidden] = (start.v - begin.v)[hidden]
            if np.abs(away[:, hidden] / (place[hidden], rate[hidden])).max() < FAR and not look:
                return flight
    except SimulationError as error:
        LOGGER.info("not begun elsewhere: %s", error)
        return flight
    if likely[-1] < likely[0] + CLEAR_GAIN:
        return flight
    note = "slosh and panels move as it begins, further than was taken for known: it is begun where they are"
    problem = replace(flight.problem, begin=_displaced(model, begin, away))
    return replace(flight, problem=problem, notes=(*flight.notes, note))


def _displaced(model: SpacecraftModel, begin: Belief, away: np.ndarray) -> Belief:
    """Return a belief moved by changes (2, nv) of q and of v."""
    return replace(begin, q=pin.integrate(model.pin, begin.q, away[0]), v=begin.v + away[1])


def _moving_joints(model: SpacecraftModel) -> np.ndarray:
    """Return the hidden coordinates (k,) that may move as a recording begins: no meters of what was used."""
    meters = [n for e in model.description.effect for n in e.lasting_joints()]
    own = (model.pin.joints[model.pin.getJointId(n)].idx_v for n in meters if model.pin.existJointName(n))
    return np.setdiff1d(hidden_coordinates(model), list(own))


def with_start_of(problem: Problem, other: Problem) -> Problem:
    """Return a problem whose recordings begin as in another of the same."""
    return _begun(problem, other.noise.hidden, _starts(other))


def _in_motion(point: Point, problem: Problem) -> Problem:
    wide = InitialPrior().hidden
    out = _begun(problem, wide, [()] * max(1, len(problem.parts)))
    for _ in range(LOOKS):
        read = at_point(point, out)
        models = [p.model or point.model() for p in read.parts] or [point.model()]
        each = zip(models, recordings_of(read), strict=True)
        out = _begun(problem, wide, [_moves_of(m, smoothed_start(m, p, run_filter(m, p))) for m, p in each])
    return out


def _begun(problem: Problem, hidden: tuple[float, float], moves: list[tuple[MovingStart, ...]]) -> Problem:
    """Return a problem whose recordings begin so."""
    parts = tuple(replace(p, moves=m) for p, m in zip(problem.parts, moves, strict=False))
    return replace(problem, noise=replace(problem.noise, hidden=hidden), moves=moves[0], parts=parts)


def _moves_of(model: SpacecraftModel, start: Belief) -> tuple[MovingStart, ...]:
    hidden, out = {*_moving_joints(model).tolist()}, []
    for name, j in zip(model.pin.names, model.pin.joints, strict=True):
        if j.idx_v in hidden:
            at, rate = start.q[j.idx_q : j.idx_q + j.nq], start.v[j.idx_v : j.idx_v + j.nv]
            out.append(MovingStart(name, tuple(at.tolist()), tuple(rate.tolist())))
    return tuple(out)


def smoothed_start(model: SpacecraftModel, problem: Problem, closed: FilterRun) -> Belief:
    """Return the state at the first sample given all of them, by Bryson and Frazier's costate."""
    slope: np.ndarray = np.zeros(closed.gain.shape[1])
    for k in range(len(closed.innovations) - 1, -1, -1):
        if k < len(closed.transition):
            slope = closed.transition[k].T @ slope
        told = closed.gain[k].T @ slope + closed.whitening[k].T @ closed.innovations[k]
        slope = slope - closed.sensitivity[k].T @ told
    start = KalmanFilter(model, problem)
    step = -(start.covariance @ slope)
    q, v = closed.states.q[0], closed.states.v[0] + step[model.nv : 2 * model.nv]
    return Belief(pin.integrate(model.pin, q, step[: model.nv]), v, start.covariance)
