"""Play in a gear as a candidate: what torque takes the motor across the gap is searched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from smsid.diagnose.candidates import Score
from smsid.diagnose.searched import Resolved, Searched, Shape, best_shape
from smsid.effects.elastic_gear import Backlash
from smsid.estimation.map_estimate import Fit, Projected
from smsid.estimation.parameter_vector import Unknown
from smsid.estimation.sensitivities import Sensitivities, Sensitivity

# of the joint's torque (rms): with more, play is hardly told from a soft gear
SHARES = (0.7, 0.2, 0.06, 0.015, 0.003)
IDLE = 1e-6  # [N m] of a joint that is not driven


@dataclass(frozen=True)
class Play(Searched):
    """A gap crossed by a torque that the recording has to tell; ``free`` is the gap.

    ``dof`` is the velocity coordinate of the joint.
    """

    dof: int = 0

    def columns(self, changes: Sensitivities, nominal: Sequence[Unknown]) -> list[Sensitivity]:
        """Return the derivatives by the gap, crossed by each share of the torque."""
        mine = self.instance(changes.point)
        assert isinstance(mine, Backlash)
        found = []
        for turning in self._turning(changes):
            plain = mine.model_copy(update={"turn_torque": turning})
            gap = {self.free[0]: mine.gap + self.steps[0]}
            found.append(changes.effect(plain, plain.with_values(gap), 1.0))
        return found

    def scored(self, found: Fit, own: Projected) -> Score:
        """Return the score of the torque that explains most."""
        shapes = [Shape((k,), t) for k, t in enumerate(self._turning(found.changes))]
        return best_shape(self, found, own, shapes)

    def resolved(
        self, shape: Shape, coefficients: np.ndarray
    ) -> tuple[Resolved, np.ndarray, np.ndarray, bool]:
        """Return the gap crossed by the torque that is the shape's label, known no better than that."""
        assert isinstance(self.effect, Backlash)
        prior = {**self.effect.prior, "turn_torque": shape.label}
        effect = self.effect.model_copy(update={"turn_torque": shape.label, "prior": prior})
        own = Resolved(
            self.kind, self.location, self.family, self.shape, effect, self.free, self.steps, self.also
        )
        return own, np.eye(1), coefficients, float(coefficients[0]) > 0.0

    def _turning(self, changes: Sensitivities) -> list[float]:
        torque = changes.run.states.tau[:, self.dof]
        return [max(s * float(np.sqrt(np.mean(torque**2))), IDLE) for s in SHARES]
