"""Follow a spacecraft through recordings: what is known of it stays from one to the next."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pinocchio as pin

from smsid._threads import single_threaded
from smsid.description.schema import Description
from smsid.errors import RecordingError, SimulationError, SmsidError
from smsid.estimation.clock_shift import YEARS
from smsid.estimation.commands_between_samples import with_timing
from smsid.estimation.flight import Flight, FlightOptions, flight_of
from smsid.estimation.identify_flights import labels_of
from smsid.estimation.input_timing import timing_of
from smsid.estimation.joint_problem import at_point
from smsid.estimation.loosening import MOST_SAMPLES
from smsid.estimation.measurements import matrix
from smsid.estimation.panels import modal_panels
from smsid.estimation.parameter_vector import Point
from smsid.identify.estimate import Estimate
from smsid.likelihood.prior import Cad
from smsid.model.column_order import order_columns
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording
from smsid.tracking._change_detection import ChangeDetector
from smsid.tracking._course import Course
from smsid.tracking._fit_watch import FitWatch
from smsid.tracking._fixed_interval import Retraced
from smsid.tracking._sample import samples_of
from smsid.tracking._sample_buffer import Event
from smsid.tracking._setting import Setting
from smsid.tracking._tracker import CHUNK, Tracker
from smsid.tracking._update import Update
from smsid.tracking._warm_up import WarmStart, linearise_by_search
from smsid.tracking.followed_parameters import UNCERTAIN, Rate
from smsid.tracking.history import SmoothedTrack, TrackHistory

LOGGER = logging.getLogger(__name__)
WARM_UP = 120.0  # [s]
MOST_ROWS = 4000  # of a history, unless asked for more
SMOOTHINGS = 4  # at most, each about what the one before found
ROOM = 4e8  # bytes for what is kept of a run until it is smoothed


@single_threaded
def track_recordings(
    description: Description,
    recordings: Sequence[Recording],
    *,
    follow: Mapping[str, Rate] | Sequence[str] | None = None,
    hold: Sequence[str] = (),
    estimate: Estimate | None = None,
    cad: Cad | None = UNCERTAIN,
    options: FlightOptions | None = None,
    gap: float = 0.0,
    every: float | None = None,
    warm_up: float = WARM_UP,
    hear: Callable[[Update], None] | None = None,
    false_alarms: float | None = None,
    smooth: bool = False,
) -> tuple[TrackHistory, Tracker]:
    """Run a tracker through recordings and return what it found over time, and the tracker as it ends.

    Args:
        description: the spacecraft.
        recordings: in the order they were made. Where clocks go on from one to the next, parameters wander
            over the gap between them; where a clock begins again, over ``gap`` [s].
        follow: rates of random walks by parameter, as in `followed_parameters`.
        hold: parameters that are not followed.
        estimate: what is known beforehand.
        cad: what is known of rigid bodies without an estimate.
        options: how recordings are taken, as in `identify_flights`.
        gap: time between recordings whose clocks do not say [s].
        every: time between rows of the history [s]; no more than `MOST_ROWS` rows if not given.
        warm_up: how much of the first recording is searched for parameters to linearise about [s], where no
            estimate is given: a filter alone is overconfident when it begins far from the truth. What is
            believed at the start stays as described, so that no sample counts twice.
        hear: hears every update.
        false_alarms: seek changes, as `ChangeDetector` does, with at most so many false alarms per hour; they
            are among the history's events. Nothing is sought if not given.
        smooth: also say what is known of each time from all that was read (`smsid.tracking._fixed_interval`);
            the filter runs once more for it, and there are no more rows than fit into `ROOM`.

    Raises:
        RecordingError: no recording, or one that cannot be used.
        DescriptionError: as `followed_parameters`.
        SimulationError: the filter loses the motion.
    """
    if not recordings:
        raise RecordingError("No recording was given.", advice="Give at least one.")
    if not (np.isfinite(gap) and gap >= 0.0):
        raise RecordingError(f"A gap of {gap} s is none.", advice="Give zero or more seconds.")
    described = Point.of(modal_panels(description)[0])
    labels = labels_of(recordings)
    flights = [flight_of(described, r, name, options) for r, name in zip(recordings, labels, strict=True)]
    channels = dict.fromkeys(b.channel for f in flights for b in f.problem.data.blocks)
    setting = Setting.of_flight(flights[0])
    seen = set(channels) - set(setting.channels)

    def new() -> Tracker:
        return Tracker(description, follow=follow, hold=hold, estimate=estimate, cad=cad, setting=setting)

    tracker = new()
    tracker.course.kept = smooth
    if seen:
        LOGGER.info("first read in a later recording: %s", ", ".join(sorted(seen)))
    total = sum(float(np.ptp(f.problem.data.times)) for f in flights)
    detector = None if false_alarms is None else ChangeDetector(tracker, false_alarms)
    # the detector hears first, as it may change what is believed
    listeners: list[Callable[[Update], object]] = [] if detector is None else [detector.hear]
    listeners += [] if hear is None else [hear]
    changes: list[Event] = []
    watch = tracker.watch
    most = min(MOST_ROWS, int(ROOM / (24 * len(tracker.covariance) ** 2))) if smooth else MOST_ROWS
    rows = _Rows(described.base, every if every is not None else total / most, watch)
    shift, ended = 0.0, None
    notes = list(tracker.start.notes)
    flown: list[tuple[Flight, Recording, float | None]] = []
    if estimate is None and warm_up > 0.0:
        looked = flights[0].problem.timing
        (timing, step), more, warm = linearise_by_search(tracker, described, flights[0], warm_up)
        if warm is not None:
            listeners.append(_held_against(warm, tracker, rows, detector))
        flights = [with_timing(f, timing) if f.problem.timing == looked else f for f in flights]
        flights = [
            replace(f, problem=replace(f.problem, substep=min(step, f.problem.substep))) for f in flights
        ]
        notes += more
    else:
        flights = [_with_likely_timing(tracker, f) for f in flights]
    for number, (flight, recording) in enumerate(zip(flights, recordings, strict=True)):
        first, passed = float(flight.problem.data.times[0]), None
        if ended is not None:
            if not 0.0 <= first + shift - ended < YEARS:
                shift = ended + gap - first
            passed = first + shift - ended
        flown.append((flight, recording, passed))
        # the tracker's clock is the recording's own; what passed in between is told as the start
        tracker.begin_flight(flight, start=None if passed is None else tracker.time + passed)
        known = 0 if detector is None else len(detector.changes)
        _fly(tracker, flight, recording, rows, number, shift, listeners)
        if detector is not None:
            found = detector.changes[known:]
            where = f"{flight.label}: " if len(flights) > 1 else ""
            changes += [Event(c.alarm + shift, "change", c.group, where + c.sentence) for c in found]
        ended = tracker.time + shift
        notes += [f"{flight.label}: {n}" for n in flight.notes]
    notes[:0] = [watch.sentence] if watch.sentence else []
    smoothed = None
    if smooth:
        try:
            smoothed, unsettled = _smooth_rows(new, tracker, flown, rows)
            notes += unsettled
        except SmsidError as error:
            notes.append(f"nothing is smoothed: {error}")
    history = TrackHistory(
        description.name,
        rows.stack("time"),
        rows.stack("own_time"),
        rows.stack("recording"),
        tuple(labels),
        tracker.names,
        tracker.units,
        np.array([0.0 if x.of >= 0 else described.value(x.unknown) for x in tracker.start.followed]),
        rows.stack("values"),
        rows.stack("sigmas"),
        tuple(dof_names(described.base)),
        rows.stack("position"),
        rows.stack("position_sigma"),
        rows.stack("velocity"),
        rows.stack("velocity_sigma"),
        tuple(channels),
        rows.fits(tuple(channels)),
        tracker.parameter_covariance * watch.widening**2,
        (*changes, *(e for e in tracker.log.last if e.kind != "begun")),
        tuple(notes),
        {
            "samples": float(tracker.samples),
            "rebuilt": float(tracker.filter.rebuilt),
            "widening": watch.widening,
            "log_likelihood": rows.log_likelihood,
        },
        smoothed,
    )
    return history, tracker


def _with_likely_timing(tracker: Tracker, flight: Flight) -> Flight:
    """Return a flight whose commands act between samples as its first samples say of the tracker's models."""
    point, problem = tracker.filter.at.point, flight.problem
    some = replace(problem, data=problem.data.first(MOST_SAMPLES))
    return with_timing(flight, timing_of(point, at_point(point, some)))


