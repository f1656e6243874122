"""One way in: a spacecraft from its recordings, by the likelihood that suits them."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from smsid.description.schema import Description
from smsid.errors import NotIdentifiableError, RecordingError, SmsidError
from smsid.estimation._batch_check import (
    batch_contradictions,
    batch_quality,
    channels_left,
    contradictions_one_by_one,
)
from smsid.estimation._contradictions import Contradiction, contradiction_error
from smsid.estimation.fit_quality import FitQuality
from smsid.identify.commanded import excited_axes
from smsid.identify.estimate import Estimate, ParameterEstimate
from smsid.identify.paper.pipeline import Identification
from smsid.identify.paper.pipeline import identify as by_the_paper
from smsid.identify.robust import white_sigma
from smsid.identify.sensor_correction import without_known_errors
from smsid.likelihood.channels import BIASED
from smsid.likelihood.fit import ConvergenceError
from smsid.likelihood.prior import Cad
from smsid.likelihood.refine import Refinement, refine
from smsid.recording import Recording
from smsid.recording.attitude import turn_between
from smsid.recording.checks import consistency_notes

if TYPE_CHECKING:
    from smsid.estimation.flight import FlightOptions
    from smsid.estimation.identify_flights import FlightEstimate

LOGGER = logging.getLogger(__name__)
TURN_PARTS = 20  # parts of a recording whose median attitudes are compared
TURN_SIGMAS = 5.0  # of a reading's noise, by which these differ at most where an attitude is held
UNTURNED = 1e-6  # [rad] that nobody holds an attitude better
BEGINNING = 30_000  # samples of the slowest sensor of a long flight that the search starts with

Method = Literal["ml", "filter", "paper"]


@dataclass(frozen=True)
class IdentificationRun:
    """An estimate and what it was made by.

    ``linear`` is the paper's method, ``refined`` the batch likelihood started from it, ``flights`` the
    filter's; ``reason`` says why the filter was taken. ``quality`` and ``contradictions`` are the verdict on
    the fit (``None``: the paper's method alone has none).
    """

    estimate: Estimate
    linear: Identification | None = None
    refined: Refinement | None = None
    flights: FlightEstimate | None = None
    reason: str = ""
    quality: FitQuality | None = None
    contradictions: tuple[Contradiction, ...] = ()


def identify_spacecraft(
    description: Description,
    recordings: Sequence[Recording],
    *,
    method: Method = "ml",
    cad: Cad | None = None,
    options: FlightOptions | None = None,
    tell: Callable[[str], None] | None = None,
) -> IdentificationRun:
    """Identify a free-flying spacecraft from any flights.

    With ``ml``, flights like the paper's two experiments, from rest, go the fast way: its linear method,
    refined by the batch likelihood. Everything else goes through the filter: other effects listed, moving
    starts, thrust with the attitude free, missing channels. ``filter`` takes that way in any case, ``paper``
    the linear method alone.

    Args:
        description: its values are the first guess, its priors what is known beforehand.
        recordings: in the role estimation.
        method: as above.
        cad: what is known of rigid bodies, as in `smsid.likelihood.refine`.
        options: how the filter takes recordings.
        tell: hears lines of progress.

    Raises:
        RecordingError: single thrusters fire, and the paper's method is asked for.
        NotIdentifiableError: the search does not come to rest; columns that may be wrong are in the advice.
        SmsidError: there is no such method, or what `identify_flights` raises.
    """
    if method not in ("ml", "filter", "paper"):
        raise SmsidError(f"There is no method '{method}'.", advice="Use ml, filter or paper.")
    alone = [r.name for r in recordings if _single_thrusters(r)]
    if method == "paper":
        if alone:
            raise RecordingError(
                f"'{alone[0]}' is flown with single thrusters, which the paper's method does not know.",
                advice="Use --method ml.",
            )
        return identify_by_the_paper(description, recordings)
    sensors = description.effective_sensors()
    doubts = consistency_notes([without_known_errors(r, sensors) for r in recordings])
    reason = (
        "asked for"
        if method == "filter"
        else _filter_only_effects(description) or _filter_only_errors(description, recordings)
    )
    if alone and not reason:
        reason = "single thrusters fire"
    if not reason and options is not None and options != type(options)():
        reason = "options of a flight were given"
    reason = reason or next(filter(None, map(_turned_while_pushed, recordings)), "")
    if not reason:
        try:
            return _batch(description, recordings, cad, tell, doubts)
        except (RecordingError, NotIdentifiableError) as error:
            if error.evidence.get("marginal"):  # the filter keeps what is clear, and marks the rest
                reason = f"the paper's method cannot separate all that is there: {error.message}"
            elif error.evidence.get("other_flight"):
                reason = f"the paper's method does not apply: {error.message}"
            elif "contradictions" in error.evidence or error.evidence.get("unexcited"):
                # each is explained by itself, or nothing moves: no column is wrong
                raise
            else:  # they are bad, not of another kind
                raise _with_wrong_columns(error, description, recordings) from None
    if tell is not None:
        tell(f"taken as flights: {reason}")
    from smsid.estimation.identify_flights import identify_flights  # the filter takes time to load

    try:
        found = identify_flights(description, recordings, cad=cad, options=options, tell=tell)
    except NotIdentifiableError as error:
        if "contradictions" in error.evidence:
            raise
        raise _with_wrong_columns(error, description, recordings) from None
    wrong = _better_columns(description, recordings, found.quality.judgement == "not explained")
    first = found.estimate.notes[0], *wrong
    notes = (*first, f"taken as flights of any kind: {reason}", *found.estimate.notes[1:])
    estimate = replace(found.estimate, notes=notes)
    return IdentificationRun(estimate, None, None, found, reason, found.quality, found.contradictions)


def identify_by_the_paper(
    description: Description,
    recordings: Sequence[Recording],
    *,
    printed: bool = False,
    find_point: bool = False,
) -> IdentificationRun:
    """Return what the linear method finds, bending as ``printed``, the tracked point unknown to
    ``find_point``; it has no verdict on the fit, but columns that seem to be wrong are named.
    """
    from smsid.estimation._mapping_check import follows

    modal = "printed" if printed else "smoother"
    linear = by_the_paper(description, recordings, modal=modal, refine_pose_point=find_point)
    unlike = [r for r in map(_first_samples, recordings) if not follows(description, r)]
    wrong = _better_columns(description, unlike, bool(unlike))
    estimate = linear.estimate
    if wrong:
        parameters = tuple(_not_identifiable(p, "columns seem to be wrong") for p in estimate.parameters)
        estimate = replace(estimate, parameters=parameters, notes=(*wrong, *estimate.notes))
    return IdentificationRun(estimate, linear)


def _not_identifiable(p: ParameterEstimate, reason: str) -> ParameterEstimate:
    return replace(p, status="not_identifiable", note=reason) if p.status == "identifiable" else p


def _with_wrong_columns(
    error: SmsidError, description: Description, recordings: Sequence[Recording]
) -> SmsidError:
    """Return the error of a search without rest, with the columns that may be wrong and what was left where
    it stopped; another one as it is.
    """
    wrong = _better_columns(description, recordings, isinstance(error, NotIdentifiableError))
    left = []
    if isinstance(error, ConvergenceError) and error.seen is not None:
        channels = channels_left(error.pieces, error.seen.residuals)
        left = [f"Where it stopped: {FitQuality(channels, 1.0, None).sentence}"]
    advice = " ".join([*(f"{w}." for w in wrong), *left, error.advice])
    return NotIdentifiableError(error.message, advice=advice, **error.evidence) if wrong or left else error


def _better_columns(description: Description, recordings: Sequence[Recording], bad: bool) -> list[str]:
    """Return which columns may be wrong where a fit is ``bad``."""
    if not bad:
        return []
    from smsid.estimation._mapping_check import wrong_columns

    return wrong_columns(description, [_first_samples(r) for r in recordings])


def _turned_while_pushed(recording: Recording) -> str:
    """Return that the attitude is not held under thrust, which the batch takes it for, by more than a reading
    of it errs.
    """
    if not excited_axes(recording):
        return ""
    for channel in (c for c in recording.channels if c.partition(".")[2] == "attitude"):
        seen = np.asarray(recording[channel], dtype=float)
        seen = seen[np.isfinite(seen).all(axis=1)]
        if channel.startswith("truth.") or len(seen) < TURN_PARTS:
            continue
        turns = turn_between(np.broadcast_to(seen[0], seen.shape), seen)
        parts = np.array([np.median(p, axis=0) for p in np.array_split(turns, TURN_PARTS)])
        noise = np.asarray(white_sigma(turns)) + UNTURNED
        if (np.ptp(parts, axis=0) > TURN_SIGMAS * noise).any():
            size = float(np.linalg.norm(np.ptp(parts, axis=0)))
            return f"'{recording.name}' turns by up to {size:.3g} rad while thrust acts"
    return ""


def _single_thrusters(recording: Recording) -> bool:
    return any(c in recording for c in ("command.thruster", "command.thruster_force"))


def _filter_only_effects(description: Description) -> str:
    """Return which effects only the filter estimates, if there are any."""
    others = [e.name for e in description.effect if not e.by_batch and e.unknowns()]
    return f"parameters of {', '.join(others)} are to be estimated" if others else ""


def _filter_only_errors(description: Description, recordings: Sequence[Recording]) -> str:
    """Return which errors of sensors, as stated, only the filter takes into account, if there are any."""
    present = {c for r in recordings for c in r.channels}
    found = []
    for sensor in description.effective_sensors():
        for quantity, channel in zip(sensor.quantities, sensor.channels, strict=True):
            terms = ["random_walk", "bias_instability", "scale_sigma", "misalignment_sigma"]
            terms += [] if sensor.kind == "pose" or quantity in BIASED else ["bias_sigma"]
            named = [t for t in terms if np.any(getattr(sensor.error(quantity), t))]
            found += [f"{t} of {channel}" for t in named if channel in present]
    return f"{', '.join(found)} {'is' if len(found) == 1 else 'are'} stated" if found else ""


def _starting_point(
    description: Description, recordings: Sequence[Recording], cad: Cad | None
) -> tuple[Identification, Identification | Refinement]:
    """Return the paper's result and where to start from: for long flights, what their beginnings tell."""
    first = [_first_samples(r) for r in recordings]
    few = _of_one_kind_each(recordings)
    if any(a is not b for a, b in zip(first, recordings, strict=True)):
        try:
            linear = by_the_paper(description, _of_one_kind_each(first), replicates=False)
            return linear, refine(description, first, linear, cad=cad)
        except SmsidError as error:
            LOGGER.info("the beginnings of the flights do not tell enough: %s", error)
    linear = by_the_paper(description, few, replicates=False)
    return linear, linear


def _of_one_kind_each(recordings: Sequence[Recording]) -> list[Recording]:
    """Return the recordings that the paper's method takes: of those without thrust the first."""
    floating = [r for r in recordings if not excited_axes(r)]
    return [r for r in recordings if r not in floating[1:]]


def _first_samples(recording: Recording) -> Recording:
    """Return the first samples of a long flight without thrust, or the recording as it is."""
    clocks = [recording.time(c) for c in recording.channels if not c.startswith(("command.", "truth."))]
    few = min(clocks, key=len, default=[])
    if excited_axes(recording) or len(few) < 2 * BEGINNING:
        return recording
    return recording.window(float(few[0]), float(few[BEGINNING]))


def _batch(
    description: Description,
    recordings: Sequence[Recording],
    cad: Cad | None,
    tell: Callable[[str], None] | None,
    doubts: Sequence[str],
) -> IdentificationRun:
    linear, start = _starting_point(description, recordings, cad)
    if tell is not None:
        tell("refining by maximum likelihood")
    try:
        refined = refine(description, recordings, start, cad=cad, of_parts=isinstance(start, Refinement))
    except ConvergenceError:
        several = len(recordings) > 1
        disagree = contradictions_one_by_one(description, recordings, cad, tell) if several else ()
        if disagree:
            raise contradiction_error(disagree) from None
        raise
    quality, disagree = batch_quality(refined), batch_contradictions(refined)
    estimate = refined.estimate
    if quality.judgement == "not explained":
        parameters = tuple(_not_identifiable(p, quality.reason) for p in estimate.parameters)
        estimate = replace(estimate, parameters=parameters)
        if disagree:  # far from both there is no straight line from what is common to each by itself
            disagree = contradictions_one_by_one(description, recordings, cad, tell) or disagree
    wrong = _better_columns(description, recordings, quality.judgement == "not explained")
    notes = (quality.sentence, *wrong, *(c.sentence for c in disagree), *doubts, *estimate.notes)
    estimate = replace(estimate, notes=notes)
    return IdentificationRun(estimate, linear, refined, None, "", quality, disagree)
