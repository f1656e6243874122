"""Strengths that act beyond or below a threshold, which the recording has to tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from smsid.diagnose._profiled_hypothesis import (
    ProfiledHypothesis,
    ResolvedHypothesis,
    ResolvedShape,
    Shape,
    best_shape,
)
from smsid.diagnose.score_test import Score, recast
from smsid.estimation.map_estimate import MapFit, ProjectedColumns
from smsid.estimation.parameter_vector import Unknown
from smsid.estimation.sensitivities import Sensitivities, Sensitivity

IDLE = 1e-6  # [of the motion's unit] of what does not move


@dataclass(frozen=True)
class ThresholdHypothesis(ProfiledHypothesis):
    """A strength, ``free``, that acts beyond or below a threshold which the recording has to tell.

    The threshold is the parameter ``field``: the torque that crosses a gap, the rate below which a wheel
    sticks, the room a slosh mass has. It is tried at ``shares`` of the rms of what it is compared with: of
    the states' ``motion`` (torque, rate, place), the coordinates from ``first`` up to, not with, ``last``.
    """

    field: str = ""
    shares: tuple[float, ...] = ()
    motion: Literal["tau", "v", "q"] = "tau"
    first: int = 0
    last: int = 1

    def columns(self, changes: Sensitivities, nominal: Sequence[Unknown]) -> list[Sensitivity]:
        """Return the derivatives by the strength, per step, at each threshold."""
        mine = self.instance(changes.point)
        strength = next(p.value for p in mine.parameters() if p.name == self.free[0])
        found = []
        for threshold in self._thresholds(changes):
            plain = mine.model_copy(update={self.field: threshold})
            more = plain.with_values({self.free[0]: strength + self.steps[0]})
            found += self._joint_torques(plain, changes) or [changes.effect(plain, more, 1.0)]
        return found

    def scored(self, found: MapFit, own: ProjectedColumns) -> Score:
        """Return the score at the threshold that explains most."""
        shapes = [Shape((k,), t) for k, t in enumerate(self._thresholds(found.changes))]
        return best_shape(self, found, own, shapes)

    def resolved(self, shape: Shape, coefficients: np.ndarray) -> ResolvedShape:
        """Return the strength at the threshold that is the shape's label, known no better than that."""
        assert self.effect is not None
        prior = {**self.effect.prior, self.field: shape.label}
        effect = self.effect.model_copy(update={self.field: shape.label, "prior": prior})
        own = recast(ResolvedHypothesis, self, {"effect": effect})
        return own, np.eye(1), coefficients, float(coefficients[0]) > 0.0

    def _thresholds(self, changes: Sensitivities) -> list[float]:
        motion = getattr(changes.run.states, self.motion)[:, self.first : self.last]
        size = float(np.sqrt(np.mean((motion**2).sum(axis=1))))
        return [max(s * size, IDLE) for s in self.shares]