def _held_against(
    warm: WarmStart, tracker: Tracker, rows: _Rows, detector: ChangeDetector | None
) -> Callable[[Update], None]:
    """Return a listener that holds a tracker against its warm-up, once, where that ends.

    Not where something changed or was lost by then: of one value for all of it nothing is asked.
    """
    left = [warm]

    def hear(update: Update) -> None:
        if left and update.time >= tracker.time >= left[0].until:
            found = left.pop()
            if not (tracker.log.counts.get("lost") or (detector is not None and detector.changes)):
                apart = found.disagreement(tracker.filter)
                tracker.watch.apart, tracker.watch.seconds = apart, found.seconds
                rows.table["sigmas"] = [apart * x for x in rows.table["sigmas"]]  # it was pulled all along

    return hear


def _smooth_rows(
    new: Callable[[], Tracker],
    tracker: Tracker,
    flown: Sequence[tuple[Flight, Recording, float | None]],
    rows: _Rows,
) -> tuple[SmoothedTrack, list[str]]:
    """Return what is known at the rows from all that was read, by other trackers along the course of one, and
    a note where that did not settle.

    Raises `SimulationError` where the motion was lost: nothing is known of what came before by what came
    after.
    """
    if tracker.log.counts.get("lost"):
        raise SimulationError("The motion was lost.", advice="Track what came before and after alone.")
    times, legs = rows.stack("own_time"), rows.stack("leg")
    course: Course | None = tracker.course
    wanted, found = [times[legs == k] for k in range(len(tracker.course.legs))], []
    for _ in range(SMOOTHINGS):
        again, along = new(), Retraced(course, wanted)
        again.course = along
        for flight, recording, passed in flown:
            again.begin_flight(flight, start=None if passed is None else again.time + passed)
            _feed(again, flight, recording, along.hear)
        found, course = along.smoothed()
        if course is None:
            break
    # values about a jump are smoothed by models that are linear on either side of it
    model, widening, out = rows.model, max(rows.watch.widening, rows.watch.forgotten), []
    for row in found:
        nv, sigma = model.nv, np.sqrt(np.maximum(row.covariance.diagonal(), 0.0))
        own = widening * row.scales * sigma[len(sigma) - len(row.values) :]
        out.append((row.values, own, _place(model, row.q), sigma[:nv], row.v, sigma[nv : 2 * nv]))
    unsettled = f"what is smoothed still moved after {SMOOTHINGS} rounds: its bands may be too narrow"
    whole = SmoothedTrack(*(np.array(x) for x in zip(*out, strict=True)))
    return whole, [] if course is None else [unsettled]


