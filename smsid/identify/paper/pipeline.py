"""From a description and recordings to an estimate: the paper's two experiments, in order."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from smsid._short_repr import short_repr
from smsid._threads import single_threaded
from smsid.description.schema import Description
from smsid.effects.appendage import Appendage, ModalAppendage
from smsid.errors import NotIdentifiableError
from smsid.identify.appendages import as_described, linear_appendages
from smsid.identify.commanded import excited_axes
from smsid.identify.estimate import Estimate, ParameterEstimate, distinct
from smsid.identify.gap_filling import LONGEST, FilledRecording, fill_gaps
from smsid.identify.modes import identified_modes
from smsid.identify.paper._exp1_described import check_moves
from smsid.identify.paper._exp1_result import TranslationResult
from smsid.identify.paper._exp2 import MomentumResult, identify_momentum
from smsid.identify.paper.exp1 import identify_translation
from smsid.identify.paper.hidden_states import Modal, check_on_bus
from smsid.identify.sensor_correction import correct_readings, on_event_clocks
from smsid.model import SpacecraftModel, build_model
from smsid.model.column_order import order_columns
from smsid.recording import Recording
from smsid.recording.checks import check_roles, consistency_notes

BRIDGED = "its interval does not count what was bridged"
"""How the note of a parameter begins that a long bridge in a recording has spoiled."""


@short_repr
@dataclass(frozen=True)
class Identification:
    """An estimate and what it was made from. ``description`` carries what Exp. 1 found."""

    estimate: Estimate
    description: Description
    translation: TranslationResult | None
    momentum: MomentumResult | None


@single_threaded
def identify(
    description: Description,
    recordings: Sequence[Recording],
    *,
    modal: Modal = "smoother",
    refine_pose_point: bool = False,
    replicates: bool = True,
) -> Identification:
    """Identify a spacecraft by the paper's method: Exp. 1 (22)-(27) and SSI-COV, then Exp. 2 (31)-(39).

    Recordings with thrust count as Exp. 1, those without as Exp. 2; the description's values are starting
    guesses only, its geometry (mounts, c_s, sensor positions, wheel axes and inertia, panel shape) is taken
    as known. ``modal``: how Exp. 2 estimates bending, see `identify_momentum`. ``refine_pose_point``: take
    the position of the pose sensor (and the IMU beside it) for a guess too, see `PosePoint`. ``replicates``:
    whether intervals come from noise added once more; a first guess needs none.

    Raises `RecordingError` for unusable recordings, `NotIdentifiableError` for recordings that cannot
    identify what is asked.
    """
    started = time.perf_counter()
    given = description
    model = described = build_model(given)  # first: effects that do not fit their panel are refused by name
    mends, doubts = _fill_recordings(description, [order_columns(r, model) for r in recordings])
    description, left_out = linear_appendages(given)
    if description != given:
        model = described = build_model(description)
    if not model.free:
        raise NotIdentifiableError(
            f"'{description.name}' is welded to the ground.",
            advice='Both experiments need root = "free".',
        )
    check_on_bus(model)
    pushed = [m.recording for m in mends if excited_axes(m.recording)]
    floating = [m.recording for m in mends if not excited_axes(m.recording)]
    for recording in floating:
        check_moves(model, recording)
    if len(floating) > 1:
        raise NotIdentifiableError(
            f"{len(floating)} recordings of Exp. 2 were given ({', '.join(r.name for r in floating)}); the "
            "linear method takes one.",
            advice="Give one recording without thrust.",
            other_flight=True,
        )
    parameters: list[ParameterEstimate] = []
    notes = left_out + doubts
    notes += [note for m in mends for note in m.notes]
    timing: dict[str, float] = {}
    conditions: dict[str, float] = {}
    translation, momentum = None, None
    if pushed:
        mark = time.perf_counter()
        try:
            translation = identify_translation(model, pushed, replicates=replicates)
        except NotIdentifiableError as error:
            raise _with_notes(error, notes) from error
        timing["Exp. 1"] = time.perf_counter() - mark
        parameters += translation.parameters
        notes += translation.notes
        conditions |= translation.conditions
    told = translation if translation and translation.believed else None
    linear = description
    if told:
        description = with_translation(linear, told)
        model = build_model(description)
    mass = told.mass if told else model.mass
    if floating:
        if not told:
            why = "Exp. 1 does not tell them" if translation else "no Exp. 1 was given"
            notes.append(f"{why}: total mass, slosh and appendages are taken from the description")
        perturbed = _perturb_exp1(linear, told) if told and replicates else []
        momentum = identify_momentum(
            model,
            floating[0],
            mass,
            modal=modal,
            perturbed=perturbed,
            described=described,
            refine=refine_pose_point,
            rate=20.0 if replicates else 10.0,
            replicates=replicates,
        )
        parameters += momentum.parameters
        notes += momentum.notes
        timing |= momentum.timing
        conditions |= momentum.conditions
    parameters = _doubt_bridged(
        parameters, [m for m in mends if excited_axes(m.recording)], ("acceleration",)
    )
    parameters = _doubt_bridged(parameters, [m for m in mends if not excited_axes(m.recording)], None)
    timing["total"] = time.perf_counter() - started
    estimate = Estimate(
        description=description.name,
        method="paper",
        parameters=tuple(parameters),
        recordings=tuple(distinct(r.name for r in recordings)),
        timing=timing,
        notes=tuple(notes),
        conditions=conditions,
    )
    panels = translation.panels if translation else {}
    return Identification(
        estimate, _to_given_description(given, linear, description, panels), translation, momentum
    )


def _to_given_description(
    given: Description, linear: Description, identified: Description, panels: Mapping[str, Appendage]
) -> Description:
    """Return the given description with what was identified in the linear one."""
    changed = [e for e in identified.effect if e not in linear.effect]
    own = {e.name for e in changed} & set(panels)
    bending = [cast(ModalAppendage, identified.get_effect(name)) for name in own]
    return as_described(given.with_effects(*(e for e in changed if e.name not in own)), bending)


def _fill_recordings(
    description: Description, recordings: Sequence[Recording]
) -> tuple[list[FilledRecording], list[str]]:
    check_roles(recordings)
    sensors = description.effective_sensors()
    corrected = [correct_readings(r, sensors) for r in recordings]
    return [fill_gaps(r, sensors) for r in corrected], consistency_notes(
        [on_event_clocks(r, sensors) for r in corrected]
    )


def _with_notes(error: NotIdentifiableError, notes: Sequence[str]) -> NotIdentifiableError:
    """Return the error with what was bridged in the recordings: that may be the reason."""
    message = "; ".join([error.message.rstrip("."), *notes]) + "."
    return NotIdentifiableError(message, advice=error.advice, **error.evidence)


def _doubt_bridged(
    parameters: Sequence[ParameterEstimate],
    mends: Sequence[FilledRecording],
    quantities: Sequence[str] | None,
) -> list[ParameterEstimate]:
    """Return the parameters, none identifiable if there is a long bridge in ``quantities`` (or any)."""
    found = max((m.longest(quantities) for m in mends), key=lambda x: x[1], default=("", 0.0))
    if found[1] <= LONGEST:
        return list(parameters)
    note = f"{BRIDGED}: {found[1]:.3g} s of {found[0]}; maximum likelihood does without the bridge"

    def doubted(p: ParameterEstimate) -> ParameterEstimate:
        if p.status == "identifiable":
            return replace(p, status="not_identifiable", note=note)
        said = BRIDGED in p.note or not np.isfinite(p.sigma)
        return p if said or p.status != "not_identifiable" else replace(p, note=f"{p.note}; {note}")

    return [doubted(p) for p in parameters]


def _perturb_exp1(linear: Description, found: TranslationResult) -> list[tuple[SpacecraftModel, float]]:
    """Model and mass moved by a standard deviation along each principal direction of Exp. 1's covariance."""
    return [
        (build_model(with_translation(linear, found, change)), found.mass + change["M"])
        for change in found.combined.directions()
    ]


def with_translation(
    description: Description, found: TranslationResult, change: Mapping[str, float] | None = None
) -> Description:
    """Return the description with slosh and appendages as Exp. 1 found them, plus a change by symbol."""
    values = found.values(change)
    effects = []
    for effect in description.effect:
        own = {k: v for k, v in values.items() if k.startswith(f"{effect.name}.")}
        panel, seen = found.panels.get(effect.name), found.modes.get(effect.name)
        factor = found.density_factor(effect.name, change)
        if own:
            effects.append(effect.with_values(own))
        elif panel is not None and (seen is not None or factor != 1.0):
            effects.append(identified_modes(panel, factor, seen.modes.clamped if seen else ()))
    return description.with_effects(*effects)
