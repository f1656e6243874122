"""A bending mode that the description of a beam leaves out."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from smsid.effects.appendage import BeamAppendage
from smsid.effects.appendage_effect import BeamEffect
from smsid.effects.assembly import AppendageJoints, Assembly
from smsid.effects.base import Effect, physical, register
from smsid.effects.mode import Mode, mode_joint
from smsid.errors import DescriptionError


@register
class BeamMode(BeamEffect):
    """Mode ``mode`` of a `beam_appendage` that has fewer: ``factor`` 1 is that of the uniform beam.

    With factor f its participation factors and its shape at the stations are sqrt(f) times the beam's, its
    frequency is ``1 + frequency`` times theirs. The mass is taken out of the rigid rest. With f = 1 and
    nothing else given this is the beam with one mode more.
    """

    nominal = True
    summary = "a higher bending mode of a beam appendage, which its stations see"
    needs_beam = "its higher modes are"
    aliases = ("extra_mode", "slosh", "frequency_drift")
    strength = ("factor",)
    in_words = "{place} has a mode that the description lacks"
    kind: Literal["beam_mode"] = "beam_mode"
    mode: int = Field(ge=2, le=20, description="number of the mode, from 1; more than the beam has")
    factor: float = physical(
        "1", lower=0.0, default=1.0, description="modal mass over that of the uniform beam's mode"
    )
    frequency: float = physical(
        "1", default=0.0, lower=-0.9, gt=-1.0, description="relative error of its frequency"
    )
    damping: float | None = physical(
        "1",
        default=None,
        lower=0.0,
        may_vanish=True,
        description="damping ratio; that of the beam when not given",
    )

    def moved_with(self, old: Effect, new: Effect) -> BeamMode:
        """Return it with the frequency and damping it had: they are relative to the beam's."""
        plain, moved = (b.higher_mode(self.mode) for b in (old, new))
        frequency = (1.0 + self.frequency) * plain.frequency / moved.frequency - 1.0
        damping = plain.damping if self.damping is None else self.damping
        return self.model_copy(update={"frequency": frequency, "damping": damping})

    def attach(self, assembly: Assembly) -> None:
        """Add the mode's joint and take its mass from the rigid rest.

        Raises `DescriptionError` unless the appendage is a beam that has not got the mode.
        """
        panel, beam = self.beam(assembly)
        mode = self._missing_mode(panel, beam)
        if self.factor == 0.0:
            return
        own = mode.heavier(self.factor)
        joint_model, inertia, placement, scale = mode_joint(own, beam.rigid_inertia())
        root = beam.placement
        joint = assembly.add_joint(beam.frame, joint_model, root * placement, self.name)
        assembly.add_inertia(joint, inertia)
        omega = 2 * np.pi * mode.frequency * (1.0 + self.frequency)
        damping = mode.damping if self.damping is None else self.damping
        assembly.add_springs(joint, (scale**2 * omega**2,), (2 * damping * omega * scale**2,))
        assembly.add_remainder(beam.frame, -placement.act(inertia).toDynamicParameters(), root)
        share = float(np.sqrt(self.factor))
        seen = tuple(tuple(share * scale * x for x in station) for station in mode.shape)
        assembly.appendages[assembly.appendages.index(panel)] = panel.with_mode(self.mode, joint, seen)

    def _missing_mode(self, panel: AppendageJoints, beam: BeamAppendage) -> Mode:
        if self.mode <= beam.modes or self.mode in {m.number for m in panel.more}:
            raise DescriptionError(
                f"'{beam.name}' has mode {self.mode} already.",
                advice=f"It has {beam.modes} of its own; this effect adds a higher one, once.",
                mode=self.mode,
            )
        return beam.higher_mode(self.mode)
