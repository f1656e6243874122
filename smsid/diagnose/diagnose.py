"""The whole diagnosis: from a description and recordings to a verdict, and the extended description."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from threadpoolctl import threadpool_limits

from smsid._short_repr import short_repr
from smsid.description.schema import Description
from smsid.diagnose._extended_description import extended_point, with_inertial_shifts
from smsid.diagnose._hidden_start import (
    likelier_start,
    rest_is_likelier,
    start_beside_causes,
    with_likely_start,
)
from smsid.diagnose._hold_rivals import as_inputs_act
from smsid.diagnose._noise_covariance import FOLLOWED
from smsid.diagnose._open_loop import unexplained_fraction
from smsid.diagnose._outliers import of_white_components, outliers, recount_outliers
from smsid.diagnose._profile_intervals import with_profile_intervals
from smsid.diagnose._sensor_faults import (
    Fault,
    drop_samples,
    inflate_for_quantisation,
    quantised_channels,
    resting_channels,
    stuck_channels,
)
from smsid.diagnose._standing_causes import find_standing_causes
from smsid.diagnose.hypotheses import propose
from smsid.diagnose.priors import nominal
from smsid.diagnose.result import Diagnosis, FoundCause, Value
from smsid.diagnose.specification_tests import PAST, open_joints
from smsid.diagnose.stepwise import Search, search
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.diagnose.torque import diagnose_torques, torques_were_measured
from smsid.diagnose.torque.search import TorqueSearch
from smsid.diagnose.validation import Gain, gain
from smsid.diagnose.verdict import causes, is_piecewise_drift, limits, remaining_tests, test_results, verdict
from smsid.errors import RecordingError, SmsidError
from smsid.estimation.bias_walk import bias_walks, with_walk_noise
from smsid.estimation.clock_shift import on_shifted_clock
from smsid.estimation.identify_flights import labels_of
from smsid.estimation.innovations import normalised_rmse
from smsid.estimation.input_hold import locked_coordinates
from smsid.estimation.joint_problem import (
    PlacedRecording,
    by_own_clock,
    joint_problem,
    on_one_clock,
    on_own_clock,
    thin_problem,
    with_likely_timing,
    with_timing_of,
)
from smsid.estimation.map_estimate import evaluate
from smsid.estimation.measurements import measurements_of
from smsid.estimation.moving_start import starts_of, with_start_of
from smsid.estimation.parameter_vector import JointPrior, Point
from smsid.estimation.problem import CommandTiming, Problem, ProcessNoise
from smsid.identify.estimate import Estimate
from smsid.model.column_order import order_columns
from smsid.recording import Recording
from smsid.recording.channel_checks import Contradictions

LOGGER = logging.getLogger(__name__)
RATE = 25.0  # [Hz]


@short_repr
@dataclass(frozen=True)
class DiagnosisRun:
    """A diagnosis with what it was made from; ``extended`` is the description with the causes in it.

    ``search`` is ``None`` when the recording was not evaluated, or by measured torques: then ``torques`` is
    what was searched. ``point`` is where the fit stands with the causes that are named, hints left out.
    """

    diagnosis: Diagnosis
    extended: Description
    search: Search | None = None
    torques: TorqueSearch | None = None
    point: Point | None = None


def diagnose(
    description: Description,
    recordings: Sequence[Recording],
    *,
    estimate: Estimate | None = None,
    validation: Sequence[Recording] = (),
    rate: float = RATE,
    cutoff: float | None = None,
) -> DiagnosisRun:
    """Say whether the simulation explains a recording, and if not, why.

    A welded arm whose torques were measured and not commanded is judged by these torques, see
    `smsid.diagnose.torque`; everything else by the innovations of a filter that the commands drive.

    Args:
        description: the model, its values as identified.
        recordings: what was measured, with the commands that drove it; all are searched together. Parameters
            and causes are common to all, the state at the start and sensor biases are each recording's own.
        estimate: standard deviations of the nominal parameters; else the description's priors, else defaults.
        validation: recordings the gain is measured on.
        rate: samples a second that are looked at; more are thinned out (commands are not) [Hz].
        cutoff: of measured torques: low-pass of the motion [Hz].

    Never raises for a recording that cannot be used: the verdict is then ``not_evaluated`` with the reason.
    Raises `SmsidError` when no recording is given.
    """
    if not recordings:
        raise SmsidError("No recording was given.", advice="Give at least one.")
    names = tuple(r.name for r in (*recordings, *validation))
    with threadpool_limits(limits=1, user_api="blas"):
        try:
            doubts = _doubts([*recordings, *validation])
            if torques_were_measured(description, recordings[0]):  # takes the columns by their labels itself
                result, extended, torques = diagnose_torques(
                    description, recordings, estimate=estimate, validation=validation, cutoff=cutoff
                )
                made = DiagnosisRun(result, extended, torques=torques)
            else:
                made = _diagnose(description, recordings, estimate, validation, rate, names)
        except (SmsidError, np.linalg.LinAlgError) as error:
            LOGGER.info("not evaluated: %s", error, exc_info=True)
            result = Diagnosis(description.name, names, "not_evaluated", str(error), gain_reason=str(error))
            return DiagnosisRun(result, description)
    result = replace(made.diagnosis, notes=(*doubts, *made.diagnosis.notes))
    return replace(made, diagnosis=result)


def _diagnose(
    description: Description,
    recordings: Sequence[Recording],
    estimate: Estimate | None,
    validation: Sequence[Recording],
    rate: float,
    names: tuple[str, ...],
) -> DiagnosisRun:
    for recording in recordings:
        recording.check(consistency=False, sensors_may_pause=True)
    labels = labels_of(recordings)
    known = nominal(description, estimate, labels[1:])
    point, description = known.point, known.point.description
    recordings = [order_columns(r, point.base) for r in recordings]
    placed = on_one_clock(recordings, labels)
    given, shift = point, placed[0].shift
    description = on_shifted_clock(description, shift)
    point = replace(point, description=description)
    read = joint_problem([_problem(point, p, known.joint) for p in placed], placed)
    whole = read.data
    rounded = quantised_channels(whole)
    faults = stuck_channels(whole) + rounded
    coarse = frozenset(f.component for f in rounded)

    def looked_at(faults: Sequence[Fault], read: Problem) -> Problem:
        problem = thin_problem(replace(read, data=drop_samples(whole, faults)), rate)
        data = with_walk_noise(inflate_for_quantisation(problem.data, rounded))
        return replace(problem, data=data, bias_walks=bias_walks(data))

    def timed(read: Problem) -> Problem:
        return with_likely_timing(point, looked_at(faults, read), now=False)

    def searched(problem: Problem, point: Point, before: Search | None = None) -> Search:
        """Search, or stay with what was found ``before`` where a search fails numerically."""
        own = THRESHOLDS.beside_a_cause if faults else THRESHOLDS
        try:
            return search(point, problem, known.unknowns, candidates, own, coarse)
        except (SmsidError, np.linalg.LinAlgError) as error:
            if before is None:
                raise
            LOGGER.info("a second search failed: %s", error, exc_info=True)
            note = f"a second search, with what the first one told, failed and was left out: {error}"
            return replace(before, failed=(*before.failed, note))

    at_rest, problem = read, timed(read)
    moving = with_likely_start(point, problem, known.unknowns)
    if any(starts_of(moving)):
        read = with_start_of(read, moving)
        problem = timed(read)
    count = len(problem.data.times)
    fewer = f"{count} of {len(whole.times)} samples looked at" if count < len(whole.times) else ""
    candidates = propose(point, problem, known.unknowns)
    read, problem, found = _from_likely_start(point, (read, problem), at_rest, timed, searched)
    problem = with_timing_of(problem, found.last.problem)
    rests = resting_channels(found.last, whole, faults)
    if rests:
        LOGGER.info("at rest, not stuck: %s", ", ".join(f.component for f in rests))
        faults = [f for f in faults if all(f is not r for r in rests)]
        problem = with_timing_of(looked_at(faults, read), problem)
        found = searched(problem, point, found)
    again = with_timing_of(problem, as_inputs_act(found))
    if _timings(again) != _timings(problem):  # what was wrong with the model hid it
        LOGGER.info("commands act otherwise: %s", _timings(again))
        problem = again
        found = searched(problem, point, found)
    before, wild = faults, []
    more = outliers(found.last.problem.data, found.last.run)
    if more:
        every, with_all = problem, found
        problem, faults = replace(every, data=drop_samples(every.data, more)), [*before, *more]
        found = searched(problem, found.nominal.point, found)
        wild = recount_outliers(more, every.data, found.last.problem, found.last.run)
        faults = [*before, *wild]
        if not wild and not _is_likelier(found, with_all):
            # one that failed is the one before, and says so
            problem, found = every, found if found.last is with_all.last else with_all
        elif len(wild) < len(more):  # they were a motion that the model did not follow yet
            LOGGER.info("outliers of %d components are none", len(more) - len(wild))
            problem = replace(every, data=drop_samples(every.data, wild))
            found = searched(problem, found.nominal.point, found)
    problem = with_timing_of(problem, found.last.problem)  # a search may have found it out
    white = of_white_components(wild, {t.where for t in found.left if t.dependence == PAST})
    if not found.left:  # else only what stands is told as a cause
        found = with_profile_intervals(found)
    seen, every = tuple(_fault(f, problem) for f in _per_channel([*before, *white])), causes(found)
    decided, sentence = verdict(found, (*seen, *every))
    named, partial, by, hints = every, (), found, []
    if decided == "unexplained" or found.misfit:
        # what explains a part only is a hint: a cause outside the catalogue looks like several within
        stand: Sequence[FoundCause | None] = (None,) * len(every)
        if not (found.one_unknown or is_piecewise_drift(every)):
            by, stand = find_standing_causes(found, every)
        every = tuple(s or c for s, c in zip(stand, every, strict=True))
        if decided == "unexplained":
            named = tuple(s for s in stand if s)
            partial = tuple(c for c, s in zip(every, stand, strict=True) if not s)
            hints = [c.score.candidate for c, s in zip(found.causes, stand, strict=True) if not s]
        else:
            named = every
        _, sentence = verdict(found, (*seen, *every), (*seen, *named), partial)
    refitted = by_own_clock(found.nominal.point, problem)
    extended, told, reached = given.description, (), refitted
    if found.causes and (decided != "unexplained" or named):
        reached = extended_point(by, hints)
    if decided == "explained" or named:
        extended, told = with_inertial_shifts(reached, by.last)
    gained, reason = _gain((given, refitted, reached), found, validation, rate, faults)
    foreign = _foreign(found)
    if foreign:
        raise RecordingError(foreign, advice="Is it of another spacecraft?", recording=", ".join(labels))
    if not any(s.freedom for s in found.scores):
        raise RecordingError(
            f"'{', '.join(labels)}' excites no candidate at all.",
            advice="Move the arm, the wheels or thrust.",
        )
    taken = [
        f"{f'{where}: ' if where else ''}commands taken as {t.words}, accelerations from the {t.side}"
        for where, t in _timings(problem)
    ]
    apart = [
        f"'{p.label}' is taken to follow '{q.label}', {p.shift - shift:.4g} s later than by its own clock"
        for q, p in pairwise(placed)
        if p.shift != shift
    ]
    opened = [
        f"the shape of the friction of '{joint}' is left open: its torque errs by {size:.3g} (rms) about the "
        "law named, which counts in the uncertainties; what else acts at that joint was not asked"
        for joint, size in open_joints(found.last).items()
    ]
    gone = [
        f"extended.toml is of the last recording, '{labels[-1]}': {c.label} at {c.location} is in "
        f"'{c.recording}' alone, and left out"
        for c in named
        if c.recording not in ("", labels[-1]) and c.onset is None
    ]
    result = Diagnosis(
        description=description.name,
        recordings=names,
        verdict=decided,
        sentence=sentence,
        priors=known.stated,
        causes=(*seen, *named),
        partial=partial,
        gain=gained,
        gain_reason=reason,
        remaining=remaining_tests(found, decided, named),
        tests={
            name: test_results(blocks, len(blocks))
            for name, blocks in (("nominal", found.before), ("extended", found.blocks))
        },
        limits=limits(found),
        noise=found.noise,
        whitened_rms={"nominal": _rms(found.nominal), "extended": _rms(found.last)},
        timing=found.seconds,
        notes=tuple(n for n in (*known.notes, fewer, *taken, *apart, *by.failed, *opened, *told, *gone) if n),
    )
    return DiagnosisRun(result, extended, found, point=reached)


def _from_likely_start(
    point: Point,
    first: tuple[Problem, Problem],
    at_rest: Problem,
    timed: Callable[[Problem], Problem],
    searched: Callable[..., Search],
) -> tuple[Problem, Problem, Search]:
    """Return the whole problem as it begins most likely, what is looked at of it, and what a search found.

    The ``first`` of both are searched first; what is found so is held against another start: one in motion
    may stand for a cause, and a cause for a start.
    """
    read, problem = first
    found = searched(problem, point)
    if found.one_unknown or not (found.causes or found.left):
        return read, problem, found
    rested = read is at_rest
    moving = likelier_start(found.nominal, found.last, left=bool(found.left)) if rested else None
    if moving or not rested:
        other = with_start_of(read, moving) if moving else at_rest
        there = timed(other)
        again = searched(there, point, found)
        begun = [(s.nominal, s.last) for s in (found, again)]
        if again.last is found.last:  # it failed, and says so
            found = again
        elif rest_is_likelier(*(begun if rested else begun[::-1])) != rested:
            read, problem, found = other, there, again
    if found.causes and found.left and (moving := start_beside_causes(found.last)):
        other = with_start_of(read, moving)
        there = timed(other)
        again = searched(there, point, found)
        if again.last is found.last:
            found = again
        elif again.last.objective < found.last.objective:
            read, problem, found = other, there, again
    return read, problem, found


def _is_likelier(other: Search, found: Search) -> bool:
    """Whether a search that was made without some readings ended where all of them are likelier."""
    try:
        there = evaluate(other.last.point, other.last.unknowns, found.last.problem)
    except (SmsidError, np.linalg.LinAlgError):
        return False
    return there.objective < found.last.objective


def _doubts(recordings: Sequence[Recording]) -> list[str]:
    """Refuse channels that contradict each other as a sensor's fault does not; say what else is doubtful."""
    found = [(r, r.contradictions().findings) for r in recordings]
    for recording, findings in found:
        if not recording.provenance.get("unchecked"):
            Contradictions(tuple(f for f in findings if not f.of_a_sensor)).refuse()
    return [f"'{r.name}' is doubtful: {said}" for r, own in found for said in Contradictions(own).sentences]


