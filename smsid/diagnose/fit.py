"""Fitting parameters to a recording: Gauss and Newton on the innovations of the filter, with priors."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from smsid.diagnose.columns import Change, Changes, propagate
from smsid.diagnose.filter import Problem, Run, run_filter
from smsid.diagnose.point import Point, Unknown
from smsid.errors import SmsidError

LOGGER = logging.getLogger(__name__)
ENOUGH = 0.1  # predicted gain of the log-posterior below which the last step is taken without looking
HALVINGS = 6


@dataclass(frozen=True)
class Fit:
    """A fitted point: the filter's run there, and Gauss's normal equations in units of `Unknown.scale`.

    ``whitened`` (N, rows, m) are the derivatives of the whitened predictions, ``gram`` (m, m) and ``slope``
    (m,) those of the posterior: data and prior together. ``objective`` is minus the log-posterior.
    """

    point: Point
    unknowns: tuple[Unknown, ...]
    problem: Problem
    run: Run
    whitened: np.ndarray
    gram: np.ndarray
    slope: np.ndarray
    objective: float
    changes: Changes

    @cached_property
    def basis(self) -> np.ndarray:
        """Orthonormal columns (N rows + m, m) that span what the fitted parameters can do, priors included."""
        flat = self.whitened.reshape(-1, len(self.unknowns))
        weight = np.array([u.scale / u.sigma for u in self.unknowns])
        return np.linalg.qr(np.vstack([flat, np.diag(weight)]))[0]

    @cached_property
    def residual(self) -> np.ndarray:
        """Innovations and the priors' residuals (N rows + m,)."""
        return np.concatenate([self.run.innovations.ravel(), -_prior(self.point, self.unknowns)])

    def left(self, columns: np.ndarray) -> np.ndarray:
        """Return what of whitened columns (N rows, d) the fitted parameters cannot do: (N rows + m, d).

        By projection, not by differences of Gram matrices, which lose what a tight prior leaves.
        """
        whole = np.vstack([columns, np.zeros((len(self.unknowns), columns.shape[1]))])
        whole -= self.basis @ (self.basis.T @ whole)
        return whole - self.basis @ (self.basis.T @ whole)

    @property
    def scales(self) -> np.ndarray:
        """Scales of the parameters (m,)."""
        return np.array([u.scale for u in self.unknowns])

    def covariance(self) -> np.ndarray:
        """Return the posterior covariance (m, m) in the parameters' units."""
        s = self.scales
        return np.linalg.pinv(self.gram, hermitian=True) * np.outer(s, s)

    def sigma(self, name: str) -> float:
        """Return the standard deviation of a parameter."""
        i = [u.name for u in self.unknowns].index(name)
        return float(np.sqrt(self.covariance()[i, i]))


def fit(point: Point, unknowns: Sequence[Unknown], problem: Problem, *, iterations: int = 6) -> Fit:
    """Return the point that maximises likelihood times prior, from a start.

    Steps are halved until the objective falls and every body can exist. Raises `SimulationError` when the
    start itself cannot be filtered.
    """
    found = evaluate(point, unknowns, problem)
    for _ in range(iterations):
        step = np.linalg.solve(found.gram + 1e-12 * np.diag(np.diag(found.gram)), found.slope)
        gain = 0.5 * float(found.slope @ step)
        if gain < ENOUGH:
            last = found.point.moved(unknowns, step * found.scales)
            return _last_step(found, last, step) if last.physical() else found
        better = _descend(found, step, unknowns, problem)
        if better is None:
            break
        LOGGER.info("objective %.2f -> %.2f (predicted gain %.2f)", found.objective, better.objective, gain)
        found = better
    return found


def _last_step(found: Fit, point: Point, step: np.ndarray) -> Fit:
    """Return the fit a small step on, its innovations moved along their derivatives."""
    innovations = found.run.innovations - found.whitened @ step
    run = replace(found.run, innovations=innovations)
    gain = 0.5 * float(found.slope @ step)
    return replace(
        found, point=point, run=run, slope=np.zeros_like(found.slope), objective=found.objective - gain
    )


def _descend(found: Fit, step: np.ndarray, unknowns: Sequence[Unknown], problem: Problem) -> Fit | None:
    for halving in range(HALVINGS):
        try:
            point = found.point.moved(unknowns, 0.5**halving * step * found.scales)
            if not point.physical():
                continue
            model = point.model()
            run = run_filter(model, replace(problem, data=problem.data.with_blocks(point.sensors())))
        except SmsidError as error:
            LOGGER.info("step refused: %s", error)
            continue
        if objective(point, unknowns, run) < found.objective:
            return _normal(point, unknowns, problem, run, model)
    return None


def evaluate(point: Point, unknowns: Sequence[Unknown], problem: Problem) -> Fit:
    """Return the normal equations at a point."""
    model = point.model()
    problem_here = replace(problem, data=problem.data.with_blocks(point.sensors()))
    return _normal(point, unknowns, problem, run_filter(model, problem_here), model)


def objective(point: Point, unknowns: Sequence[Unknown], run: Run) -> float:
    """Return minus the log-posterior, without constants."""
    return -run.log_likelihood + 0.5 * float(sum(x * x for x in _prior(point, unknowns)))


def _prior(point: Point, unknowns: Sequence[Unknown]) -> np.ndarray:
    return np.array([(point.value(u) - u.nominal) / u.sigma for u in unknowns])


def _normal(point: Point, unknowns: Sequence[Unknown], problem: Problem, run: Run, model) -> Fit:
    here = replace(problem, data=problem.data.with_blocks(point.sensors()))
    changes = Changes(point, model, here, run)
    whitened = propagate(run, columns_of(changes, unknowns))
    whitened *= np.array([u.scale for u in unknowns])
    flat = whitened.reshape(-1, len(unknowns))
    weight = np.array([(u.scale / u.sigma) ** 2 for u in unknowns])
    pull = np.array([u.scale / u.sigma for u in unknowns]) * _prior(point, unknowns)
    gram = flat.T @ flat + np.diag(weight)
    slope = flat.T @ run.innovations.ravel() - pull
    return Fit(
        point, tuple(unknowns), problem, run, whitened, gram, slope, objective(point, unknowns, run), changes
    )


def columns_of(changes: Changes, unknowns: Sequence[Unknown]) -> list[Change]:
    """Return the changes by unknowns, inertial ones together."""
    inertial = [u for u in unknowns if u.kind == "inertial"]
    by_column = dict(
        zip([u.column for u in inertial], changes.inertial([u.column for u in inertial]), strict=True)
        if inertial
        else ()
    )
    return [
        by_column[u.column]
        if u.kind == "inertial"
        else changes.bias(u)
        if u.kind == "bias"
        else changes.unknown(u)
        for u in unknowns
    ]
