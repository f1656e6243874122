"""From a description and recordings to an estimate: the paper's two experiments, in order."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from smsid.description.schema import Description
from smsid.errors import NotIdentifiableError, RecordingError
from smsid.identify.estimate import Estimate, ParameterEstimate
from smsid.identify.exp1 import TranslationResult, excited_axes, identify_translation
from smsid.identify.exp2 import MomentumResult, identified_modes, identify_momentum
from smsid.model import build_model
from smsid.recording import Recording


@dataclass(frozen=True)
class Identification:
    """An estimate and what it was made from. ``description`` carries what Exp. 1 found."""

    estimate: Estimate
    description: Description
    translation: TranslationResult | None
    momentum: MomentumResult | None


def identify(
    description: Description,
    recordings: Sequence[Recording],
    *,
    modal: str = "smoother",
) -> Identification:
    """Identify a spacecraft by the paper's method: Exp. 1 (22)-(27) and SSI-COV, then Exp. 2 (31)-(39).

    Recordings with thrust count as Exp. 1, those without as Exp. 2; the description's values are starting guesses
    only, its geometry (mounts, c_s, sensor positions, wheel axes and inertia, panel shape) is taken as known.
    Raises `RecordingError` for unusable recordings, `NotIdentifiableError` for recordings that cannot identify
    what is asked.
    """
    started = time.perf_counter()
    if not recordings:
        raise RecordingError("No recording was given.", advice="Give recordings of Exp. 1 and Exp. 2.")
    for recording in recordings:
        if recording.role == "validation":
            raise RecordingError(
                f"'{recording.name}' is for validation.", advice="Identify from recordings in the role estimation."
            )
        recording.check()
    model = build_model(description)
    pushed = [r for r in recordings if excited_axes(r)]
    floating = [r for r in recordings if not excited_axes(r)]
    parameters: list[ParameterEstimate] = []
    notes: list[str] = []
    timing: dict[str, float] = {}
    conditions: dict[str, float] = {}
    translation, momentum = None, None
    if pushed:
        mark = time.perf_counter()
        translation = identify_translation(model, pushed)
        timing["Exp. 1"] = time.perf_counter() - mark
        parameters += translation.parameters
        notes += translation.notes
        conditions |= translation.conditions
        description = with_translation(description, translation)
        model = build_model(description)
    mass = translation.mass[0] if translation else model.mass
    if floating:
        if not translation:
            notes.append("no Exp. 1 was given: total mass, slosh and appendages are taken from the description")
        if len(floating) > 1:
            raise NotIdentifiableError(
                f"{len(floating)} recordings of Exp. 2 were given; the linear method takes one.",
                advice="Give one recording without thrust.",
            )
        momentum = identify_momentum(model, floating[0], mass, modal=modal)
        parameters += momentum.parameters
        notes += momentum.notes
        timing |= momentum.timing
        conditions |= momentum.conditions
    timing["total"] = time.perf_counter() - started
    estimate = Estimate(
        description=description.name,
        method="paper",
        parameters=tuple(parameters),
        recordings=tuple(r.name for r in recordings),
        timing=timing,
        notes=tuple(notes),
        conditions=conditions,
    )
    return Identification(estimate, description, translation, momentum)


def with_translation(description: Description, found: TranslationResult) -> Description:
    """Return the description with slosh and appendages as Exp. 1 found them."""
    effects = []
    for effect in description.effect:
        values = {k: v for k, v in found.values.items() if k.startswith(f"{effect.name}.") and np.isfinite(v)}
        if values:
            effects.append(effect.with_values(values))
        elif hasattr(effect, "modal_data") and (effect.name in found.modes or found.density_factor != 1.0):
            panel = found.modes.get(effect.name)
            effects.append(identified_modes(effect, found.density_factor, panel.clamped if panel else ()))
    return description.with_effects(*effects)
