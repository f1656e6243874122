"""Recordings with gaps that unknown forces do not last over: each piece begins its motion anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from smsid.estimation._sensor_uncertainty import reading_uncertainty
from smsid.estimation.flight import Flight
from smsid.estimation.initial_state import initial_belief
from smsid.estimation.parameter_vector import Point
from smsid.estimation.problem import Problem

GAP_INTERVALS = 3.0  # intervals between samples that are no gap
FEWEST_SAMPLES = 5  # samples of a piece that is used


def bridge_length(problem: Problem) -> float:
    """Return over how long a gap [s] unknown forces go on as they were: until their rate would undo them.

    The root mean square of a force over that of its rate, from how far it may wander between samples. What
    it does beyond is not linear in what moves it, and parameters would be learnt from a guess.
    """
    data = problem.data
    read = [data.times[np.isfinite(data.values[:, b.rows]).any(axis=1)] for b in data.blocks]
    interval = min((float(np.median(np.diff(t))) for t in read if len(t) > 1), default=np.inf)
    moving = [u for u in problem.unknown_inputs if u.walk > 0.0]
    lasting = [u.sigma / (u.slope or u.walk / np.sqrt(interval)) for u in moving]
    return max(GAP_INTERVALS * interval, min(lasting, default=np.inf))


def pieces_of(point: Point, flight: Flight) -> list[Flight]:
    """Return a flight as the pieces between its gaps, which share its label and so its sensors' biases.

    Pieces of fewer than `FEWEST_SAMPLES` samples are left out, which the first piece's notes say.
    """
    problem = flight.problem
    data = problem.data
    read = np.flatnonzero(np.isfinite(data.values).any(axis=1))
    long = np.flatnonzero(np.diff(data.times[read]) > bridge_length(problem))
    if not len(long):
        return [flight]
    begins, ends = np.append(read[0], read[long + 1]), np.append(read[long], read[-1])
    counts = np.diff(np.concatenate([[0], long + 1, [len(read)]]))
    out = []
    for first, last, count in zip(begins, ends, counts, strict=True):
        if count < FEWEST_SAMPLES:
            continue
        here = slice(int(first), int(last) + 1)
        attitude = {name: q[here] for name, q in data.attitude.items()}
        own = replace(data, times=data.times[here], values=data.values[here], attitude=attitude)
        begin = problem.begin
        passed = float(data.times[first] - data.times[0])
        walks = tuple(w.after(passed) for w in problem.bias_walks)
        if first > read[0]:
            begin = initial_belief(flight.model, own, problem.locked, None, reading_uncertainty(point, own))
        out.append(
            replace(flight, problem=replace(problem, data=own, begin=begin, bias_walks=walks), notes=())
        )
    if not out:
        return [flight]
    said = f"in pieces between {len(long)} gaps, over which what moves joints and wheels is not known"
    short = int(np.sum(counts[counts < FEWEST_SAMPLES]))
    said += f"; {short} samples between gaps are too few for a piece and left out" if short else ""
    return [replace(out[0], notes=(*flight.notes, said)), *out[1:]]
