"""Slope and curvature of the log-posterior by differences of whole filter runs.

Derivatives along the states that a filter found (`smsid.estimation.sensitivities`) leave out what a parameter
does to the filter's gain: nothing where the model is right, much where innovations are large. A search that
comes to a halt there goes on with these, which are exact and cost two runs of the filter a parameter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from smsid.estimation.flight import Flight
from smsid.estimation.kalman import KalmanFilter
from smsid.estimation.normal_equations import CHUNK, NormalEquations, prior_offset, problem_at
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.estimation.retraction import retract

STEP = 1e-3  # of a difference, in conditional standard deviations of the parameter


def differenced(found: NormalEquations, flights: Sequence[Flight]) -> NormalEquations:
    """Return the normal equations at the same point, slope and Gram matrix by central differences.

    Raises `SimulationError` where a filter loses its recording.
    """
    unknowns, m = found.unknowns, len(found.unknowns)
    size = np.sqrt(np.diag(found.gram))
    steps = STEP / np.where(size > 0.0, size, 1.0)  # (m,) in scales
    slope, gram = np.zeros(m), np.zeros((m, m))
    ends = [_ends(found.point, unknowns, i, float(steps[i])) for i in range(m)]
    for flight in flights:
        filters = [tuple(_filter(p, flight) for p in (low, high)) for low, high, _ in ends]
        middle = _filter(found.point, flight)
        for _ in range(0, len(flight.problem.data.times), CHUNK):
            here = middle.advance(CHUNK).innovations
            columns = np.empty((here.size, m))
            for i, ((low, high), (*_, width)) in enumerate(zip(filters, ends, strict=True)):
                less, more = low.advance(CHUNK), high.advance(CHUNK)
                slope[i] += (more.log_likelihood - less.log_likelihood) / width
                columns[:, i] = ((less.innovations - more.innovations) / width).ravel()
            gram += columns.T @ columns
    rate = np.array([u.scale / u.sigma for u in unknowns])
    return replace(
        found, gram=gram + np.diag(rate**2), slope=slope - rate * prior_offset(found.point, unknowns)
    )


def _ends(point: Point, unknowns: Sequence[Unknown], i: int, step: float) -> tuple[Point, Point, float]:
    """Return the points below and above, within bounds, and how far they are apart in scales."""
    unknown = unknowns[i]
    found = []
    for sign in (-1.0, 1.0):
        moved = np.zeros(len(unknowns))
        moved[i] = sign * step * unknown.scale
        found.append(retract(point, unknowns, moved))
    width = (found[1].value(unknown) - found[0].value(unknown)) / unknown.scale
    return found[0], found[1], width if width > 0.0 else np.inf  # between its bounds it cannot move: no slope


def _filter(point: Point, flight: Flight) -> KalmanFilter:
    return KalmanFilter(point.for_recording(flight.label).model(), problem_at(point, flight))