def _problem(point: Point, placed: PlacedRecording, joint: JointPrior) -> Problem:
    """Return a recording as a problem; raises `RecordingError` for one that is too short or empty."""
    recording = placed.recording
    data = measurements_of(point.base, recording, point.description.effective_sensors())
    if len(data.times) < THRESHOLDS.shortest:
        raise RecordingError(
            f"'{placed.label}' has {len(data.times)} samples; a diagnosis needs {THRESHOLDS.shortest}.",
            advice="Record longer.",
        )
    read = [*data.values.T, *(q for quaternions in data.attitude.values() for q in quaternions.T)]
    if all(len(np.unique(x[np.isfinite(x)])) < 2 for x in read):
        raise RecordingError(
            f"There is nothing in '{placed.label}': none of the sensors' channels ever changes.",
            advice="Are the right channels mapped?",
        )
    return Problem(
        recording,
        data,
        locked_coordinates(point.base, recording),
        CommandTiming(),
        ProcessNoise(),
        joint,
        shift=placed.shift,
    )


def _timings(problem: Problem) -> list[tuple[str, CommandTiming]]:
    """Return how commands are taken to act in every recording, by its name; one alone needs none."""
    return [(p.label, p.timing) for p in problem.parts] or [("", problem.timing)]


def _gain(
    points: tuple[Point, Point, Point],
    found: Search,
    recordings: Sequence[Recording],
    rate: float,
    faults: Sequence[Fault],
) -> tuple[Gain | None, str]:
    if not recordings:
        return None, "no validation recording was given"
    try:
        held = order_columns(recordings[0], points[0].base)
        return gain(*points, held, found.last.problem, rate, faults), ""
    except (SmsidError, np.linalg.LinAlgError) as error:
        return None, f"not on '{recordings[0].name}': {getattr(error, 'message', error)}"


