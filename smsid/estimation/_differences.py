"""Slope and curvature of the log-posterior by differences of whole filter runs.

Derivatives along the states that a filter found (`smsid.estimation.sensitivities`) leave out what a parameter
does to the filter's gain and covariance. That is little where the filter knows the states well by what it has
seen, and much where it does not: where innovations are large, and for springs and dampers of hidden states
that begin anyhow in a short flight, of which they then claim too much. Differences are exact and cost one run
of the filter a parameter, two where it is not told.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid.estimation._normal_equations import (
    SLOPE_PARTS,
    NormalEquations,
    normal_equations,
    prior_offset,
    problem_at,
)
from smsid.estimation._retraction import retract
from smsid.estimation._trust_region import REGULARISATION, room_within_bounds, sizes
from smsid.estimation.filter_run import FilterRun, log_determinants, log_likelihoods
from smsid.estimation.flight import Flight
from smsid.estimation.kalman import KalmanFilter
from smsid.estimation.loosening import thin_flight
from smsid.estimation.parameter_vector import Point
from smsid.estimation.problem import Problem

AXIS_STEP = 1e-3  # of a difference, in standard deviations along an axis
DERIVATIVE_TOLERANCE = 0.3  # of its curvature's root and of a sigma, by which a derivative may differ
TOLD_SHARE = 0.5  # share of what is known along an axis, above which it is the recordings that tell it
MOST_AXES = 3  # axes that are asked about
SAMPLES_AT_ONCE = 200  # samples of which all columns are in memory at once
AXES_AT_ONCE = 8  # axes that are asked about before the next are
BOUND_STEPS = 10.0  # steps from its bound within which a parameter is moved by itself


def difference_equations(found: NormalEquations, flights: Sequence[Flight]) -> NormalEquations:
    """Return the normal equations at the same point, slope and Gram matrix by differences.

    Differences are along the principal axes of ``found``: by single parameters, what little rounding leaves
    of each would be the slope along what is hardly told, where large slopes cancel.

    Raises `SimulationError` where a filter loses its recording.
    """
    axes = principal_axes(found)
    ends = _ends(found, axes.T)
    back = np.linalg.inv(axes)
    terms = []
    for flight, term in zip(flights, found.terms, strict=True):
        gram, blocks = _differences(found.point, flight, ends)
        blocks = blocks @ back
        terms.append(
            replace(term, gram=back.T @ gram @ back, slope=blocks.sum(axis=0), scatter=blocks.T @ blocks)
        )
    rate = np.array([u.scale / u.sigma for u in found.unknowns])
    gram = np.sum([t.gram for t in terms], axis=0) + np.diag(rate**2)
    slope = np.sum([t.slope for t in terms], axis=0) - rate * prior_offset(found.point, found.unknowns)
    return replace(found, terms=tuple(terms), gram=gram, slope=slope, exact=True)


def derivatives_hold(found: NormalEquations, flights: Sequence[Flight]) -> bool:
    """Whether slope and curvature are, about, those by differences: by parameters of effects and sensors, and
    along the axes of which the recordings tell least.

    All samples are asked about those of which fewer do not say so. Raises `SimulationError` where a filter
    loses its recording.
    """
    size = sizes(found)
    alone = [i for i, u in enumerate(found.unknowns) if u.kind in ("effect", "sensor")]
    axes = np.vstack([_least_told(found), np.diag(1.0 / size)[alone]])
    fewer = [thin_flight(f) for f in flights]
    counts = [sum(len(f.problem.data.times) for f in x) for x in (flights, fewer)]
    if len(axes) and counts[1] < counts[0]:
        here = normal_equations(found.point, found.unknowns, fewer)
        axes = axes[_apart(here, fewer, axes, np.sqrt(counts[0] / counts[1])) >= DERIVATIVE_TOLERANCE]
    some = (axes[k : k + AXES_AT_ONCE] for k in range(0, len(axes), AXES_AT_ONCE))
    return all(_apart(found, flights, x, 1.0).max() < DERIVATIVE_TOLERANCE for x in some)


def _apart(found: NormalEquations, flights: Sequence[Flight], axes: np.ndarray, more: float) -> np.ndarray:
    """Return by how much roots of curvatures and slopes along axes (k, m), in scales, differ at most (k,).

    Both in standard deviations along them, slopes ``more`` times as large as of these samples.
    """
    gram, slope = (
        np.sum([t.gram for t in found.terms], axis=0),
        np.sum([t.slope for t in found.terms], axis=0),
    )
    before, tilt = np.einsum("ki,ij,kj->k", axes, gram, axes), axes @ slope
    size = np.sqrt(np.einsum("ki,ij,kj->k", axes, found.gram, axes))
    exact = [_differences(found.point, f, _ends(found, axes)) for f in flights]
    now = np.sum([np.diag(gram) for gram, _ in exact], axis=0)
    tilt_now = np.sum([blocks.sum(axis=0) for _, blocks in exact], axis=0)
    return np.maximum(np.abs(np.sqrt(before) - np.sqrt(now)), more * np.abs(tilt - tilt_now)) / size


def _least_told(found: NormalEquations) -> np.ndarray:
    """Return the axes (k, m), in scales, that the recordings tell of, rather than priors, and tell least.

    There a slope that leaves a part out leads far: a standard deviation of them is large.
    """
    axes = principal_axes(found)
    told = np.einsum("ik,ij,jk->k", axes, found.information, axes) > TOLD_SHARE
    wide = np.linalg.norm(axes * sizes(found)[:, None], axis=0)
    order = np.argsort(-wide, kind="stable")
    return axes[:, order[told[order]][:MOST_AXES]].T


def principal_axes(found: NormalEquations) -> np.ndarray:
    """Return axes (m, m), one a column, along each of which one is a standard deviation, in scales.

    Those of the Gram matrix; a parameter at its bound, which may go one way only, is an axis by itself. Axes
    are at right angles in scales: what is told well moves little of what is not, whose bend would stand for a
    slope.
    """
    size = sizes(found)
    low, high = (np.abs(x) * size for x in room_within_bounds(found.point, found.unknowns))
    free = np.minimum(low, high) > BOUND_STEPS * AXIS_STEP
    axes = np.diag(1.0 / size)
    share, basis = np.linalg.eigh(found.gram[np.ix_(free, free)] / np.outer(size[free], size[free]))
    root = basis / np.sqrt(np.maximum(share, REGULARISATION)) / size[free, None]
    directions, lengths, _ = np.linalg.svd(root)
    axes[np.ix_(free, free)] = directions * lengths
    return axes


Ends = list[list[tuple[Point, float]]]
"""Of every axis, the points a step away and the signed steps: infinite where there is no room."""


def _ends(found: NormalEquations, axes: np.ndarray) -> Ends:
    """Return the points a step up along ``axes`` (k, m), in scales, or down at a bound.

    A standard deviation of what the recordings do not tell goes far, and what they tell may bend on the way:
    there a difference is one of both sides, if there is room.
    """
    low, high = room_within_bounds(found.point, found.unknowns)
    told = np.einsum("ki,ij,kj->k", axes, found.information, axes)
    told /= np.einsum("ki,ij,kj->k", axes, found.gram, axes)
    ends: Ends = []
    for axis, share in zip(axes, told, strict=True):
        steps = [s for s in (AXIS_STEP, -AXIS_STEP) if np.all((low <= s * axis) & (s * axis <= high))]
        own = steps if share < TOLD_SHARE else steps[:1]
        points = [(retract(found.point, found.unknowns, s * axis * found.scales), s) for s in own]
        ends.append(points or [(found.point, np.inf)])  # between its bounds it cannot move: no slope
    return ends


def _differences(point: Point, flight: Flight, ends: Ends) -> tuple[np.ndarray, np.ndarray]:
    """Return a recording's Gram matrix (k, k) along axes and slopes (`SLOPE_PARTS`, k)."""
    gram, blocks = np.zeros((len(ends), len(ends))), np.zeros((SLOPE_PARTS, len(ends)))
    problem = flight.problem
    middle, filters = _filter(point, flight), [[(_filter(p, flight), w) for p, w in own] for own in ends]
    count = len(flight.problem.data.times)
    for first in range(0, count, SAMPLES_AT_ONCE):
        base = Base.of(middle.advance(SAMPLES_AT_ONCE))
        likely, columns = _likelihoods(base.run, problem), []
        scores = np.empty((len(likely), len(ends)))
        for k, own in enumerate(filters):
            runs = [(kalman.advance(SAMPLES_AT_ONCE), width) for kalman, width in own]
            columns.append(np.mean([base.column(there, width, problem) for there, width in runs], axis=0))
            gained = [(_likelihoods(there, problem) - likely) / width for there, width in runs]
            scores[:, k] = np.mean(gained, axis=0)
        flat = np.array(columns)
        gram += flat @ flat.T
        np.add.at(blocks, np.arange(first, first + len(likely)) * SLOPE_PARTS // count, scores)
    aside = np.array([sum(w for _, w in own if np.isfinite(w)) / len(own) for own in ends])
    blocks += 0.5 * aside * np.diag(gram) / SLOPE_PARTS  # what a one-sided difference has of the curvature
    return gram, blocks


@dataclass(frozen=True)
class Base:
    """A run that others are held against, at the samples ``seen`` (N,) of which something is read.

    ``root`` (n, rows, rows) is the inverse of the whitening there, one where nothing is used.
    """

    run: FilterRun
    seen: np.ndarray
    root: np.ndarray

    @classmethod
    def of(cls, run: FilterRun) -> Base:
        """Return a run made ready for `column`."""
        seen = np.any(run.used, axis=1)
        unused = np.einsum("ni,ij->nij", ~run.used[seen], np.eye(run.used.shape[1]))
        return cls(run, seen, np.linalg.inv(run.whitening[seen] + unused))

    def column(self, there: FilterRun, width: float, problem: Problem) -> np.ndarray:
        """Return what a change of a parameter does to the errors and to their covariance S, whitened.

        Products of such columns are the information ``e_i' S^-1 e_j + tr(S^-1 S_i S^-1 S_j) / 2``, with e_i
        and S_i the derivatives (Kay, *Estimation Theory*, section 3.9). Rows that are given are what the
        others are expected by: how the change weighs them is part of e_i, as they were read. As large as S
        has them, which is what an unknown input may do, they are not. Where likelihoods are `profiled`, S_i
        tells nothing. At the likeliest motion a sum of squares of all rows counts: the change is that of what
        is squared.
        """
        here, seen, given = self.run, self.seen, self.run.given
        if problem.at_likeliest_motion:
            return (there.innovations - here.innovations)[seen].ravel() / width
        used, own = here.used[seen], ~given
        errors = np.where(used, there.errors[seen] - here.errors[seen], 0.0)
        ratio = np.where(used[:, :, None], np.matmul(there.whitening[seen], self.root), 0.0)
        ratio -= np.einsum("ni,ij->nij", used, np.eye(used.shape[1]))
        moved = np.einsum("nij,nj->ni", here.whitening[seen], errors)
        moved += np.einsum("nij,nj->ni", ratio[:, :, given], here.innovations[seen][:, given])
        if problem.profiled:
            return moved[:, own].ravel() / width
        ratio = ratio[:, own][:, :, own]
        low, high = np.triu_indices(ratio.shape[1])  # each pair once
        spread = (ratio[:, low, high] + ratio[:, high, low]) * np.where(low == high, np.sqrt(0.5), 1.0)
        return np.concatenate([moved[:, own].ravel(), spread.ravel()]) / width


def _likelihoods(run: FilterRun, problem: Problem) -> np.ndarray:
    """Return the part of each sample (N,) of the log-likelihood by which parameters are compared."""
    if problem.at_likeliest_motion:
        return -0.5 * (run.innovations**2).sum(axis=1)
    whole = log_likelihoods(run.innovations, run.whitening, run.given)
    return whole - log_determinants(run.whitening, run.given) if problem.profiled else whole


def _filter(point: Point, flight: Flight) -> KalmanFilter:
    return KalmanFilter(point.for_recording(flight.label).model(), problem_at(point, flight))