def _fly(
    tracker: Tracker,
    flight: Flight,
    recording: Recording,
    rows: _Rows,
    number: int,
    shift: float,
    listeners: Sequence[Callable[[Update], object]],
) -> None:
    """Run the tracker through one recording."""

    def listen(update: Update) -> None:
        rows.hear(update)
        if update.time >= tracker.time:  # of a pass, where the filter is
            rows.add(tracker, number, shift)
        for hear in listeners:
            hear(update)

    _feed(tracker, flight, recording, listen)
    rows.add(tracker, number, shift, last=True)


def _feed(tracker: Tracker, flight: Flight, recording: Recording, hear: Callable[[Update], None]) -> None:
    """Give a tracker all samples of a recording."""
    model = flight.model
    ordered = order_columns(recording, model)
    read = {b.channel for b in flight.problem.data.blocks} | set(tracker.commands.sizes)
    inputs = flight.problem.inputs(model)
    waiting = []
    tracker.listener = hear
    for sample in samples_of(ordered, [c for c in ordered.channels if c in read]):
        waiting.append(sample)
        if len(waiting) == CHUNK:
            tracker.update_all(waiting, inputs)
            waiting = []
    tracker.update_all(waiting, inputs)
    tracker.listener = None


def dof_names(model: SpacecraftModel) -> list[str]:
    """Return a name for each degree of freedom (nv,)."""
    out = [f"bus.{x}" for x in ("x", "y", "z", "rx", "ry", "rz")] if model.free else []
    for j in range(1, model.pin.njoints):
        joint = model.pin.joints[j]
        if joint.idx_v < len(out):
            continue
        name = model.pin.names[j]
        out += [name] if joint.nv == 1 else [f"{name}.{i}" for i in range(joint.nv)]
    return out


