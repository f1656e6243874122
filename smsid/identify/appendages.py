"""Panels that other effects say something of: as the linear method takes them, and as described afterwards.

The linear method knows one kind of panel, that with modes. `linear_appendages` makes such ones: what corrects
a mode goes into it, what only a beam can have is left out. `as_described` puts what was identified back into
the effects there were, so that a beam that softens stays one.
"""

from __future__ import annotations

from collections.abc import Sequence

from smsid.description.schema import Description
from smsid.effects.appendage import ModalAppendage
from smsid.effects.base import Effect


def linear_appendages(description: Description) -> tuple[Description, list[str]]:
    """Return the description with panels as the linear method takes them, and notes on what is left out."""
    every = description.effect
    effects: list[Effect] = []
    notes: list[str] = []
    corrected = {e.part_of() for e in every if e.in_modes}
    for effect in every:
        panel = effect.as_appendage()
        if effect.needs_beam:
            why = "the linear method takes a panel by its own modes, which are linear"
            notes.append(f"'{effect.name}' ({effect.kind}) is left out: {why}")
        elif panel is not None and panel.name in corrected:
            effects.append(panel.as_modal(modes=panel.described_modes(every)))
        elif not effect.in_modes:
            effects.append(effect)
    return description.model_copy(update={"effect": tuple(effects)}), notes


def as_described(description: Description, identified: Sequence[ModalAppendage]) -> Description:
    """Return the description with appendages as identified, what corrected their modes included.

    One that an effect needs as a beam stays one, see `BeamAppendage.bent_as`.
    """
    found = {a.name: a for a in identified}
    now: dict[str, Effect] = {}
    for effect in description.effect:
        panel, of = effect.as_appendage(), effect.part_of()
        if panel is not None and effect.name in found:
            now |= {e.name: e for e in panel.identified_as(found[effect.name], description.effect)}
        elif of is None or of not in found:
            now[effect.name] = effect
        elif not effect.in_modes:
            now[effect.name] = effect.moved_with(description.get_effect(of), now[of])
    return description.model_copy(update={"effect": tuple(now.values())})
