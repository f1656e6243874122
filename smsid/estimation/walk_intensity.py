"""How fast unknown forces wander: the most likely intensity of each walk, at given parameters.

Wider than it is, a walk says that what follows it moves too little: scales of wheel rates and dampings give
way to that. The slope of the log-likelihood by the logarithm of a variance is ``1/2 sum (s' S s - tr S C)``
over the intervals, with S the covariance that the walk adds in one, s and C the slope and the curvature of
the log-likelihood by it, from the backward pass of the smoother; ``1/2 sum tr (S C)^2`` stands for its
information. Source: Koopman, Biometrika 80 (1993) 117, disturbance smoother and its use in scores.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from smsid.errors import SimulationError
from smsid.estimation.filter_run import FilterRun
from smsid.estimation.flight import Flight
from smsid.estimation.input_hold import input_channels
from smsid.estimation.joint_problem import at_point
from smsid.estimation.kalman import KalmanFilter
from smsid.estimation.parameter_vector import Point

LOGGER = logging.getLogger(__name__)
CHUNK = 1000  # samples whose backward pass begins without what comes after
CHUNKS = 10  # of a recording that are looked at
STEPS = 5
SETTLED = 0.05  # relative change of all variances at which there is no further step
FACTORS = (0.05, 20.0)  # of a variance in a step
FEWEST = 20.0  # information of a logarithm, below which a walk stays as it is


def with_walks_as_seen(point: Point, flights: Sequence[Flight]) -> list[Flight]:
    """Return flights whose unknown inputs wander as fast as is most likely at a point."""
    return [_as_seen(point, f) if f.problem.unknown_inputs else f for f in flights]


def _as_seen(point: Point, flight: Flight) -> Flight:
    for _ in range(STEPS):
        try:
            slope, information = walk_slopes(point, _without_commands(flight))
        except SimulationError as error:
            LOGGER.info("walks stay as they are: %s", error)
            break
        told = information > FEWEST
        factors = np.where(told, np.clip(1.0 + slope / np.where(told, information, 1.0), *FACTORS), 1.0)
        inputs = flight.problem.unknown_inputs
        walks = [replace(u, walk=float(u.walk * np.sqrt(f))) for u, f in zip(inputs, factors, strict=True)]
        flight = replace(flight, problem=replace(flight.problem, unknown_inputs=tuple(walks)))
        LOGGER.info("walks of '%s' by %s", flight.label, np.sqrt(factors).round(3))
        if np.abs(factors - 1.0).max() < SETTLED:
            break
    return flight


def _without_commands(flight: Flight) -> Flight:
    """Return the flight without commands to motors whose motion is followed: what they do is all unknown.

    Else a walk would be as narrow as commands are right at the point, and what is wrong with them in the same
    way all the time, as a torque constant is, would enter.
    """
    problem, changed = flight.problem, {}
    motors = {u.dof for u in problem.unknown_inputs if u.motor}
    channels = input_channels(flight.model, problem.recording)
    for name, group in (("joint_torque", flight.model.arm_joints), ("wheel_torque", flight.model.wheels)):
        own = [i for i, v in enumerate(group.v.tolist()) if v in motors]
        if own:
            values = np.array(problem.recording[channels[name]], dtype=float)
            values.reshape(len(values), -1)[:, own] = 0.0
            changed[channels[name]] = values
    recording = problem.recording.with_channels(changed) if changed else problem.recording
    return replace(flight, problem=replace(problem, recording=recording))


def walk_slopes(point: Point, flight: Flight) -> tuple[np.ndarray, np.ndarray]:
    """Return slope and information (k,) of the log-likelihood by logarithms of the walks' variances.

    Of long recordings, chunks that are spread over them count, each by what it tells itself.
    """
    problem = at_point(point, flight.problem)
    filtering = KalmanFilter(point.model(), problem)
    chunks = -(-len(problem.data.times) // CHUNK)
    chosen = set(np.linspace(0, chunks - 1, min(chunks, CHUNKS)).round().astype(int).tolist())
    slope, information = np.zeros((2, len(problem.unknown_inputs)))
    for i in range(chunks):
        run = filtering.advance(CHUNK)
        if i in chosen:
            own = _of_chunk(run, filtering.walk)
            slope, information = slope + own[0], information + own[1]
    return slope, information


def _of_chunk(run: FilterRun, walk: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    count, width = walk.shape[1], run.gain.shape[1]
    inner = width - count
    end, common, mean = walk
    added = np.array([[mean, common], [common, end]]).transpose(2, 0, 1)  # (k, 2, 2) in a second
    found, told = np.zeros((2, count))
    slope, curvature = np.zeros(width), np.zeros((width, width))
    for k in range(len(run.gain) - 1, -1, -1):
        if k < len(run.transition):
            if k < len(run.gain) - 1:
                moved = run.transition[k][:inner, inner:]
                along = np.zeros((count, width, 2))
                along[:, :inner, 0] = moved.T
                along[np.arange(count), inner + np.arange(count), 1] = 1.0
                own = added * (run.edges[k + 1] - run.edges[k])
                s = slope @ along  # (k, 2)
                both = own @ (along.transpose(0, 2, 1) @ curvature @ along)
                found += 0.5 * (np.einsum("ka,kab,kb->k", s, own, s) - np.trace(both, axis1=1, axis2=2))
                told += 0.5 * np.einsum("kab,kba->k", both, both)
            slope = run.transition[k].T @ slope
            curvature = run.transition[k].T @ curvature @ run.transition[k]
        white = run.whitening[k] @ run.sensitivity[k]
        kept = np.eye(width) - run.gain[k] @ run.sensitivity[k]
        slope = kept.T @ slope - white.T @ run.innovations[k]
        curvature = kept.T @ curvature @ kept + white.T @ white
        curvature = 0.5 * (curvature + curvature.T)
    return found, told
