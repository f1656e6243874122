"""Candidates with shapes to choose from: an angle, a place, a frequency that the recording has to tell.

What such a candidate does is linear in combinations of its parameters (a first moment is mass times place),
so that each shape is a least-squares problem; the best becomes a plain candidate with what it found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from scipy.optimize import minimize

from smsid.diagnose.score_test import EXCITED, Candidate, Score, least_squares, odds, parameter_of, recast
from smsid.effects.payload import WheelImbalance, point_parameters
from smsid.estimation.map_estimate import LeftColumns, MapFit, ProjectedColumns
from smsid.estimation.parameter_vector import Unknown
from smsid.estimation.sensitivities import Sensitivities, Sensitivity

FAR = 5.0  # [m] from the reference: further away nothing of a spacecraft sits


@dataclass(frozen=True)
class ResolvedHypothesis(Candidate):
    """What a search settled on: ``effect`` has what was found, but for the strength, its first parameter.

    ``means`` are those of the priors that the effect states, by parameter: where it began to search.
    """

    means: tuple[tuple[str, float], ...] = ()

    def renamed(self, name: str) -> Candidate:
        """Return it with its effect, its parameters and their priors under another name."""
        means = tuple((parameter_of(name, p), mean) for p, mean in self.means)
        return replace(super().renamed(name), means=means)

    def unknowns(self, nominal: Sequence[Unknown]) -> tuple[Unknown, ...]:
        """Return the parameters it frees; the strength is counted from zero.

        Where it cannot be negative, it is no less than what the effect has: a slosh mass cannot be zero.
        """
        first, *rest = super().unknowns(nominal)
        if first.lower == 0.0:
            first = replace(first, lower=first.nominal)
        means = dict(self.means)
        return (
            replace(first, nominal=0.0),
            *(replace(u, nominal=means.get(u.name, u.nominal)) for u in rest),
        )


@dataclass(frozen=True)
class Shape:
    """One choice: its columns among the candidate's, and what it is made from."""

    columns: tuple[int, ...]
    label: Any


ResolvedShape = tuple[ResolvedHypothesis, np.ndarray, np.ndarray, bool]
"""What a shape stands for, see `Searched.resolved`."""


@dataclass(frozen=True)
class ProfiledHypothesis(Candidate):
    """A candidate whose columns are those of several shapes."""

    def shapes(self) -> tuple[Shape, ...]:
        """Return the shapes, in the order of their columns."""
        raise NotImplementedError

    def resolved(self, shape: Shape, coefficients: np.ndarray) -> ResolvedShape:
        """Return the candidate that coefficients (k,) of a shape's columns stand for.

        With it the derivatives (k, d) of the coefficients by its free parameters, per step; the estimate (d,)
        of these; and whether the effect can have them.
        """
        raise NotImplementedError

    def estimated(
        self, shape: Shape, gram: np.ndarray, slope: np.ndarray, raw: np.ndarray
    ) -> tuple[np.ndarray, float, np.ndarray]:
        """Return the coefficients (k,) of a shape's columns, what they gain in chi-squared, and the shares
        of information left (k,), from the normal equations of these columns as in `least_squares`.
        """
        coefficients, _, ratio, values = least_squares(gram, slope, raw)
        return coefficients, ratio, values

    def scored(self, found: MapFit, own: ProjectedColumns) -> Score:
        """Return the score of the best shape; the number of shapes is paid for."""
        return best_shape(self, found, own, self.shapes(), self.grid)


