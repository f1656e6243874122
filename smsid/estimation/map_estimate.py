"""Fitting parameters to a recording: Gauss and Newton on the innovations of the filter, with priors."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.fft import dct
from scipy.linalg import orth, qr, solve_triangular
from scipy.linalg.blas import dgemm
from scipy.stats import t as student

from smsid._statistics import NORMAL95
from smsid.errors import SimulationError
from smsid.estimation._shape_errors import shape_errors
from smsid.estimation._trust_region import bounded_step, descend, predicted_gain
from smsid.estimation.filter_run import FilterRun
from smsid.estimation.joint_problem import at_point, sensitivities
from smsid.estimation.kalman import run_filter
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.estimation.problem import Problem
from smsid.estimation.sensitivities import Sensitivities, Sensitivity, propagate

LOGGER = logging.getLogger(__name__)
ENOUGH_GAIN = 0.1  # predicted gain of the log-posterior below which the last step is taken without looking
NEARLY_AT_REST = 10.0  # predicted gain of the log-posterior, below which a fit is nearly at rest
MOST_TRIES = 6  # steps that are tried from one point, each shorter than the last
STALLED_SHARE = 0.02  # share of the predicted gain below which two steps in a row were the last
REACH = 1.1  # share of the predicted gain within which a fit may still reach what it has to
FIRST_REACH = 10.0  # the same of its first step, which may be of a motion that is none yet
PATIENCE = 4  # steps after which it has to be there
TOLD_TWICE = 1e-4  # share of a column's squares, below which what is left of it is told by itself, or twice
COSINES = 4  # slowest ones that the variance of a sum of coloured errors is read from
STUDENT_FACTOR = float(student.ppf(0.975, COSINES)) / NORMAL95  # what so few make of a normal's 95 %
COLUMNS_AT_ONCE = 64  # columns that are projected at once: as fast as all of them, and they fit in memory


@dataclass(frozen=True)
class PriorRows:
    """Priors at a point: what they are off by in standard deviations, and the rows of its derivatives by the
    parameters, in units of their scales.
    """

    off: np.ndarray
    rows: np.ndarray


@dataclass(frozen=True)
class ProjectedColumns:
    """Whitened columns (N rows, d) beside a fit's parameters: their squares ``raw`` (d,), the products
    ``gram`` (d, d) of what the parameters leave of them and ``slope`` (d,) of that with the residual, and by
    how much the parameters stand in for them: ``taken`` (m, d), in scales.
    """

    fit: MapFit
    columns: np.ndarray
    raw: np.ndarray
    gram: np.ndarray
    slope: np.ndarray
    taken: np.ndarray

    @property
    def left(self) -> np.ndarray:
        """What the parameters leave of them (N rows + priors, d)."""
        return self.fit.left(self.columns)

    def only(self, which: np.ndarray) -> ProjectedColumns:
        """Return those of the columns that ``which`` (d,) marks."""
        return replace(
            self,
            columns=self.columns[:, which],
            raw=self.raw[which],
            gram=self.gram[np.ix_(which, which)],
            slope=self.slope[which],
            taken=self.taken[:, which],
        )


@dataclass(frozen=True)
class LeftColumns:
    """What a fit leaves (N rows + priors, d) of whitened columns (N rows, k) times ``by`` (k, d), or as they
    are; an array when it is asked for: of hundreds of candidates few are, and together they take the most.
    """

    fit: MapFit
    columns: np.ndarray
    by: np.ndarray | None = None

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """Return the array, see `numpy.asarray`."""
        return self._whole

    @cached_property
    def _whole(self) -> np.ndarray:
        return self.fit.left(self.columns if self.by is None else self.columns @ self.by)


@dataclass(frozen=True)
class MapFit:
    """A fitted point: the filter's run there, and Gauss's normal equations in units of `Unknown.scale`.

    ``whitened`` (N, rows, m) are the derivatives of the whitened predictions, ``gram`` (m, m) and ``slope``
    (m,) those of the posterior: data and prior together. ``objective`` is minus the log-posterior.
    """

    point: Point
    unknowns: tuple[Unknown, ...]
    problem: Problem
    run: FilterRun
    whitened: np.ndarray
    gram: np.ndarray
    slope: np.ndarray
    objective: float
    changes: Sensitivities
    prior: PriorRows

    @cached_property
    def told(self) -> np.ndarray:
        """Which parameters (m,) a sample or a prior tells anything of."""
        return (self.whitened != 0.0).any(axis=(0, 1)) | (self.prior.rows != 0.0).any(axis=0)

    @cached_property
    def factors(self) -> tuple[np.ndarray, np.ndarray]:
        """Q (N rows + priors, k) and R (k, k) of the whitened derivatives with the priors' rows below, by the
        k parameters that are `told`.
        """
        flat = self.whitened.reshape(-1, len(self.unknowns))
        # in the order that takes half the time of numpy's
        whole = np.vstack([flat, self.prior.rows])
        whole = np.asfortranarray(whole if self.told.all() else whole[:, self.told])
        return qr(whole, mode="economic", overwrite_a=True, check_finite=False)  # pyright: ignore

    @cached_property
    def residual(self) -> np.ndarray:
        """Innovations and what the priors leave (N rows + priors,)."""
        return np.concatenate([self.run.innovations.ravel(), -self.prior.off])

    @property
    def stretch(self) -> float:
        """Root mean square of what the parameters that have priors are off by, in standard deviations: what
        is known of them counts like what was measured.
        """
        known = self.prior.off[(self.prior.rows != 0.0).any(axis=1)]
        return float(np.sqrt(np.mean(known**2))) if len(known) else 0.0

    def left(self, columns: np.ndarray) -> np.ndarray:
        """Return what of whitened columns (N rows, d) the fitted parameters cannot do: (N rows + priors, d).

        By projection, not by differences of Gram matrices, which lose what a tight prior leaves.
        """
        return self._less(columns, self.factors[0][: len(columns)].T @ columns)

    def _less(self, columns: np.ndarray, own: np.ndarray) -> np.ndarray:
        """Return columns (N rows, d) less what of them is in the derivatives, ``own`` (k, d) by their Q."""
        left = np.zeros((len(self.residual), columns.shape[1]), order="F")
        left[: len(columns)] = columns
        before = np.einsum("ij,ij->j", left, left)
        q, _ = self.factors
        left = dgemm(-1.0, q, own, 1.0, left, overwrite_c=True)  # left -= q @ own
        rest = np.einsum("ij,ij->j", left, left) < TOLD_TWICE * before  # of little, rounding is more
        if rest.any():
            left[:, rest] -= q @ (q.T @ left[:, rest])
        return left

    def projected(self, groups: Sequence[np.ndarray]) -> Iterator[ProjectedColumns]:
        """Yield groups of whitened columns, (N rows, d) each, beside the fitted parameters.

        Many at once: one product of large matrices is far faster than many of thin ones. Where little is left
        of any combination of a group's columns, the products are those of what is left.
        """
        q, r = self.factors
        within, first = q.T @ self.residual, 0
        while first < len(groups):
            widths = np.cumsum([g.shape[1] for g in groups[first:]])
            some = groups[first:][: max(1, int(np.searchsorted(widths, COLUMNS_AT_ONCE)))]
            rows, ends = len(some[0]), np.cumsum([g.shape[1] for g in some])
            together = np.empty((rows, ends[-1]), order="F")
            np.concatenate(some, axis=1, out=together)
            own, slopes = q[:rows].T @ together, together.T @ self.residual[:rows]
            taken = np.zeros((len(self.unknowns), ends[-1]))
            taken[self.told] = solve_triangular(r, own)
            parts = (np.split(x, ends[:-1], axis=-1) for x in (own, slopes, taken))
            for columns, mine, slope, moved in zip(some, *parts, strict=True):
                gram = columns.T @ columns
                raw = gram.diagonal()
                gram, slope = gram - mine.T @ mine, slope - mine.T @ within
                size = np.sqrt(np.where(raw > 0.0, raw, 1.0))
                if np.linalg.eigvalsh(gram / np.outer(size, size)).min(initial=1.0) < TOLD_TWICE:
                    left = self._less(columns, mine)
                    gram, slope = left.T @ left, left.T @ self.residual
                yield ProjectedColumns(self, columns, raw, gram, slope, moved)
            first += len(some)

    @property
    def scales(self) -> np.ndarray:
        """Scales of the parameters (m,)."""
        return np.array([u.scale for u in self.unknowns])

    def covariance(self, held: Collection[str] = (), *, white: bool = False) -> np.ndarray:
        """Return the posterior covariance (m, m) in the parameters' units; those ``held`` have none.

        Beside misfit that is counted as noise, standard deviations are at least what `slow_errors` make them,
        but for errors taken as ``white``; of a Gaussian with them, 95 % are within what holds 95 % here.
        """
        found = self._inverse(held)
        for (_, sigma), slopes in zip(self.problem.noise.shapes, self._by_shape, strict=True):
            bent = sigma * found @ (slopes / self.scales[:, None])
            found = found + bent @ bent.T
        if self.problem.coloured and not white:
            spread = STUDENT_FACTOR * np.linalg.norm(self.slow_errors(held), axis=1)
            sigma = np.sqrt(np.diag(found))
            more = np.maximum(np.divide(spread, sigma, out=np.ones_like(spread), where=sigma > 0.0), 1.0)
            found = found * np.outer(more, more)
        return found

    def slow_errors(self, held: Collection[str] = ()) -> np.ndarray:
        """Return amplitudes (m, `COSINES`) whose products are the covariance of the estimate by the spectrum
        that its errors have along each parameter's own signature, whatever the levels of the noise are.

        By the slowest cosines of the samples' scores, see Lazarus, Lewis, Stock and Watson, J. Bus. Econ.
        Stat. 36 (2018) 541: Student's t with as many degrees of freedom.
        """
        scores = np.einsum("nri,nr->ni", self.whitened, self.run.innovations) / self.scales
        slowest = np.sqrt(len(scores) / COSINES) * dct(scores, axis=0, norm="ortho")[1 : COSINES + 1]
        return self._inverse(held) @ slowest.T

    def _inverse(self, held: Collection[str]) -> np.ndarray:
        free = np.array([u.name not in held for u in self.unknowns])
        gram = np.where(np.outer(free, free), self.gram, 0.0)
        size = np.sqrt(np.diag(gram))  # scales differ by more than pinv takes for nothing
        size = np.where(size > 0.0, size, 1.0)
        inverse = np.linalg.pinv(gram / np.outer(size, size), hermitian=True)
        return inverse * np.outer(self.scales / size, self.scales / size)

    @cached_property
    def _by_shape(self) -> list[np.ndarray]:
        """Slopes (m, k) by the parameters that errors of shape of one make, for every joint that has them."""
        flat = self.whitened.reshape(-1, len(self.unknowns)).T
        errors = (shape_errors(self.changes.model, self.run, dof) for dof, _ in self.problem.noise.shapes)
        return [flat @ e.reshape(flat.shape[1], -1) for e in errors]

    @cached_property
    def shape_error_basis(self) -> np.ndarray:
        """An orthonormal basis (N rows, k) of what errors of laws whose shape is left open do to the whitened
        predictions.
        """
        dofs, rows = [dof for dof, _ in self.problem.noise.shapes], self.run.innovations.size
        made = [shape_errors(self.changes.model, self.run, dof).reshape(rows, -1) for dof in dofs]
        errors = np.hstack([np.zeros((rows, 0)), *made])
        size = np.linalg.norm(errors, axis=0)
        return (
            orth(errors[:, size > 0.0] / size[size > 0.0], rcond=TOLD_TWICE) if size.any() else errors[:, :0]
        )

    def with_shape_errors(self) -> MapFit:
        """Return the fit beside errors of laws whose shape is left open, as large as can be: tests of what is
        left must not find these, which repeat and are not white.
        """
        errors, m = self.shape_error_basis, len(self.unknowns)
        rows, count = errors.shape
        if not count:
            return self
        names = (f"error of shape {k}" for k in range(count))
        unknowns = (*self.unknowns, *(Unknown(n, "effect", "1", 0.0, np.inf, 1.0) for n in names))
        flat = np.hstack([self.whitened.reshape(rows, m), errors])
        prior = PriorRows(self.prior.off, np.pad(self.prior.rows, ((0, 0), (0, count))))
        gram = flat.T @ flat + prior.rows.T @ prior.rows
        slope = flat.T @ self.run.innovations.ravel() - prior.rows.T @ prior.off
        whitened = flat.reshape(*self.run.innovations.shape, m + count)
        return replace(self, unknowns=unknowns, whitened=whitened, gram=gram, slope=slope, prior=prior)

    def with_unfitted(self, more: Sequence[Unknown]) -> MapFit:
        """Return the fit with further parameters that stay as they are, but are as uncertain as they are."""
        unknowns = (*self.unknowns, *more)
        return _normal(self.point, unknowns, self.problem, self.run, self.changes.model)

    def sigma(self, name: str) -> float:
        """Return the standard deviation of a parameter."""
        i = [u.name for u in self.unknowns].index(name)
        return float(np.sqrt(self.covariance()[i, i]))


def fit(
    point: Point,
    unknowns: Sequence[Unknown],
    problem: Problem,
    *,
    iterations: int = 6,
    enough: float = ENOUGH_GAIN,
    at_most: float = np.inf,
    in_vain: Callable[[MapFit], object] | None = None,
) -> MapFit:
    """Return the point that maximises likelihood times prior, from a start.

    ``enough`` is the gain of the log-posterior below which a step is the last: one that is predicted, or two
    in a row; a fit that does not come to the objective ``at_most`` is given up early, and so is one that is
    ``in_vain`` where it is nearly at rest, and where it goes from there. Raises `SimulationError` when the
    start itself cannot be filtered.
    """
    start = evaluate(point, unknowns, problem)
    return continue_fit(start, iterations=iterations, enough=enough, at_most=at_most, in_vain=in_vain)


def continue_fit(
    found: MapFit,
    *,
    iterations: int = 6,
    enough: float = ENOUGH_GAIN,
    at_most: float = np.inf,
    in_vain: Callable[[MapFit], object] | None = None,
) -> MapFit:
    """Return a fit some iterations on.

    Steps are shortened, those most that the data tell least of, until the objective falls and every body can
    exist (Levenberg and Marquardt, with the length in hand, not the damping).
    """
    unknowns = found.unknowns
    stalled, radius = 0, np.inf
    for i in range(iterations):
        step = bounded_step(found)
        gain = predicted_gain(found, step)
        hoped = (REACH if i else FIRST_REACH) if i < PATIENCE else 0.0
        if found.objective - hoped * gain > at_most:
            LOGGER.info("given up at %.2f: %.2f is out of reach", found.objective, at_most)
            break
        if i and gain < NEARLY_AT_REST and in_vain is not None and in_vain(found):
            ahead = replace(found, point=found.point.moved(unknowns, step * found.scales))
            if in_vain(ahead):
                break
        if gain < enough:
            last = found.point.moved(unknowns, step * found.scales)
            return _last_step(found, last, step, gain) if last.physical() else found
        better, radius = _descend(found, radius)
        if better is None:
            break
        LOGGER.info("objective %.2f -> %.2f (predicted gain %.2f)", found.objective, better.objective, gain)
        gained = found.objective - better.objective
        stalled = stalled + 1 if gained < max(STALLED_SHARE * gain, enough) else 0
        found = better
        if stalled == 2:
            break
    return found


def within_reach(found: MapFit) -> float:
    """Return the objective that one step of Gauss and Newton would reach if nothing were curved."""
    return found.objective - predicted_gain(found, bounded_step(found))


def _last_step(found: MapFit, point: Point, step: np.ndarray, gain: float) -> MapFit:
    """Return the fit a small step on, its innovations moved along their derivatives."""
    run = replace(found.run, innovations=found.run.innovations - found.whitened @ step)
    prior = prior_of(point, found.unknowns, found.problem)
    rest = found.slope - found.gram @ step
    return replace(found, point=point, run=run, slope=rest, objective=found.objective - gain, prior=prior)


def _descend(found: MapFit, radius: float) -> tuple[MapFit | None, float]:
    def look(point: Point) -> tuple[float, Callable[[], MapFit]]:
        model = point.model()
        run = run_filter(model, at_point(point, found.problem))
        least = objective(point, found.unknowns, found.problem, run)
        return least, lambda: _normal(point, found.unknowns, found.problem, run, model)

    return descend(found, radius, MOST_TRIES, look)


def evaluate(point: Point, unknowns: Sequence[Unknown], problem: Problem) -> MapFit:
    """Return the normal equations at a point."""
    model = point.model()
    problem_here = at_point(point, problem)
    return _normal(point, unknowns, problem, run_filter(model, problem_here), model)


def objective(point: Point, unknowns: Sequence[Unknown], problem: Problem, run: FilterRun) -> float:
    """Return minus the log-posterior, without constants."""
    off = prior_of(point, unknowns, problem).off
    return -run.log_likelihood + 0.5 * float(off @ off)


def prior_of(point: Point, unknowns: Sequence[Unknown], problem: Problem) -> PriorRows:
    """Return the priors of single parameters and of what is known together at a point."""
    shift = np.array([point.value(u) - u.nominal for u in unknowns])
    scale = np.array([u.scale for u in unknowns])
    joint = problem.joint
    own = np.diag([0.0 if joint.single(u) else 1.0 / u.sigma for u in unknowns])
    rows = np.vstack([own, joint.rows(unknowns)])
    return PriorRows(rows @ shift, rows * scale)


def _normal(point: Point, unknowns: Sequence[Unknown], problem: Problem, run: FilterRun, model) -> MapFit:
    here = at_point(point, problem)
    changes = sensitivities(point, model, here, run)
    whitened = propagate(run, columns_of(changes, unknowns))
    whitened *= np.array([u.scale for u in unknowns])
    flat = whitened.reshape(-1, len(unknowns))
    if not np.isfinite(flat).all():
        raise SimulationError(
            "The derivatives of the predictions are no longer finite.",
            advice="Does the description belong to this recording? Check units and signs.",
        )
    prior = prior_of(point, unknowns, problem)
    gram = flat.T @ flat + prior.rows.T @ prior.rows
    slope = flat.T @ run.innovations.ravel() - prior.rows.T @ prior.off
    least = objective(point, unknowns, problem, run)
    return MapFit(point, tuple(unknowns), problem, run, whitened, gram, slope, least, changes, prior)


def columns_of(changes: Sensitivities, unknowns: Sequence[Unknown]) -> list[Sensitivity]:
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
        else changes.sensor(u)
        if u.kind == "sensor"
        else Sensitivity()
        if u.kind == "start"
        else changes.unknown(u)
        for u in unknowns
    ]
