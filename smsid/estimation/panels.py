"""Panels as they are estimated: beams by the frequency and damping of every mode, and by their density."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from smsid.description.schema import Description
from smsid.effects.appendage import BeamAppendage, ModalAppendage
from smsid.effects.base import Effect
from smsid.identify.appendages import BEAMS_ONLY, described_modes
from smsid.identify.identified import identified_modes

WIDE = 10.0  # standard deviation of a density without a prior, relative to the described one


class BeamModes(ModalAppendage):
    """A beam's modes whose participation factor is its density: the whole panel is heavier with it."""

    def rigid_inertia(self) -> pin.Inertia:
        """Return the rigid inertia (about its CM, lever from the root) at the density there is."""
        return scaled_inertia(super().rigid_inertia(), self.participation_factor)

    def plain(self) -> ModalAppendage:
        """Return modal data that say the same without a factor."""
        return identified_modes(self, 1.0, ()).model_copy(update={"prior": {}, "known": self.known})


def scaled_inertia(inertia: pin.Inertia, factor: float) -> pin.Inertia:
    """Return the inertia of a body ``factor`` times as dense."""
    return pin.Inertia(factor * inertia.mass, inertia.lever, factor * inertia.inertia)


def plain_panels(description: Description) -> Description:
    """Return the description with its panels as modal data anyone can read."""
    effects = tuple(e.plain() if isinstance(e, BeamModes) else e for e in description.effect)
    return description.model_copy(update={"effect": effects})


def modal_panels(description: Description) -> tuple[Description, dict[str, tuple[str, float]]]:
    """Return the description with beams as modal data, and what their participation factors stand for.

    Density, Young's modulus and damping are then the participation factor and each mode's frequency and
    damping: a real panel is not quite a beam. What corrects single modes goes into them. Beams that another
    effect needs as beams stay beams. The second value gives name and size of the linear density [kg/m] by the
    name of the factor.
    """
    beams = {e.name: e for e in description.effect if isinstance(e, BeamAppendage)}
    for effect in description.effect:
        if type(effect) in BEAMS_ONLY:
            beams.pop(str(getattr(effect, "appendage", "")), None)
    effects: list[Effect] = []
    densities: dict[str, tuple[str, float]] = {}
    for effect in description.effect:
        beam = beams.get(effect.name)
        if beam is not None:
            effects.append(_modal(description, beam))
            densities[f"{beam.name}.participation_factor"] = (
                f"{beam.name}.linear_density",
                beam.linear_density,
            )
        elif str(getattr(effect, "appendage", "")) not in beams or effect.kind != "mode_error":
            effects.append(effect)
    return description.model_copy(update={"effect": tuple(effects)}), densities


def _modal(description: Description, beam: BeamAppendage) -> BeamModes:
    panel = identified_modes(beam, 1.0, (), described_modes(description, beam))
    prior: dict[str, float] = {}
    density = beam.prior.get("density")
    prior["participation_factor"] = WIDE if density is None else density / beam.density
    stiffness = beam.prior.get("youngs_modulus")
    modes = range(1, len(panel.mode) + 1)
    for k, mode in zip(modes, panel.mode, strict=True):
        if stiffness is not None:
            relative = 0.5 * float(np.hypot(stiffness / beam.youngs_modulus, prior["participation_factor"]))
            prior[f"mode{k}.frequency"] = relative * mode.frequency
        if "damping" in beam.prior:
            prior[f"mode{k}.damping"] = beam.prior["damping"]
    known = ["mass", *(f"mode{k}.{x}" for k in modes for x in ("translation", "rotation"))]
    if "all" in beam.known:
        known = ["all"]
    elif beam.known:
        known += ["participation_factor"] if "density" in beam.known else []
        known += [f"mode{k}.frequency" for k in modes] if "youngs_modulus" in beam.known else []
        known += [f"mode{k}.damping" for k in modes] if "damping" in beam.known else []
    return BeamModes.model_construct(**{**dict(panel), "prior": prior, "known": tuple(known)})
