"""Which joints are beyond their limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from smsid.model.spacecraft import JointGroup

SLACK = 1e-9  # [rad | m]


@dataclass(frozen=True)
class OutsideLimits:
    """A joint beyond its limits: its number in the group, name, value and limits [rad | m]."""

    index: int
    name: str
    value: float
    lower: float
    upper: float

    @property
    def middle(self) -> float:
        """The middle of the limits."""
        return (self.lower + self.upper) / 2

    def __str__(self) -> str:
        return f"home {self.value:.4g} is outside {self.lower:.4g} .. {self.upper:.4g}"


def outside_limits(model: pin.Model, group: JointGroup, angles: np.ndarray) -> tuple[OutsideLimits, ...]:
    """Return the joints of a group whose angles (joints,) are beyond their limits; joints without limits and
    those with equal ones are left out.
    """
    found = []
    for i, (j, k) in enumerate(zip(group.joints.tolist(), group.q.tolist(), strict=True)):
        low, high = float(model.lowerPositionLimit[k]), float(model.upperPositionLimit[k])
        if model.joints[j].nq != 1 or not (np.isfinite([low, high]).all() and low < high):
            continue
        if not low - SLACK <= angles[i] <= high + SLACK:
            found.append(OutsideLimits(i, group.names[i], float(angles[i]), low, high))
    return tuple(found)
