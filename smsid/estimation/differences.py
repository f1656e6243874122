"""Slope and curvature of the log-posterior by differences of whole filter runs.

Derivatives along the states that a filter found (`smsid.estimation.sensitivities`) leave out what a parameter
does to the filter's gain and covariance. That is little where the filter knows the states well by what it has
seen, and much where it does not: where innovations are large, and for springs and dampers of hidden states
that begin anyhow in a short flight, of which they then claim too much. Differences are exact and cost one run
of the filter a parameter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from smsid.estimation.filter_run import FilterRun, log_likelihoods
from smsid.estimation.flight import Flight
from smsid.estimation.kalman import KalmanFilter
from smsid.estimation.loosening import thinned
from smsid.estimation.normal_equations import (
    BLOCKS,
    CHUNK,
    NormalEquations,
    Term,
    normal_equations,
    prior_offset,
    problem_at,
)
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.estimation.retraction import retract

STEP = 1e-3  # of a difference, in conditional standard deviations of the parameter
ALIKE = 0.3  # of its curvature's root, and of a standard deviation, by which a derivative may differ


def difference_equations(found: NormalEquations, flights: Sequence[Flight]) -> NormalEquations:
    """Return the normal equations at the same point, slope and Gram matrix by differences.

    Raises `SimulationError` where a filter loses its recording.
    """
    ends = _ends(found, range(len(found.unknowns)))
    terms = tuple(_term(found.point, f, ends, t) for f, t in zip(flights, found.terms, strict=True))
    rate = np.array([u.scale / u.sigma for u in found.unknowns])
    gram = np.sum([t.gram for t in terms], axis=0) + np.diag(rate**2)
    slope = np.sum([t.slope for t in terms], axis=0) - rate * prior_offset(found.point, found.unknowns)
    return replace(found, terms=terms, gram=gram, slope=slope, exact=True)


def derivatives_hold(found: NormalEquations, flights: Sequence[Flight]) -> bool:
    """Whether slope and curvature by parameters of effects and sensors are, about, those by differences.

    All samples are asked about parameters of which fewer do not say so. Raises `SimulationError` where a
    filter loses its recording.
    """
    which = np.array([i for i, u in enumerate(found.unknowns) if u.kind in ("effect", "sensor")], dtype=int)
    fewer = [thinned(f) for f in flights]
    counts = [sum(len(f.problem.data.times) for f in x) for x in (flights, fewer)]
    if len(which) and counts[1] < counts[0]:
        here = normal_equations(found.point, found.unknowns, fewer)
        which = which[_apart(here, fewer, which, np.sqrt(counts[0] / counts[1])) >= ALIKE]
    return not len(which) or bool(_apart(found, flights, which, 1.0).max() < ALIKE)


def _apart(found: NormalEquations, flights: Sequence[Flight], which: np.ndarray, more: float) -> np.ndarray:
    """Return by how much roots of curvatures, in theirs, and slopes by ``which`` (k,) differ at most (k,).

    Slopes in standard deviations, ``more`` times as large as of these samples.
    """
    ends = _ends(found, which)
    exact = [_term(found.point, f, ends, t) for f, t in zip(flights, found.terms, strict=True)]
    before, now = (np.sum([np.diag(t.gram)[which] for t in x], axis=0) for x in (found.terms, exact))
    tilt, tilt_now = (np.sum([t.slope[which] for t in x], axis=0) for x in (found.terms, exact))
    size = np.sqrt(np.diag(found.gram)[which])
    return np.maximum(np.abs(np.sqrt(before) - np.sqrt(now)), more * np.abs(tilt - tilt_now)) / size


Ends = list[tuple[int, Point, float]]
"""Unknown, the point a step away in it, and the step in its scales: infinite where it has no room."""


def _ends(found: NormalEquations, which: Sequence[int] | np.ndarray) -> Ends:
    size = np.sqrt(np.diag(found.gram))
    return [
        (int(i), *_end(found.point, found.unknowns, i, STEP / (size[i] if size[i] > 0.0 else 1.0)))
        for i in which
    ]


def _end(point: Point, unknowns: Sequence[Unknown], i: int, step: float) -> tuple[Point, float]:
    """Return the point a step (in scales) up in an unknown, or down at its upper bound, and the step."""
    unknown = unknowns[i]
    for sign in (1.0, -1.0):
        moved = np.zeros(len(unknowns))
        moved[i] = sign * step * unknown.scale
        end = retract(point, unknowns, moved)
        width = (end.value(unknown) - point.value(unknown)) / unknown.scale
        if abs(width) > 0.5 * step:
            return end, width
    return point, np.inf  # between its bounds it cannot move: no slope


def _term(point: Point, flight: Flight, ends: Ends, before: Term) -> Term:
    """Return a recording's part of the normal equations; what has no end is zero."""
    m = len(before.slope)
    gram, blocks = np.zeros((m, m)), np.zeros((BLOCKS, m))
    middle, filters = _filter(point, flight), [_filter(p, flight) for _, p, _ in ends]
    count, which = len(flight.problem.data.times), [i for i, *_ in ends]
    for first in range(0, count, CHUNK):
        here = middle.advance(CHUNK)
        likely, root = _likelihoods(here), _root(here)
        columns, scores = [], np.empty((len(likely), len(ends)))
        for k, (kalman, (*_, width)) in enumerate(zip(filters, ends, strict=True)):
            there = kalman.advance(CHUNK)
            columns.append(_column(here, there, width, root))
            scores[:, k] = (_likelihoods(there) - likely) / width
        flat = np.array(columns)
        gram[np.ix_(which, which)] += flat @ flat.T
        places = np.arange(first, first + len(likely)) * BLOCKS // count
        own = np.zeros((BLOCKS, len(ends)))
        np.add.at(own, places, scores)
        blocks[:, which] += own
    return replace(before, gram=gram, slope=blocks.sum(axis=0), scatter=blocks.T @ blocks)


