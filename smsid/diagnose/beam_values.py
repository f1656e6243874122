"""An estimate's values in a description whose beams stay beams: what bends is known by its shape, too."""

from __future__ import annotations

from typing import cast

import numpy as np

from smsid.description.schema import Description
from smsid.effects.appendage import Appendage, BeamAppendage
from smsid.effects.appendage_effect import ModeError
from smsid.effects.base import Effect
from smsid.export.bodies import with_estimate
from smsid.identify.appendages import as_beam
from smsid.identify.estimate import Estimate


def with_beams(description: Description, estimate: Estimate) -> tuple[Description, list[str], set[str]]:
    """Return `with_estimate` with beams as beams, its notes, and the names whose prior is the estimate's.

    Modal data would have the same frequencies and dampings as `as_beam` has, but could no longer soften as a
    beam does. How well these are known goes with the beam and the errors of its modes.
    """
    found, notes = with_estimate(description, estimate)
    described = {e.name: e for e in description.effect}
    beams: set[str] = set()
    parts: list[Effect] = []
    for effect in found.effect:
        beam = described.get(effect.name)
        if beam is None or beam.kind != "beam_appendage":
            parts.append(effect)
            continue
        if any(p.name.startswith(f"{beam.name}.") for p in estimate.parameters):
            beams.add(beam.name)
        same = effect.kind == beam.kind
        parts += [effect] if same else as_beam(cast(BeamAppendage, beam), cast(Appendage, effect))
    effects: list[Effect] = []
    known: set[str] = set()
    for effect in parts:
        told: dict[str, float] = {}
        if effect.name in beams:
            told = _of_beam(cast(BeamAppendage, effect), estimate)
        elif effect.kind == "mode_error" and getattr(effect, "appendage", "") in beams:
            told = _of_mode(cast(ModeError, effect), estimate)
        prior = {k: float(v) for k, v in told.items() if np.isfinite(v) and v > 0.0}
        known |= {f"{effect.name}.{key}" for key in prior if key not in effect.prior}
        effects.append(effect.model_copy(update={"prior": {**effect.prior, **prior}}) if prior else effect)
    return found.model_copy(update={"effect": tuple(effects)}), notes, known


def _of_beam(beam: BeamAppendage, estimate: Estimate) -> dict[str, float]:
    """Return the standard deviations of a beam's parameters."""
    # the linear method calls it so where effects correct the beam's modes
    names = [f"{beam.name}.{key}" for key in ("linear_density", "participation_factor")]
    density = next((_relative(estimate, name) for name in names if name in estimate), np.nan)
    return {
        "density": density * beam.density,
        "damping": _sigma(estimate, f"{beam.name}.mode1.damping"),
        "youngs_modulus": beam.youngs_modulus
        * np.hypot(density, 2.0 * _relative(estimate, f"{beam.name}.mode1.frequency")),
    }


def _of_mode(error: ModeError, estimate: Estimate) -> dict[str, float]:
    """Return the standard deviations of a mode's errors: what the first mode, the beam's, is off by is in
    them, too.
    """
    first, own = (f"{error.appendage}.mode{k}" for k in (1, error.mode))
    frequency = [_relative(estimate, f"{m}.frequency") for m in (first, own)]
    damping = [_sigma(estimate, f"{m}.damping") for m in (first, own)]
    return {
        "frequency": (1.0 + error.frequency) * float(np.linalg.norm(frequency)),
        "damping": float(np.linalg.norm(damping)),
    }


def _sigma(estimate: Estimate, name: str) -> float:
    return float(estimate[name].sigma) if name in estimate else np.nan


def _relative(estimate: Estimate, name: str) -> float:
    return _sigma(estimate, name) / abs(estimate[name].value) if name in estimate else np.nan
