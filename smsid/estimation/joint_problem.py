"""Several recordings as one filter problem: common parameters, and of each its own start, drive and biases.

The samples stand one after the other on one clock. The filter begins anew with each recording, and nothing is
carried over from the one before: log-likelihoods, residuals and information of the whole are sums.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid.effects.base import Effect
from smsid.errors import RecordingError
from smsid.estimation.clock_shift import YEARS, clock_shift, on_shifted_clock
from smsid.estimation.filter_pass import AppliedForces
from smsid.estimation.filter_run import FilterRun, run_of_each
from smsid.estimation.input_timing import timing_of
from smsid.estimation.kalman import applied_forces, driving_forces
from smsid.estimation.measurements import ChannelSlice, Measurements
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.estimation.problem import Problem, RecordingPart, recordings_of, samples_of_each
from smsid.estimation.process_model import ProcessModel
from smsid.estimation.sensitivities import Sensitivities, Sensitivity
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording


@dataclass(frozen=True)
class PlacedRecording:
    """A recording on the clock it shares with others, ``shift`` [s] later than by its own."""

    recording: Recording
    label: str
    shift: float


def on_one_clock(recordings: Sequence[Recording], labels: Sequence[str]) -> list[PlacedRecording]:
    """Return recordings on one clock, each after the one before.

    Their own clock where they follow one another by it, as pieces of one flight do; else each begins a sample
    after the end of the one before. Where the first counts from an epoch, it begins near zero.
    """
    out: list[PlacedRecording] = []
    end, shift = -np.inf, clock_shift(recordings[:1])
    for recording, label in zip(recordings, labels, strict=True):
        clocks = [np.asarray(recording.time(c), dtype=float) for c in recording.channels]
        first, last = min(c[0] for c in clocks), max(c[-1] for c in clocks)
        step = min(float(np.median(np.diff(c))) for c in clocks if len(c) > 1)
        if first + shift <= end or (out and first + shift > end + YEARS):
            shift = end + step - first
        out.append(PlacedRecording(recording.shifted(shift) if shift else recording, label, float(shift)))
        end = last + shift
    return out


def joint_problem(problems: Sequence[Problem], placed: Sequence[PlacedRecording]) -> Problem:
    """Return recordings on one clock (`on_one_clock`) as one problem; of one, itself.

    Channels are those of all together, not a number where a recording has none. Raises `RecordingError` for
    a channel that has other components in another recording.
    """
    if len(problems) == 1:
        return problems[0]
    data = joined_data([p.data for p in problems])
    ends = np.cumsum([0, *(len(p.data.times) for p in problems)])
    parts = tuple(
        RecordingPart(x.label, p.recording, p.locked, p.timing, int(first), x.shift, p.moves)
        for x, p, first in zip(placed, problems, ends, strict=False)
    )
    held = set.intersection(*(set(p.locked.tolist()) for p in problems))
    return replace(problems[0], data=data, locked=np.array(sorted(held), dtype=int), parts=parts)


def joined_data(parts: Sequence[Measurements]) -> Measurements:
    """Return samples of several recordings, one after the other, with the channels of all.

    Raises `RecordingError` where a channel has other components in another recording.
    """
    blocks: dict[str, ChannelSlice] = {}
    start = 0
    for block in (b for part in parts for b in part.blocks):
        width = block.rows.stop - block.rows.start
        known = blocks.setdefault(block.channel, replace(block, rows=slice(start, start + width)))
        if known.names != block.names:
            raise RecordingError(
                f"'{block.channel}' has other components in another recording.",
                advice="Diagnose them one by one.",
                channel=block.channel,
            )
        start = max(start, known.rows.stop)
    count = sum(len(p.times) for p in parts)
    values, sigma = np.full((count, start), np.nan), np.zeros(start)
    attitude = {c: np.full((count, 4), np.nan) for c, b in blocks.items() if b.quantity == "attitude"}
    first = 0
    for part in parts:
        here = slice(first, first + len(part.times))
        first = here.stop
        for own in part.blocks:
            rows = blocks[own.channel].rows
            values[here, rows] = part.values[:, own.rows]
            sigma[rows] = np.maximum(sigma[rows], part.sigma[own.rows])
            if own.channel in attitude:
                attitude[own.channel][here] = part.attitude[own.channel]
    times = np.concatenate([p.times for p in parts])
    return Measurements(times, values, attitude, tuple(blocks.values()), sigma)


def on_own_clock(problem: Problem, time: float) -> tuple[float, str]:
    """Return a time on the common clock as one on that of the recording it is in [s], and its label.

    Of one recording alone the label is empty.
    """
    if not problem.parts:
        return time - problem.shift, ""
    own = [p for p in problem.parts if problem.data.times[p.first] <= time + 1e-9] or problem.parts[:1]
    return time - own[-1].shift, own[-1].label


def by_own_clock(point: Point, problem: Problem) -> Point:
    """Return a point with effects beginning by its recording's own clock, of several by the first's."""
    if not problem.shift:
        return point
    return replace(point, description=on_shifted_clock(point.description, -problem.shift))


def each(problem: Problem, change: Callable[[Problem], Problem]) -> Problem:
    """Return a problem with every recording's own changed: its samples or its timing."""
    if not problem.parts:
        return change(problem)
    own = [change(p) for p in recordings_of(problem)]
    data = problem.data
    attitude = {c: np.concatenate([p.data.attitude[c] for p in own]) for c in data.attitude}
    times, values = (np.concatenate([getattr(p.data, k) for p in own]) for k in ("times", "values"))
    ends = np.cumsum([0, *(len(p.data.times) for p in own)])
    parts = tuple(
        replace(part, timing=p.timing, first=int(first))
        for part, p, first in zip(problem.parts, own, ends, strict=False)
    )
    data = replace(data, times=times, values=values, attitude=attitude)
    return replace(problem, data=data, timing=own[0].timing, parts=parts)


