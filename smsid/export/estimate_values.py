"""Putting an estimate's values into a description's effects."""

from __future__ import annotations

import numpy as np

from smsid.description import Description
from smsid.effects import Effect
from smsid.effects.appendage import Appendage, ModalAppendage
from smsid.identify.appendages import as_described
from smsid.identify.estimate import Estimate


def with_estimate(description: Description, estimate: Estimate) -> tuple[Description, list[str]]:
    """Return the description with its effects at the estimate's values, and notes on what was not taken.

    A parameter that is not identifiable keeps the described value unless its 95 % interval excludes that; one
    beyond a bound goes to the bound.
    Appendages become modal ones with the identified density, frequencies and damping, but for a beam that an
    effect needs as such (`smsid.identify.appendages`).

    Raises:
        DescriptionError: a value an effect cannot have.
    """
    effects: list[Effect] = []
    panels: list[ModalAppendage] = []
    notes: list[str] = []
    for effect in description.effect:
        appendage = effect.as_appendage()
        if appendage is not None:
            panel = _appendage(description, appendage, estimate, notes)
            panels += [panel] if panel is not None else []
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
    return as_described(description.with_effects(*effects), panels), notes


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


def _appendage(
    description: Description, effect: Appendage, estimate: Estimate, notes: list[str]
) -> ModalAppendage | None:
    """Return an appendage as identified, with all its modes; ``None`` where nothing was."""
    factor = _taken(f"{effect.name}.participation_factor", 1.0, estimate, notes)
    heavy = effect.mass_parameter()
    density = None if heavy.unit == "1" else _taken(heavy.name, heavy.value, estimate, notes)
    factor = factor if density is None else density / heavy.value
    modes = {}
    described = effect.described_modes(description.effect)
    for k, mode in enumerate(described, start=1):
        for field in ("frequency", "damping"):
            name = f"{effect.name}.mode{k}.{field}"
            value = _taken(name, getattr(mode, field), estimate, notes)
            if value is not None:
                modes[name] = max(value, 0.0)
    if factor is None and not modes:
        return None
    return effect.as_modal(1.0 if factor is None else factor, described).with_values(modes)
