"""The maximum of the likelihood by Gauss and Newton, damped after Levenberg and Marquardt."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from smsid.errors import NotIdentifiableError, SimulationError
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.piece import Local, Piece
from smsid.likelihood.prior import Prior

logger = logging.getLogger(__name__)

ITERATIONS = 60
NEAR = 1e-4  # a step counts as none when it would gain this much in the sum of squares: 0.01 sigma
PASSES = 40
LONGEST_STEP = 3.0  # a factor of 20 in a scalar, three times a body's size
CLOSE = 0.1  # relative change of noise levels below which the joints' motion is estimated too
SAME_NOISE = 0.01  # relative change of noise levels that needs no further pass


@dataclass(frozen=True)
class Point:
    """A point of the search: common parameters, and local ones by piece."""

    parameters: Parameters
    locals: tuple[Local, ...]


@dataclass(frozen=True)
class Normal:
    """Information (n, n) of data and prior by (parameters, local ones by piece), and gradient (n,)."""

    data: np.ndarray
    prior: np.ndarray
    gradient: np.ndarray

    @property
    def information(self) -> np.ndarray:
        """Of data and prior together."""
        return self.data + self.prior

    def covariance(self) -> np.ndarray:
        """Return the covariance (n, n) of the posterior, Gaussian."""
        return inverse(self.information)


@dataclass(frozen=True)
class Fit:
    """A maximum: the point, the pieces with their final noise, the normal equations there."""

    point: Point
    pieces: tuple[Piece, ...]
    normal: Normal
    cost: float
    samples: int
    iterations: int


def fit(pieces: Sequence[Piece], start: Point, prior: Prior, fixed: np.ndarray | None = None) -> Fit:
    """Return the maximum of the likelihood near ``start``, noise levels estimated with it.

    ``fixed`` (k,) are components of the parameter step held where they are. Raises `NotIdentifiableError`
    when the search does not come to rest.
    """
    pieces = tuple(pieces)
    point, total = start, 0
    for _ in range(PASSES):
        # far from the maximum the residuals are errors of the model: taken as noise they leave to the prior
        # what cannot be told yet, and the search does not run off along weak directions
        before = pieces
        pieces = tuple(_reweighed(p, point, i) for i, p in enumerate(pieces))
        change = max(
            float(np.abs(np.diag(a.covariance) / np.diag(b.covariance) - 1.0).max())
            for new, old in zip(pieces, before, strict=True)
            for a, b in zip(new.channels, old.channels, strict=True)
        )
        settled = change < 2 * SAME_NOISE
        found = _search(pieces, point, prior, fixed, ITERATIONS if settled else 3)
        point, normal, cost = found.point, found.normal, found.cost
        total += found.iterations
        logger.info("pass: cost %.8g, largest change of a noise level %.2g", cost, change)
        if settled and all(p.follows for p in pieces if p.drive.joints is not None):
            break
        if change < CLOSE:
            pieces = tuple(p.following() for p in pieces)
    else:
        raise _stuck(cost, float("nan"), total)
    samples = sum(c.values.shape[0] * c.width for p in pieces for c in p.channels)
    return Fit(point, pieces, normal, cost, samples, total)


def minimised(pieces: Sequence[Piece], start: Point, prior: Prior, fixed: np.ndarray | None) -> Minimum:
    """Return the minimum of the sum of squares at given noise levels; see `fit` for ``fixed`` and errors."""
    return _search(tuple(pieces), start, prior, fixed, ITERATIONS)


def evaluate(pieces: Sequence[Piece], point: Point, prior: Prior) -> float:
    """Return the sum of squares of whitened residuals, data and priors."""
    residual, _ = prior.residual(point.parameters)
    total = float(residual @ residual)
    for piece, local in zip(pieces, point.locals, strict=True):
        prediction = piece.predict(point.parameters, local)
        total += piece.cost(piece.residuals(point.parameters, local, prediction)) + piece.prior(local)[2]
    return total


def normal_equations(
    pieces: Sequence[Piece], point: Point, prior: Prior, *, with_data: bool = True
) -> tuple[Normal, float]:
    """Return the normal equations at a point and the cost there (0 ``with_data=False``)."""
    size = point.parameters.size
    n = size + sum(p.size for p in pieces)
    data, known, gradient = np.zeros((n, n)), np.zeros((n, n)), np.zeros(n)
    residual, jacobian = prior.residual(point.parameters)
    known[:size, :size] = jacobian.T @ jacobian
    cost, first = 0.0, size
    if with_data:
        gradient[:size] -= jacobian.T @ residual
        cost += float(residual @ residual)
    for piece, local in zip(pieces, point.locals, strict=True):
        prediction = piece.predict(point.parameters, local)
        found = piece.residuals(point.parameters, local, prediction) if with_data else None
        information, slope = piece.normal(point.parameters, local, prediction, found)
        place = np.concatenate([np.arange(size), np.arange(first, first + piece.size)])
        data[np.ix_(place, place)] += information
        gradient[place] += slope
        own, pull, penalty = piece.prior(local)
        mine = slice(first, first + piece.size)
        own, encoders = piece.split(own)
        known[mine, mine] += own
        data[mine, mine] += encoders
        if found is not None:
            gradient[mine] += pull
            cost += piece.cost(found) + penalty
        first += piece.size
    return Normal(data, known, gradient), cost


def moved(pieces: Sequence[Piece], point: Point, step: np.ndarray) -> Point:
    """Return the point a step (n,) away."""
    size = point.parameters.size
    locals_, first = [], size
    for piece, local in zip(pieces, point.locals, strict=True):
        locals_.append(piece.moved(local, step[first : first + piece.size]))
        first += piece.size
    return Point(point.parameters.moved(step[:size]), tuple(locals_))


def inverse(information: np.ndarray) -> np.ndarray:
    """Return the inverse of a positive definite matrix, scaled to unit diagonal first.

    Raises `NotIdentifiableError` naming the component when it is singular.
    """
    scale = 1.0 / np.sqrt(np.diag(information))
    try:
        factor = cho_factor(information * np.outer(scale, scale))
    except np.linalg.LinAlgError as cause:
        raise NotIdentifiableError(
            "Neither data nor prior determine all parameters.",
            advice="Give the effect concerned a `prior`, or leave it out.",
        ) from cause
    found = cho_solve(factor, np.eye(len(scale))) * np.outer(scale, scale)
    return 0.5 * (found + found.T)


@dataclass(frozen=True)
class Minimum:
    """Where a search ended: point, normal equations and sum of squares there, and steps taken."""

    point: Point
    normal: Normal
    cost: float
    iterations: int


def _search(
    pieces: tuple[Piece, ...], start: Point, prior: Prior, fixed: np.ndarray | None, most: int
) -> Minimum:
    """Search from ``start`` until a step gains less than `NEAR`, or ``most`` steps of a passing search."""
    point, damping, gain = start, 1e-4, np.inf
    normal, cost = normal_equations(pieces, point, prior)
    free = np.ones(len(normal.gradient), dtype=bool)
    if fixed is not None:
        free[fixed] = False
    for iteration in range(most):
        information, gradient = normal.information[np.ix_(free, free)], normal.gradient[free]
        gain = float(gradient @ _solved(information, gradient, 0.0))
        logger.debug("%d: cost %.8g, gain %.3g, damping %.1e", iteration, cost, gain, damping)
        if gain < NEAR:
            return Minimum(point, normal, cost, iteration)
        while True:
            step = np.zeros(len(free))
            step[free] = _solved(information, gradient, damping)
            try:
                trial = moved(pieces, point, step) if np.abs(step).max() < LONGEST_STEP else None
                new = np.inf if trial is None else evaluate(pieces, trial, prior)
            except SimulationError:
                trial, new = None, np.inf
            if new < cost:
                break
            logger.debug("refused: damping %.1e, longest %.2g, cost %.8g", damping, np.abs(step).max(), new)
            if gain < 100 * NEAR and trial is not None:
                return Minimum(point, normal, cost, iteration)  # as good as rounding allows
            damping = max(10.0 * damping, 1e-6)
            if damping > 1e10:
                raise _stuck(cost, gain, iteration)
        assert trial is not None
        good = cost - new > 0.75 * gain
        point, damping = trial, damping / (100.0 if good else 5.0)
        normal, cost = normal_equations(pieces, point, prior)
    if most == ITERATIONS:
        raise _stuck(cost, gain, most)
    return Minimum(point, normal, cost, most)


def _solved(information: np.ndarray, gradient: np.ndarray, damping: float) -> np.ndarray:
    scale = 1.0 / np.sqrt(np.diag(information))
    scaled = information * np.outer(scale, scale)
    scaled[np.diag_indices_from(scaled)] *= 1.0 + damping
    return scale * cho_solve(cho_factor(scaled), scale * gradient)


def _reweighed(piece: Piece, point: Point, index: int) -> Piece:
    local = point.locals[index]
    prediction = piece.predict(point.parameters, local)
    residuals = piece.residuals(point.parameters, local, prediction)
    return piece.with_noise(residuals, point.parameters, prediction)


def _stuck(cost: float, gain: float, iteration: int) -> NotIdentifiableError:
    return NotIdentifiableError(
        f"The maximum-likelihood search did not come to rest in {iteration} iterations "
        f"(sum of squares {cost:.4g}, still to gain {gain:.2g}).",
        advice="Start it from the linear method's result, or check the description against the recording.",
        cost=cost,
        gain=gain,
    )
