"""One mode of an appendage that is not as described, or no longer: it has warmed up, a hinge settles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from smsid.effects.appendage_effect import ModeEffect
from smsid.effects.assembly import Assembly
from smsid.effects.base import Effect, SigmaOf, Starting, physical, register


@register
class ModeError(ModeEffect):
    """A mode's clamped frequency is ``1 + frequency`` times the appendage's, its damping ratio larger by
    ``damping``. A beam's own parameters move all its modes together; this moves one.
    """

    nominal = True
    summary = "frequency and damping of one mode, apart from the appendage's others"
    aliases = ("frequency_drift", "geometric_stiffness")
    strength = ("frequency", "damping")
    in_words = "{place} bends at another frequency or damping than described"
    kind: Literal["mode_error"] = "mode_error"
    frequency: float = physical(
        "1", default=0.0, lower=-0.9, gt=-1.0, description="relative error of its frequency"
    )
    damping: float = physical("1", default=0.0, description="error of its damping ratio")
    by_batch = in_modes = True

    def estimated_as(self, effects: Sequence[Effect]) -> Effect | None:
        """Return nothing where the appendage is estimated by its modes, and so is the error."""
        own = next((e for e in effects if e.name == self.appendage), self)
        return self if own.estimated_as(effects) is own else None

    def estimated_sigmas(self, sigma: SigmaOf, relative: SigmaOf) -> dict[str, float]:
        """Return standard deviations: what the first mode, the beam's, is off by is in them, too."""
        first, own = (f"{self.appendage}.mode{k}" for k in (1, self.mode))
        frequency = [relative(f"{m}.frequency") for m in (first, own)]
        damping = [sigma(f"{m}.damping") for m in (first, own)]
        return {
            "frequency": (1.0 + self.frequency) * float(np.linalg.norm(frequency)),
            "damping": float(np.linalg.norm(damping)),
        }

    def attach(self, assembly: Assembly) -> None:
        """Add the forces of the changed spring and damper. Raises `DescriptionError` without such a mode."""
        joint, mode, mass = self.mode_joint(assembly)
        if self.frequency == 0.0 and self.damping == 0.0:
            return
        omega, grown = 2 * np.pi * mode.frequency, 1.0 + self.frequency
        spring = mass * omega**2 * (grown**2 - 1.0)
        damper = 2.0 * mass * omega * ((mode.damping + self.damping) * grown - mode.damping)
        assembly.add_springs(joint, [spring], [damper])


@register
class FrequencyDrift(ModeEffect, Starting):
    """The clamped frequency of a mode is ``1 + rate (t - start)`` times that of the appendage (start: 0 s).

    Its stiffness goes with the square; the damper stays what it is.
    """

    summary = "bending frequency that drifts"
    aliases = ("geometric_stiffness",)
    grows = True
    strength = ("rate",)
    in_words = "the frequency of {place} drifts"
    kind: Literal["frequency_drift"] = "frequency_drift"
    rate: float = physical("1/s", default=0.0, description="relative change of the frequency per time")

    def attach(self, assembly: Assembly) -> None:
        """Add the force of the change of stiffness; raises `DescriptionError` for a mode there is not."""
        number, mode, mass = self.mode_joint(assembly)
        if self.rate == 0.0:
            return
        joint = assembly.model.joints[number]
        place, index = joint.idx_q, joint.idx_v
        stiffness = mass * (2 * np.pi * mode.frequency) ** 2
        rate, start = self.rate, self.start or 0.0

        def force(t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
            change = rate * max(t - start, 0.0)
            tau[index] -= stiffness * change * (2.0 + change) * q[place]

        assembly.add_force(force, ((index,), ()))