def thin_problem(problem: Problem, rate: float) -> Problem:
    """Return a problem with no more than ``rate`` samples a second of each recording."""
    return each(problem, lambda p: replace(p, data=p.data.thinned(rate)))


def with_likely_timing(point: Point, problem: Problem, *, now: bool = True) -> Problem:
    """Return a problem with commands as they act by their likelihood, see `timing_of`, in each recording.

    ``now``: what is taken now stays unless another is clearly better.
    """
    own = recordings_of(at_point(point, problem))
    points = [_own_point(point, problem, k) for k in range(len(problem.parts))] or [point]
    found = [timing_of(q, p, p.timing if now else None) for q, p in zip(points, own, strict=True)]
    parts = tuple(replace(p, timing=t) for p, t in zip(problem.parts, found, strict=False))
    return replace(problem, timing=found[0], parts=parts)


def with_timing_of(problem: Problem, other: Problem) -> Problem:
    """Return a problem with commands as they act in another of the same recordings."""
    parts = tuple(replace(p, timing=q.timing) for p, q in zip(problem.parts, other.parts, strict=True))
    return replace(problem, timing=other.timing, parts=parts)


def at_point(point: Point, problem: Problem) -> Problem:
    """Return the problem read through the sensors as they are at a point, in each recording with its own
    biases and effects.
    """
    data, parts = problem.data, []
    for k, part in enumerate(problem.parts):
        own = _own_point(point, problem, k)
        model = own.model() if point.within else None
        parts.append(replace(part, blocks=data.with_blocks(own.sensors()).blocks, model=model))
    return replace(problem, data=data.with_blocks(point.sensors()), parts=tuple(parts))


def _own_point(point: Point, problem: Problem, number: int) -> Point:
    """Return a point as it is in one of the recordings: biases without a label are the first's."""
    label = problem.parts[number].label
    own = point.for_recording(label) if number else point
    return own.seen_in(label) if point.within else own


def samples_in(problem: Problem, label: str) -> np.ndarray:
    """Return which samples (N,) are of one of several recordings."""
    found = np.zeros(len(problem.data.times), dtype=bool)
    for part, here in zip(problem.parts, samples_of_each(problem), strict=True):
        found[here] = part.label == label
    return found


