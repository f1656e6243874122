"""One mode of an appendage that is not as described, whatever its other modes are."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import Field

from smsid.effects.appendage_drift import attached_mode
from smsid.effects.base import Effect, physical, register

if TYPE_CHECKING:
    from smsid.effects.assembly import Assembly


@register
class ModeError(Effect):
    """A mode's clamped frequency is ``1 + frequency`` times the appendage's, its damping ratio larger by
    ``damping``. A beam's own parameters move all its modes together; this moves one.
    """

    summary: ClassVar[str] = "frequency and damping of one mode, apart from the appendage's others"
    nominal: ClassVar[bool] = True
    family: ClassVar[str] = "appendage"
    aliases: ClassVar[tuple[str, ...]] = ("frequency_drift", "geometric_stiffness")
    strength: ClassVar[tuple[str, ...]] = ("frequency", "damping")
    kind: Literal["mode_error"] = "mode_error"
    appendage: str = Field(description="name of the appendage, which stands before this effect")
    mode: int = Field(default=1, ge=1, description="number of the mode, from 1")
    frequency: float = physical(
        "1", default=0.0, lower=-0.9, gt=-1.0, description="relative error of its frequency"
    )
    damping: float = physical("1", default=0.0, description="error of its damping ratio")

    def attach(self, assembly: Assembly) -> None:
        """Add the forces of the changed spring and damper. Raises `DescriptionError` without such a mode."""
        panel, mode = attached_mode(assembly, self.appendage, self.mode)
        if self.frequency == 0.0 and self.damping == 0.0:
            return
        mass = float(panel.scale[self.mode - 1]) ** 2
        omega, grown = 2 * np.pi * mode.frequency, 1.0 + self.frequency
        spring = mass * omega**2 * (grown**2 - 1.0)
        damper = 2.0 * mass * omega * ((mode.damping + self.damping) * grown - mode.damping)
        assembly.add_springs(panel.joints[self.mode - 1], [spring], [damper])