def _foreign(found: Search) -> str:
    """Return why the recording cannot be of this spacecraft, if so; asked where it is not followed."""
    if normalised_rmse(found.last.run) < FOLLOWED and max(found.noise.values()) < THRESHOLDS.loud:
        return ""
    left = unexplained_fraction(found.last, found.noise)
    if left > THRESHOLDS.foreign:
        return f"Even with everything refitted, {100 * left:.0f} % of the motion is left unexplained."
    return ""


def _per_channel(faults: Sequence[Fault]) -> list[Fault]:
    """Return one fault for every kind and channel, the strongest component's."""
    out: dict[tuple[str, str], Fault] = {}
    for f in faults:
        key = f.kind, f.channel
        if key not in out or f.value > out[key].value:
            out[key] = f
    return list(out.values())


def _fault(fault: Fault, problem: Problem) -> FoundCause:
    names = {"stuck": ("time", "s"), "outliers": ("rate", "1"), "quantisation": ("step", "of the channel")}
    name, unit = names[fault.kind]
    unit = "1" if name == "step" and fault.channel.endswith(".attitude") else unit
    size, where = on_own_clock(problem, fault.value) if name == "time" else (fault.value, "")
    value = Value(f"{fault.kind}_{fault.channel}.{name}", size, fault.sigma, unit)
    return FoundCause(
        fault.kind,
        fault.component,
        "sensor",
        fault.kind,
        (value,),
        (),
        {"samples": float(fault.samples.sum())},
        recording=where,
    )


def _rms(found) -> float:
    return float(np.sqrt((found.run.innovations**2).sum() / found.run.samples))
