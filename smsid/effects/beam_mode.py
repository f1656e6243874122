"""A bending mode that the description of a beam leaves out."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import Field

from smsid.effects.appendage import BeamAppendage, Mode, mode_joint
from smsid.effects.appendage_drift import attached_appendage
from smsid.effects.base import Effect, physical, register
from smsid.errors import DescriptionError

if TYPE_CHECKING:
    from smsid.effects.assembly import AppendageJoints, Assembly


@register
class BeamMode(Effect):
    """Mode ``mode`` of a `beam_appendage` that has fewer: ``factor`` 1 is that of the uniform beam.

    With factor f its participation factors and its shape at the stations are sqrt(f) times the beam's, its
    frequency is ``1 + frequency`` times theirs. The mass is taken out of the rigid rest. With f = 1 and
    nothing else given this is the beam with one mode more.
    """

    summary: ClassVar[str] = "a higher bending mode of a beam appendage, which its stations see"
    nominal: ClassVar[bool] = True
    family: ClassVar[str] = "appendage"
    aliases: ClassVar[tuple[str, ...]] = ("extra_mode", "slosh", "frequency_drift")
    strength: ClassVar[tuple[str, ...]] = ("factor",)
    kind: Literal["beam_mode"] = "beam_mode"
    appendage: str = Field(description="name of a `beam_appendage`, which stands before this effect")
    mode: int = Field(ge=2, le=20, description="number of the mode, from 1; more than the beam has")
    factor: float = physical(
        "1", lower=0.0, default=1.0, description="modal mass over that of the uniform beam's mode"
    )
    frequency: float = physical(
        "1", default=0.0, lower=-0.9, gt=-1.0, description="relative error of its frequency"
    )
    damping: float | None = physical(
        "1", default=None, lower=0.0, description="damping ratio; that of the beam when not given"
    )

    def attach(self, assembly: Assembly) -> None:
        """Add the mode's joint and take its mass from the rigid rest.

        Raises `DescriptionError` unless the appendage is a beam that has not got the mode.
        """
        panel = attached_appendage(assembly, self.appendage)
        mode = missing_mode(panel, self.mode)
        if self.factor == 0.0:
            return
        beam, share = panel.appendage, float(np.sqrt(self.factor))
        own = mode.model_copy(
            update={
                "translation": tuple(share * x for x in mode.translation),
                "rotation": tuple(share * x for x in mode.rotation),
            }
        )
        joint_model, inertia, placement, scale = mode_joint(own, beam.rigid_inertia())
        root = beam.placement
        joint = assembly.add_joint(beam.frame, joint_model, root * placement, self.name)
        assembly.add_inertia(joint, inertia)
        omega = 2 * np.pi * mode.frequency * (1.0 + self.frequency)
        damping = mode.damping if self.damping is None else self.damping
        assembly.add_springs(joint, (scale**2 * omega**2,), (2 * damping * omega * scale**2,))
        assembly.add_remainder(beam.frame, -placement.act(inertia).toDynamicParameters(), root)
        seen = tuple(tuple(share * scale * x for x in station) for station in mode.shape)
        assembly.appendages[assembly.appendages.index(panel)] = panel.with_mode(self.mode, joint, seen)


def missing_mode(panel: AppendageJoints, number: int) -> Mode:
    """Return a mode that a beam does not have, by number from 1.

    Raises `DescriptionError` for an appendage that is no beam, and for a mode that it has.
    """
    beam = panel.appendage
    if not isinstance(beam, BeamAppendage):
        raise DescriptionError(
            f"'{beam.name}' is no beam_appendage, so its higher modes are not known.",
            advice="Use `extra_mode`, or describe the appendage as a beam.",
        )
    if number <= beam.modes or number in {m.number for m in panel.more}:
        raise DescriptionError(
            f"'{beam.name}' has mode {number} already.",
            advice=f"It has {beam.modes} of its own; this effect adds a higher one, once.",
            mode=number,
        )
    return beam.model_copy(update={"modes": number}).modal_data()[-1]
