"""Panels that other effects say something of: as the linear method takes them, and as described afterwards.

The linear method knows one kind of panel, that with modes. `linear_appendages` makes such ones: what corrects
a mode goes into it, what only a beam can have is left out. `as_described` puts what was identified back into
the effects there were, so that a beam that softens stays one.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from smsid.description.schema import Description
from smsid.effects.appendage import Appendage, BeamAppendage, ModalAppendage, Mode
from smsid.effects.base import Effect
from smsid.effects.beam_mode import BeamMode
from smsid.effects.geometric_stiffness import GeometricStiffness
from smsid.effects.mode_error import ModeError
from smsid.errors import DescriptionError
from smsid.identify.identified import identified_modes

E = TypeVar("E", bound=Effect)
BEAMS_ONLY = {  # effects that no other appendage can have, and why the linear method leaves them out
    BeamMode: "the linear method takes the panel's own modes for all",
    GeometricStiffness: "the linear method takes panels for linear",
}


def described_modes(description: Description, appendage: Appendage) -> tuple[Mode, ...]:
    """Return an appendage's modes with what `mode_error` effects of a description correct.

    Springs and dampers of several errors of one mode add up, as in the simulation.

    Raises:
        DescriptionError: an error of a mode that the appendage does not have.
    """
    modes = list(appendage.modal_data())
    plain = tuple(modes)
    springs, dampers = [1.0] * len(modes), [m.damping for m in modes]  # in those of the appendage's frequency
    for error in _of(description, appendage, ModeError):
        if error.mode > len(modes):
            raise DescriptionError(
                f"'{appendage.name}' has {len(modes)} modes of its own, not {error.mode}.",
                advice="What a further mode is off by is its own `frequency` and `damping`.",
                effect=error.name,
            )
        k, grown = error.mode - 1, 1.0 + error.frequency
        springs[k] += grown**2 - 1.0
        dampers[k] += (plain[k].damping + error.damping) * grown - plain[k].damping
        share = float(np.sqrt(max(springs[k], 0.0)))
        update = {"frequency": plain[k].frequency * share, "damping": max(dampers[k] / share, 0.0)}
        modes[k] = plain[k].model_copy(update=update)
    return tuple(modes)


def linear_appendages(description: Description) -> tuple[Description, list[str]]:
    """Return the description with panels as the linear method takes them, and notes on what is left out."""
    effects: list[Effect] = []
    notes: list[str] = []
    for effect in description.effect:
        if type(effect) in BEAMS_ONLY:
            notes.append(f"'{effect.name}' ({effect.kind}) is left out: {BEAMS_ONLY[type(effect)]}")
        elif isinstance(effect, Appendage) and _of(description, effect, ModeError):
            effects.append(identified_modes(effect, 1.0, (), described_modes(description, effect)))
        elif not isinstance(effect, ModeError):
            effects.append(effect)
    return description.model_copy(update={"effect": tuple(effects)}), notes


def as_described(description: Description, identified: Sequence[ModalAppendage]) -> Description:
    """Return the description with appendages as identified, what corrected their modes included.

    One that an effect needs as a beam stays one, see `as_beam`.
    """
    found = {a.name: a for a in identified}
    effects: list[Effect] = []
    for effect in description.effect:
        mine = found.get(effect.name)
        if (
            isinstance(effect, BeamAppendage)
            and mine
            and any(_of(description, effect, k) for k in BEAMS_ONLY)
        ):
            effects += as_beam(effect, mine)
        elif mine is not None:
            effects.append(mine)
        elif isinstance(effect, BeamMode) and effect.appendage in found:
            effects.append(_as_before(effect, description, effects))
        elif not (isinstance(effect, ModeError) and effect.appendage in found):
            effects.append(effect)
    return description.model_copy(update={"effect": tuple(effects)})


def as_beam(beam: BeamAppendage, identified: Appendage) -> list[Effect]:
    """Return a beam that bends as an identified appendage does: the beam, and the errors of its modes.

    It has the identified density, Young's modulus from the first mode's frequency and that mode's damping;
    what the other modes are off by then are `mode_error` effects.
    """
    modes = identified.modal_data()
    factor = identified.rigid_inertia().mass / beam.mass
    stiffer = factor * (modes[0].frequency / beam.modal_data()[0].frequency) ** 2
    own = beam.model_copy(
        update={
            "density": beam.density * factor,
            "youngs_modulus": beam.youngs_modulus * stiffer,
            "damping": modes[0].damping,
        }
    )
    out: list[Effect] = [own]
    for k, (mode, plain) in enumerate(zip(modes, own.modal_data(), strict=True), start=1):
        off = mode.frequency / plain.frequency - 1.0, mode.damping - plain.damping
        if k > 1 and any(off):
            name = re.sub(r"\W+", "_", f"mode_error_{beam.name}_{k}")  # that of a diagnosis, which goes on
            out.append(ModeError(name=name, appendage=beam.name, mode=k, frequency=off[0], damping=off[1]))
    return out


def _as_before(effect: BeamMode, description: Description, identified: Sequence[Effect]) -> BeamMode:
    """Return a further mode with the frequency and damping it had: what they are relative to has moved."""
    old, new = (
        next(e for e in effects if isinstance(e, BeamAppendage) and e.name == effect.appendage)
        for effects in (description.effect, identified)
    )
    plain, moved = (b.model_copy(update={"modes": effect.mode}).modal_data()[-1] for b in (old, new))
    frequency = (1.0 + effect.frequency) * plain.frequency / moved.frequency - 1.0
    damping = plain.damping if effect.damping is None else effect.damping
    return effect.model_copy(update={"frequency": frequency, "damping": damping})


def _of(description: Description, appendage: Appendage, kind: type[E]) -> list[E]:
    """Return the effects of a kind that name an appendage, in the description's order."""
    of = [e for e in description.effect if getattr(e, "appendage", None) == appendage.name]
    return [e for e in of if isinstance(e, kind)]
