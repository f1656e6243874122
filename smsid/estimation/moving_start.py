"""Whether slosh and panels rest or move as a recording begins: no sensor says so, its likelihood does.

A window of a flight may begin with a tank that is a metre off its place. A prior of some decimetres about
rest would bend masses and springs until less of that is needed, and a filter that begins so far off does not
know by how much its derivatives mislead it.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import pinocchio as pin

from smsid.errors import SimulationError
from smsid.estimation._normal_equations import problem_at
from smsid.estimation.filter_run import FilterRun
from smsid.estimation.flight import Flight
from smsid.estimation.initial_state import InitialPrior
from smsid.estimation.input_timing import CLEAR_GAIN
from smsid.estimation.joint_problem import at_point
from smsid.estimation.kalman import KalmanFilter, hidden_coordinates, run_filter
from smsid.estimation.loosening import loosen_model, thin_flight
from smsid.estimation.parameter_vector import Point
from smsid.estimation.problem import Belief, MovingStart, Problem, recordings_of
from smsid.model.spacecraft import SpacecraftModel

LOGGER = logging.getLogger(__name__)
LOOKS = 2  # at how it begins, each from where the one before has it
FAR = 3.0  # standard deviations of what is known of the start, beyond which that is wrong
STATED = 1e-4  # standard deviation below which somebody has said that a coordinate rests
FIRST_SAMPLES = 2000  # of a flight, which tell how it begins: of a thinned one, if that is enough


def starts_of(problem: Problem) -> list[tuple[MovingStart, ...]]:
    """Return where hidden joints begin in every recording."""
    return [p.moves for p in problem.parts] or [problem.moves]


def with_moving_start(point: Point, flight: Flight, share: float) -> Flight:
    """Return a flight of an identification that begins about where its first samples put slosh and panels,
    where that is far from what is known of it and likelier; itself elsewhere. The model errs by a ``share``
    of what drives it.
    """
    begin, nv = flight.problem.begin, flight.model.nv
    if begin is None:
        return flight
    place, rate = np.sqrt(begin.covariance.diagonal()).reshape(2, nv)
    hidden = np.setdiff1d(moving_joints(flight.model), flight.problem.locked)
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


def moving_joints(model: SpacecraftModel) -> np.ndarray:
    """Return the hidden coordinates (k,) that may move as a recording begins: no meters of what was used."""
    meters = [n for e in model.description.effect for n in e.lasting_joints()]
    own = (model.pin.joints[model.pin.getJointId(n)].idx_v for n in meters if model.pin.existJointName(n))
    return np.setdiff1d(hidden_coordinates(model), list(own))


def with_start_of(problem: Problem, other: Problem) -> Problem:
    """Return a problem whose recordings begin as in another of the same."""
    return begun_so(problem, other.noise.hidden, starts_of(other))


def in_motion(point: Point, problem: Problem) -> Problem:
    """Return a problem whose hidden joints begin about where all readings put them, as `InitialPrior` has it.

    Raises `SimulationError` where a filter loses the recording.
    """
    wide = InitialPrior().hidden
    out = begun_so(problem, wide, [()] * max(1, len(problem.parts)))
    for _ in range(LOOKS):
        read = at_point(point, out)
        models = [p.model or point.model() for p in read.parts] or [point.model()]
        each = zip(models, recordings_of(read), strict=True)
        out = begun_so(problem, wide, [_moves_of(m, smoothed_start(m, p, run_filter(m, p))) for m, p in each])
    return out


def begun_so(problem: Problem, hidden: tuple[float, float], moves: list[tuple[MovingStart, ...]]) -> Problem:
    """Return a problem whose recordings begin so."""
    parts = tuple(replace(p, moves=m) for p, m in zip(problem.parts, moves, strict=False))
    return replace(problem, noise=replace(problem.noise, hidden=hidden), moves=moves[0], parts=parts)


def _moves_of(model: SpacecraftModel, start: Belief) -> tuple[MovingStart, ...]:
    hidden, out = {*moving_joints(model).tolist()}, []
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