def best_shape(
    candidate: ProfiledHypothesis,
    found: MapFit,
    beside: ProjectedColumns,
    shapes: Sequence[Shape],
    variants: int = 1,
) -> Score:
    """Return the score of the best of some shapes of a candidate, by their odds.

    Each shape takes some of the columns ``beside`` the fitted parameters.
    """
    gram, slope, raw = beside.gram, beside.slope, beside.raw
    samples = found.run.samples
    best, most = None, -np.inf

    def equations(shape: Shape) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        index = np.array(shape.columns)
        return gram[np.ix_(index, index)], slope[index], raw[index]

    def bound(shape: Shape) -> float:
        """Return the odds of a shape whose coefficients may be anything: none that it can have has more."""
        _, _, ratio, values = least_squares(*equations(shape))
        return odds(ratio, int((values > EXCITED).sum()), samples)

    for limit, shape in sorted(((bound(s), s) for s in shapes), key=lambda x: -x[0]):
        if limit <= most:
            break
        index = np.array(shape.columns)
        coefficients, ratio, values = candidate.estimated(shape, *equations(shape))
        freedom = int((values > EXCITED).sum())
        own, by, estimate, allowed = candidate.resolved(shape, coefficients)
        gain = odds(ratio if allowed else 0.0, freedom, samples)
        if gain > most:
            best, most = (index, own, by, estimate, ratio if allowed else 0.0, freedom, values), gain
    assert best is not None
    index, own, by, estimate, ratio, freedom, values = best
    _, covariance, _, _ = least_squares(
        by.T @ gram[np.ix_(index, index)] @ by, by.T @ slope[index], (by**2).T @ raw[index]
    )
    own = replace(own, grid=variants * len(shapes))
    excited = float(values.min(initial=1.0))
    taken = beside.taken[:, index] @ by
    sides = 1 if freedom == 1 and own.one_sided else 2
    shown = LeftColumns(found, beside.columns[:, index], by)
    return Score(own, ratio, freedom, estimate, covariance, excited, shown, taken, sides)


@dataclass(frozen=True)
class Imbalance(ProfiledHypothesis):
    """A wheel's imbalance of unknown phase; ``free`` are its size and its phase.

    ``joint`` is the wheel's.
    """

    joint: int = 0

    def columns(self, changes: Sensitivities, nominal: Sequence[Unknown]) -> list[Sensitivity]:
        """Return the derivatives by the size where the phase is zero, and where it is a right angle."""
        effect = cast(WheelImbalance, self.effect)
        size, phase = self.free
        model = changes.model.pin
        body = changes.inertial(range(10 * (self.joint - 1), 10 * self.joint))
        found = []
        for angle in (0.0, np.pi / 2):
            changed = effect.with_values({size: self.steps[0], phase: angle})
            theta = cast(WheelImbalance, changed).inertia(model, self.joint)
            middle = sum(x * c.middle for x, c in zip(theta, body, strict=True) if x and c.middle is not None)
            at = sum(x * c.at for x, c in zip(theta, body, strict=True) if x and c.at is not None)
            found.append(Sensitivity(np.asarray(middle), np.asarray(at)))
        return found

    def shapes(self) -> tuple[Shape, ...]:
        """Return the one shape there is."""
        return (Shape((0, 1), None),)

    def resolved(self, shape: Shape, coefficients: np.ndarray) -> ResolvedShape:
        """Return size and phase of two components."""
        assert self.effect is not None
        size, phase = float(np.hypot(*coefficients)), float(np.arctan2(coefficients[1], coefficients[0]))
        effect = self.effect.with_values({self.free[1]: phase})
        along = np.array([np.cos(phase), np.sin(phase)])
        across = np.array([-along[1], along[0]])
        by = np.column_stack([along, size * self.steps[1] * across])
        return recast(ResolvedHypothesis, self, {"effect": effect}), by, np.array([size, 0.0]), True