class JointSensitivities(Sensitivities):
    """Changes by any parameter along a run over several recordings, each with its own drive and biases."""

    def __init__(self, point: Point, model: SpacecraftModel, problem: Problem, run: FilterRun) -> None:
        runs = run_of_each(run)
        models = [part.model or model for part in problem.parts]
        points = [_own_point(point, problem, k) if point.within else point for k in range(len(runs))]
        own = zip(points, models, recordings_of(problem), runs, strict=True)
        self.each = tuple(Sensitivities(*x) for x in own)
        super().__init__(point, model, problem, run)

    def effect(self, plain: Effect, changed: Effect, step: float) -> Sensitivity:
        """Return the change from one instance of an effect to another, in the recordings it acts in."""
        found = super().effect(plain, changed, step)
        if changed.name not in self.point.within:
            return found
        here = samples_in(self.problem, self.point.within[changed.name])[:, None]
        way = here[:-1] & here[1:]
        return found.weighted(way, here)

    def _difference_ahead(self, origin: SpacecraftModel, model: SpacecraftModel) -> np.ndarray:
        none = np.zeros((1, 2 * model.nv))  # where recordings meet
        found = [s._difference_ahead(origin, model) for s in self.each]
        return np.concatenate([x for f in found for x in (f, none)][:-1])

    def _applied_forces(self, model: SpacecraftModel) -> AppliedForces:
        found = [
            applied_forces(
                ProcessModel(model, s.problem.locked), s.problem, driving_forces(model, s.inputs), s.run.edges
            )
            for s in self.each
        ]
        none = np.zeros((1, model.nv))
        middle = np.concatenate([x for f in found for x in (f.middle, none)][:-1])
        # of the course within a step only the number of steps is asked here
        means = np.repeat(middle[:, None], max(f.means.shape[1] for f in found), axis=1)
        return AppliedForces(means, middle, np.concatenate([f.at for f in found]), np.zeros_like(means))

    def bias(self, unknown: Unknown) -> Sensitivity:
        """Return the change by a bias in the recording it is named after, if not the first."""
        return self._in_its_recording(unknown, Sensitivities.bias)

    def sensor(self, unknown: Unknown) -> Sensitivity:
        """Return the change by another error of a sensor, in its recording likewise."""
        return self._in_its_recording(unknown, Sensitivities.sensor)

    def _in_its_recording(
        self, unknown: Unknown, change: Callable[[Sensitivities, Unknown], Sensitivity]
    ) -> Sensitivity:
        label, named, name = unknown.name.rpartition(": ")
        own = replace(unknown, name=name) if named else unknown
        readings = []
        for k, (part, s) in enumerate(zip(self.problem.parts, self.each, strict=True)):
            mine = part.label == label if named else k == 0
            found = change(s, own) if mine else Sensitivity()
            readings.append(np.zeros((len(s.run.states.time), self.problem.data.rows)))
            if found.reading is not None:
                readings[-1][:, found.rows] = found.reading
        return Sensitivity.of(reading=np.concatenate(readings))

    def readings(self) -> np.ndarray:
        """Return what is read along the run (N, rows)."""
        return np.concatenate([s.readings() for s in self.each])

    def rates(self) -> np.ndarray:
        """Return time derivatives of the readings (N, rows) between jumps of the commands."""
        return np.concatenate([s.rates() for s in self.each])

    def _reading_change(
        self, base: Point, other: Point, origin: SpacecraftModel, model: SpacecraftModel
    ) -> np.ndarray | None:
        found = [s._reading_change(base, other, origin, model) for s in self.each]
        parts = [x for x in found if x is not None]
        return np.concatenate(parts) if len(parts) == len(found) else None


def sensitivities(point: Point, model: SpacecraftModel, problem: Problem, run: FilterRun) -> Sensitivities:
    """Return the changes by any parameter at a point, along a run there."""
    return (JointSensitivities if problem.parts else Sensitivities)(point, model, problem, run)