def _column(here: FilterRun, there: FilterRun, width: float, root: np.ndarray) -> np.ndarray:
    """Return what a change of a parameter does to the errors and to their predicted covariance S, whitened.

    Products of such columns are the information ``e_i' S^-1 e_j + tr(S^-1 S_i S^-1 S_j) / 2``, with e_i and
    S_i the derivatives (Kay, *Estimation Theory*, section 3.9). ``root`` is `_root`. Rows that are given are
    what the others are expected by: how the change weighs them is part of e_i, as they were read. As large
    as S has them, which is what an unknown input may do, they are not.
    """
    own = ~here.given
    errors = np.where(here.used, there.errors - here.errors, 0.0)
    ratio = np.where(here.used[:, :, None], np.matmul(there.whitening, root), 0.0)
    ratio -= np.einsum("ni,ij->nij", here.used, np.eye(here.used.shape[1]))
    moved = np.einsum("nij,nj->ni", here.whitening, errors)
    moved += np.einsum("nij,nj->ni", ratio[:, :, here.given], here.innovations[:, here.given])
    ratio = ratio[:, own][:, :, own]
    spread = (ratio + ratio.transpose(0, 2, 1)) * np.sqrt(0.5)
    return np.concatenate([moved[:, own].ravel(), spread.ravel()]) / width


def _root(run: FilterRun) -> np.ndarray:
    """Return the inverse of the whitening (N, rows, rows), one where nothing is used."""
    return np.linalg.inv(run.whitening + np.einsum("ni,ij->nij", ~run.used, np.eye(run.used.shape[1])))


def _likelihoods(run: FilterRun) -> np.ndarray:
    return log_likelihoods(run.innovations, run.whitening, run.given)


def _filter(point: Point, flight: Flight) -> KalmanFilter:
    return KalmanFilter(point.for_recording(flight.label).model(), problem_at(point, flight))