@dataclass(frozen=True)
class LeakHypothesis(Candidate):
    """Mass that a body loses from an unknown place; ``free`` are the rate and the place.

    ``body`` is the place of the body among those of the model. Its columns are those of ten inertial
    parameters that change in proportion to time, as a point mass's grow with its place to the second power.
    """

    body: int = 0

    def columns(self, changes: Sensitivities, nominal: Sequence[Unknown]) -> list[Sensitivity]:
        """Return the derivatives by the body's inertial parameters, less at the rate of one step."""
        middle, at = changes.run.middle.time[:, None], changes.run.states.time[:, None]
        body = changes.inertial(range(10 * self.body, 10 * self.body + 10))
        return [change.weighted(-self.steps[0] * middle, -self.steps[0] * at) for change in body]

    def scored(self, found: MapFit, own: ProjectedColumns) -> Score:
        """Return the score at the origin, or where the likelihood is largest: of these two, the likelier."""
        assert self.effect is not None
        columns, gram, slope = own.columns, own.gram, own.slope

        def worth(place: np.ndarray) -> float:
            theta = point_parameters(1.0, place)
            return float(place @ place) - by_one(theta, gram, slope)

        starts = [np.zeros(3), *(0.5 * x for x in np.vstack([np.eye(3), -np.eye(3)]))]
        place = min((minimize(worth, x, method="Nelder-Mead") for x in starts), key=lambda r: r.fun).x
        samples = found.run.samples
        moves = odds(-worth(place), 4, samples) > odds(-worth(np.zeros(3)), 1, samples)
        place = place if moves and np.linalg.norm(place) < FAR else np.zeros(3)
        effect = self.effect.with_values(dict(zip(self.free[1:], place.tolist(), strict=True)))
        theta = point_parameters(1.0, place)
        alone = theta[:, None]
        (rate,), _, ratio, told = least_squares(  # none, where nothing shows that mass goes
            alone.T @ gram @ alone, alone.T @ slope, np.array([np.sum((columns @ theta) ** 2)])
        )
        by = np.column_stack(
            [
                theta,
                *(
                    rate * (point_parameters(1.0, place + h) - point_parameters(1.0, place - h)) / 2e-4
                    for h in 1e-4 * np.eye(3)
                ),
            ]
        )
        by[:, 1:] *= np.array(self.steps[1:])
        raw = np.einsum("ij,ij->j", columns @ by, columns @ by)
        _, covariance, _, values = least_squares(by.T @ gram @ by, by.T @ slope, raw)
        means = tuple((n, 0.0) for n in self.free[1:])
        leak = recast(ResolvedHypothesis, self, {"effect": effect, "grid": 2, "means": means})
        ratio = ratio if rate > 0.0 else 0.0
        estimate = np.array([rate, 0.0, 0.0, 0.0])
        freedom = int(((values if place.any() else told) > EXCITED).sum())
        excited = float(values.min(initial=1.0))
        shown = LeftColumns(found, columns, by)
        return Score(leak, ratio, freedom, estimate, covariance, excited, shown, own.taken @ by)


def by_one(theta: np.ndarray, gram: np.ndarray, slope: np.ndarray) -> float:
    """Return what columns in the proportions ``theta`` (k,) gain in chi-squared, by no less than nothing.

    ``gram`` (k, k) and ``slope`` (k,) are the columns' quadratic form.
    """
    return max(float(theta @ slope), 0.0) ** 2 / max(float(theta @ gram @ theta), 1e-300)


def place_of(coefficients: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Return the place (d,) [m] that coefficients (1 + d,) of a mass and its first moment stand for.

    ``steps`` (1 + d,) are their units.
    """
    if len(coefficients) == 1 or coefficients[0] == 0.0:
        return np.zeros(len(steps))
    place = coefficients[1:] / coefficients[0] * steps
    return place * min(1.0, FAR / max(float(np.linalg.norm(place)), 1e-9))


def moments(mass: float, place: np.ndarray, columns: int) -> np.ndarray:
    """Return the derivatives (columns, 1 + d) of a mass and its first moment by mass and place (d,).

    All in units of steps. With one column, the moment does not count.
    """
    d = len(place)
    by = np.zeros((1 + d, 1 + d))
    by[0, 0], by[1:, 0] = 1.0, place
    by[1:, 1:] = mass * np.eye(d)
    return by[:columns]