def _place(model: SpacecraftModel, q: np.ndarray) -> np.ndarray:
    """Return where each degree of freedom is (nv,), a free bus's attitude as rotation vector."""
    place = np.zeros(model.nv)
    for j in range(1, model.pin.njoints):
        joint = model.pin.joints[j]
        own = q[joint.idx_q : joint.idx_q + joint.nq]
        if joint.nv == 6:
            place[:6] = np.concatenate([own[:3], pin.log3(matrix(own[3:7]))])
        elif joint.nq == joint.nv:
            place[joint.idx_v : joint.idx_v + joint.nv] = own
        else:
            place[joint.idx_v] = np.arctan2(own[1], own[0])
    return place


@dataclass(eq=False)
class _Rows:
    """Rows of a history as they come, no closer than ``every`` [s]."""

    model: SpacecraftModel
    every: float
    watch: FitWatch
    table: dict[str, list] = field(default_factory=dict)
    fit: list[dict[str, float]] = field(default_factory=list)
    sums: dict[tuple[str, ...], list] = field(default_factory=dict)  # of squares, by what was read together
    log_likelihood: float = 0.0

    def hear(self, update: Update) -> None:
        self.log_likelihood += update.log_likelihood
        own = self.sums.setdefault(update.rows, [0.0, 0])
        own[0], own[1] = own[0] + update.normalised**2, own[1] + 1

    def add(self, tracker: Tracker, number: int, shift: float, *, last: bool = False) -> None:
        now = tracker.time + shift
        times = self.table.get("time", [])
        new = not times or self.table["recording"][-1] != number
        if not new and (now <= times[-1] or (now < times[-1] + self.every and not last)):
            return
        f, model = tracker.filter, self.model
        sigma = np.sqrt(np.maximum(f.covariance.diagonal(), 0.0))
        row = {
            "time": now,
            "own_time": tracker.time,
            "recording": number,
            "leg": len(tracker.course.legs) - 1,
            "values": f.values.copy(),
            "sigmas": f.sigmas() * self.watch.widening,
            "position": _place(model, f.q),
            "position_sigma": sigma[: model.nv],
            "velocity": f.v.copy(),
            "velocity_sigma": sigma[model.nv : 2 * model.nv],
        }
        for key, value in row.items():
            self.table.setdefault(key, []).append(value)
        self.fit.append(self._fit())
        self.sums = {}

    def _fit(self) -> dict[str, float]:
        """Return the root mean square of normalised innovations by channel, since the last row."""
        squares: dict[str, list[float]] = {}
        for rows, (total, count) in self.sums.items():
            for name, square in zip(rows, np.broadcast_to(total, len(rows)).tolist(), strict=True):
                own = squares.setdefault(name.partition("[")[0], [0.0, 0.0])
                own[0], own[1] = own[0] + square, own[1] + count
        return {channel: float(np.sqrt(square / count)) for channel, (square, count) in squares.items()}

    def stack(self, key: str) -> np.ndarray:
        return np.array(self.table[key])

    def fits(self, channels: Sequence[str]) -> np.ndarray:
        return np.array([[row.get(c, np.nan) for c in channels] for row in self.fit])
