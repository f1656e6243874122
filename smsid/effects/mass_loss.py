"""Mass that leaves: propellant used up, a leak."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from smsid.effects.assembly import Assembly
from smsid.effects.base import Starting, Vector3, physical, register
from smsid.effects.payload import point_parameters
from smsid.effects.spatial import ExtraInertia


@register
class MassLoss(Starting):
    """The mass of a body falls linearly in time: ``rate (t - start)`` less at ``position`` (start: 0 s).

    What leaves has the velocity of the point it leaves from, so it takes its momentum along and pushes
    nothing: every instant's motion is that of the mass left. The thrust of what is blown out is an
    `external_wrench` beside it. The equations of motion get the inertia of a point mass of ``-rate (t -
    start)``, with no term from its rate of change.
    """

    summary = "mass loss: the mass of a body falls linearly in time, without push"
    family = "inertia"
    aliases = ("body_error", "thruster_gain")
    grows = True
    strength = ("rate",)
    point_mass = ("rate", "position")
    in_words = "{place} loses mass"
    kind: Literal["mass_loss"] = "mass_loss"
    frame: str | None = Field(default=None, description="frame it leaves from; the bus frame when not given")
    position: Vector3 = physical("m", default=(0.0, 0.0, 0.0), description="where it leaves, in `frame`")
    rate: float = physical("kg/s", lower=0.0, description="mass lost per time")

    def attach(self, assembly: Assembly) -> None:
        """Add the point mass that is no longer there."""
        joint, placement = assembly.frame(self.frame)
        if joint == 0 or self.rate == 0.0:
            return
        unit = point_parameters(-self.rate, placement.act(np.asarray(self.position)))
        start = self.start or 0.0

        def parameters(t: float) -> np.ndarray | None:
            return unit * (t - start) if t > start else None

        assembly.add_inertia_term(ExtraInertia(assembly.model, joint, parameters))
