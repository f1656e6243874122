"""A bending frequency that changes in time: an appendage that warms up, a hinge that settles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field

from smsid.effects.assembly import AppendageJoints, Assembly
from smsid.effects.base import Starting, physical, register
from smsid.errors import DescriptionError

if TYPE_CHECKING:
    from smsid.effects.appendage import Mode


@register
class FrequencyDrift(Starting):
    """The clamped frequency of a mode is ``1 + rate (t - start)`` times that of the appendage (start: 0 s).

    Its stiffness goes with the square; the damper stays what it is.
    """

    summary = "bending frequency that drifts"
    family = "appendage"
    aliases = ("geometric_stiffness",)
    grows = True
    strength = ("rate",)
    kind: Literal["frequency_drift"] = "frequency_drift"
    appendage: str = Field(description="name of the appendage, which stands before this effect")
    mode: int = Field(default=1, ge=1, description="number of the mode, from 1")
    rate: float = physical("1/s", default=0.0, description="relative change of the frequency per time")

    def attach(self, assembly: Assembly) -> None:
        """Add the force of the change of stiffness; raises `DescriptionError` for a mode there is not."""
        panel, mode = attached_mode(assembly, self.appendage, self.mode)
        if self.rate == 0.0:
            return
        joint = assembly.model.joints[panel.joints[self.mode - 1]]
        place, index = joint.idx_q, joint.idx_v
        omega = 2 * np.pi * mode.frequency
        stiffness = float(panel.scale[self.mode - 1]) ** 2 * omega**2
        rate, start = self.rate, self.start or 0.0

        def force(t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
            if t > start:
                change = rate * (t - start)
                tau[index] -= stiffness * change * (2.0 + change) * q[place]

        assembly.add_force(force, (start,), ((index,), ()))


def attached_appendage(assembly: Assembly, name: str) -> AppendageJoints:
    """Return an appendage that is attached already; raises `DescriptionError`."""
    for panel in assembly.appendages:
        if panel.appendage.name == name:
            return panel
    known = ", ".join(p.appendage.name for p in assembly.appendages) or "none"
    raise DescriptionError(
        f"There is no appendage '{name}' before this effect.", advice=f"So far: {known}.", appendage=name
    )


def attached_mode(assembly: Assembly, name: str, number: int) -> tuple[AppendageJoints, Mode]:
    """Return an appendage that is attached already and its mode of a number, from 1; raises
    `DescriptionError`.
    """
    panel = attached_appendage(assembly, name)
    modes = panel.appendage.modal_data()
    if number > len(modes):
        raise DescriptionError(
            f"'{name}' has {len(modes)} modes, not {number}.", advice="Count from 1.", mode=number
        )
    return panel, modes[number - 1]
