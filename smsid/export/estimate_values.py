"""Putting an estimate's values into a description's effects."""

from __future__ import annotations

import numpy as np

from smsid.description import Description
from smsid.effects import Effect
from smsid.effects.appendage import Appendage, BeamAppendage
from smsid.identify.estimate import Estimate
from smsid.identify.identified import identified_modes


def with_estimate(description: Description, estimate: Estimate) -> tuple[Description, list[str]]:
    """Return the description with its effects at the estimate's values, and notes on what was not taken.

    A parameter that is not identifiable keeps the described value unless its 95 % interval excludes that; one
    beyond a bound goes to the bound.
    Appendages become modal ones with the identified density, frequencies and damping.

    Raises:
        DescriptionError: a value an effect cannot have.
    """
    effects: list[Effect] = []
    notes: list[str] = []
    for effect in description.effect:
        if isinstance(effect, Appendage):
            effects.append(_appendage(effect, estimate, notes))
            continue
        own = {}
        for p in effect.parameters():
            value = _taken(p.name, p.value, estimate, notes)
            if value is None:
                continue
            own[p.name] = float(np.clip(value, p.lower, p.upper))
            if own[p.name] != value:
                notes.append(f"{p.name} = {value:.4g} {p.unit} is beyond its bound: {own[p.name]:g}")
        effects.append(effect.with_values(own) if own else effect)
    return description.with_effects(*effects), notes


def _taken(name: str, described: float, estimate: Estimate, notes: list[str]) -> float | None:
    if name not in estimate:
        return None
    found = estimate[name]
    low, high = found.interval
    # written so that what is not finite counts as within
    if found.status == "not_identifiable" and not (described < low or described > high):
        notes.append(f"{name} is not identifiable and stays as described")
        return None
    return found.value


def _appendage(effect: Appendage, estimate: Estimate, notes: list[str]) -> Appendage:
    factor = _taken(f"{effect.name}.participation_factor", 1.0, estimate, notes)
    if isinstance(effect, BeamAppendage):
        described = effect.linear_density
        density = _taken(f"{effect.name}.linear_density", described, estimate, notes)
        factor = factor if density is None else density / described
    modes = {}
    for k, mode in enumerate(effect.modal_data(), start=1):
        for field in ("frequency", "damping"):
            name = f"{effect.name}.mode{k}.{field}"
            value = _taken(name, getattr(mode, field), estimate, notes)
            if value is not None:
                modes[name] = max(value, 0.0)
    if factor is None and not modes:
        return effect
    return identified_modes(effect, 1.0 if factor is None else factor, ()).with_values(modes)
