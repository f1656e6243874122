"""An estimate's values in a description whose beams stay beams: what bends is known by its shape, too."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from smsid.description.schema import Description
from smsid.effects.base import Effect
from smsid.export.bodies import with_estimate
from smsid.identify.estimate import Estimate


def with_beams(description: Description, estimate: Estimate) -> tuple[Description, list[str], set[str]]:
    """Return `with_estimate` with beams as beams, its notes, and the names whose prior is the estimate's.

    Modal data would have the same frequencies and dampings as `Appendage.bent_as` has, but could no longer
    soften as a beam does. How well these are known goes with the beam and the errors of its modes.
    """
    found, notes = with_estimate(description, estimate)
    panels = (e.as_appendage() for e in description.effect)
    beams = {p.name: p for p in panels if p is not None and p.higher_mode(1) is not None}
    effects: list[Effect] = []
    known, told = set[str](), set[str]()  # of parameters, of beams

    def sigma(name: str) -> float:
        return float(estimate[name].sigma) if name in estimate else np.nan

    def relative(name: str) -> float:
        return sigma(name) / abs(estimate[name].value) if name in estimate else np.nan

    for effect in found.effect:
        identified, beam = effect.as_appendage(), beams.get(effect.name)
        if beam is not None and any(p.name.startswith(f"{beam.name}.") for p in estimate.parameters):
            told.add(beam.name)
        parts: Sequence[Effect] = (effect,)
        if beam is not None and identified is not None and effect.kind != beam.kind:
            parts = beam.bent_as(identified)
        for part in parts:
            own = part.estimated_sigmas(sigma, relative) if told & {part.name, part.part_of()} else {}
            prior = {k: float(v) for k, v in own.items() if np.isfinite(v) and v > 0.0}
            known |= {f"{part.name}.{key}" for key in prior if key not in part.prior}
            effects.append(part.model_copy(update={"prior": {**part.prior, **prior}}) if prior else part)
    return found.model_copy(update={"effect": tuple(effects)}), notes, known
