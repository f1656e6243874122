"""Gravity gradients: the vertical that explains most, and its turning where the motion tells it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from scipy.optimize import minimize

from smsid.diagnose._profiled_hypothesis import ResolvedHypothesis
from smsid.diagnose.score_test import EXCITED, Candidate, Score, changes_of, least_squares, recast
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.effects.external import GravityGradient, TidalBodies
from smsid.estimation.map_estimate import LeftColumns, MapFit, ProjectedColumns
from smsid.estimation.parameter_vector import Unknown
from smsid.estimation.sensitivities import Sensitivities, Sensitivity, propagate
from smsid.simulate.trajectory import States

NORMALS = 8  # directions of the orbit's normal that are tried then
DIRECTIONS = 100  # of the vertical, over half a sphere
SMALL = 1e-5  # [rad] step of a difference


def _fields() -> np.ndarray:
    """Orthonormal symmetric matrices (5, 3, 3) without trace."""
    off = [
        np.outer(a, b) + np.outer(b, a) for a, b in zip(np.eye(3), np.roll(np.eye(3), 1, axis=0), strict=True)
    ]
    plain = [np.diag([1.0, -1.0, 0.0]), np.diag([1.0, 1.0, -2.0])]
    return np.array([m / np.linalg.norm(m) for m in (*off, *plain)])


FIELDS = _fields()


def coefficients(vertical: np.ndarray) -> np.ndarray:
    """Return the field ``3 r r' - 1`` of a vertical (3,) of any length in terms of `FIELDS` (5,)."""
    r = vertical / np.linalg.norm(vertical)
    return np.einsum("kij,i,j->k", FIELDS, 3.0 * r, r)


@dataclass(frozen=True)
class GravityGradientHypothesis(Candidate):
    """A gravity gradient; ``free`` are the gradient and the rotation vector of its orbit."""

    def columns(self, changes: Sensitivities, nominal: Sequence[Unknown]) -> list[Sensitivity]:
        """Return the derivatives by the field's five coefficients, per step of the gradient."""
        bodies = TidalBodies(changes.model.pin)

        def along(states: States) -> np.ndarray:
            return self.steps[0] * bodies.tide(states.q, FIELDS)

        middle, at = along(changes.run.middle), along(changes.run.states)
        return [Sensitivity(middle[:, k], at[:, k]) for k in range(len(FIELDS))]

    def scored(self, found: MapFit, own: ProjectedColumns) -> Score:
        """Return the score of the vertical that explains most, and where the motion tells, of its turning."""
        own_effect = cast(GravityGradient, self.effect)
        gram, slope = own.gram, own.slope

        def worth(vertical: np.ndarray) -> float:
            x = coefficients(vertical)
            return -(max(float(x @ slope), 0.0) ** 2) / max(float(x @ gram @ x), 1e-300)

        starts = sorted(_half_sphere(DIRECTIONS), key=worth)[:2]
        vertical = min((minimize(worth, s, method="Nelder-Mead") for s in starts), key=lambda r: r.fun).x
        vertical /= np.linalg.norm(vertical)
        x = coefficients(vertical)
        size = float(x @ slope) / max(float(x @ gram @ x), 1e-300)
        ratio = max(size, 0.0) * float(x @ slope)
        normals = _square_to(vertical, NORMALS)
        effects = [
            own_effect.model_copy(update={"nadir": tuple(vertical.tolist()), "normal": tuple(n.tolist())})
            for n in normals
        ]
        effect = (
            effects[0]
            if ratio < THRESHOLDS.vertical_seen
            else self._best_turning_vertical(found, effects, size * self.steps[0])
        )
        moved = [np.cross(h, vertical) for h in SMALL * np.eye(3)]
        ends = [coefficients(vertical + d) - coefficients(vertical - d) for d in moved]
        turned = [size * d / (2.0 * SMALL) for d in ends]
        by = np.column_stack([x, *(c * s for c, s in zip(turned, self.steps[1:], strict=True))])
        raw = np.einsum("ij,ij->j", own.columns @ by, own.columns @ by)
        _, covariance, _, values = least_squares(by.T @ gram @ by, by.T @ slope, raw)
        freedom = min(3, int((values > EXCITED).sum()))  # about itself, a vertical does not turn
        estimate = np.array([size, 0.0, 0.0, 0.0])
        excited = float(np.sort(values)[-3]) if freedom == 3 else 0.0
        settled = recast(ResolvedHypothesis, self, {"effect": effect})
        shown = LeftColumns(found, own.columns, by)
        return Score(settled, ratio, freedom, estimate, covariance, excited, shown, own.taken @ by)

    def _best_turning_vertical(
        self, found: MapFit, effects: Sequence[GravityGradient], gradient: float
    ) -> GravityGradient:
        """Return the effect whose vertical turns as explains most, at a gradient [1/s^2]."""
        changes = [
            self._turning_sensitivity(found, e.model_copy(update={"gradient": gradient})) for e in effects
        ]
        (own,) = found.projected([propagate(found.run, changes).reshape(-1, len(effects))])
        return effects[int(np.argmin(own.gram.diagonal() - 2.0 * own.slope))]

    def _turning_sensitivity(self, found: MapFit, effect: GravityGradient) -> Sensitivity:
        """Return what a field does whose vertical turns: what the parts do, as much of each as there is."""
        size, run, parts = effect.gradient / self.steps[0], found.run, changes_of(found, self)
        middle = np.stack([c.middle for c in parts if c.middle is not None])
        at = np.stack([c.at for c in parts if c.at is not None])
        return Sensitivity(
            size * np.einsum("nk,knv->nv", over_time(effect, run.middle.time), middle),
            size * np.einsum("nk,knv->nv", over_time(effect, run.states.time), at),
        )


def over_time(effect: GravityGradient, times: np.ndarray) -> np.ndarray:
    """Return the field over its gradient at times (N,) in terms of `FIELDS`: (N, 5)."""
    down, ahead = effect.vertical(0.0), effect.vertical(0.5 * np.pi / effect.rate)
    angle = effect.rate * times[:, None]
    r = np.cos(angle) * down + np.sin(angle) * ahead
    return np.einsum("kij,ni,nj->nk", FIELDS, 3.0 * r, r)


def _half_sphere(n: int) -> np.ndarray:
    """Return n directions (n, 3) spread evenly over half a sphere: a vertical up or down is the same."""
    k = np.arange(n) + 0.5
    z, angle = k / n, np.pi * (1.0 + 5.0**0.5) * k
    return np.column_stack([np.sqrt(1.0 - z**2) * np.cos(angle), np.sqrt(1.0 - z**2) * np.sin(angle), z])


def _square_to(vertical: np.ndarray, n: int) -> np.ndarray:
    """Return n directions (n, 3) around a vertical (3,), square to it."""
    first = np.cross(vertical, np.eye(3)[np.argmin(np.abs(vertical))])
    first /= np.linalg.norm(first)
    angle = 2.0 * np.pi * np.arange(n)[:, None] / n
    return np.cos(angle) * first + np.sin(angle) * np.cross(vertical, first)
