"""Follow a spacecraft sample by sample: its motion, chosen parameters, and how well each is known."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from smsid.description.schema import Description
from smsid.errors import RecordingError, SimulationError
from smsid.estimation.flight import Flight
from smsid.estimation.initial_state import initial_belief
from smsid.estimation.kalman import input_covariance
from smsid.estimation.measurements import SAME_MOMENT
from smsid.estimation.panels import modal_panels
from smsid.estimation.parameter_vector import Point
from smsid.estimation.problem import Belief, CommandTiming, Problem, unknown_sigmas
from smsid.identify.estimate import Estimate
from smsid.kernel.filter_arrays import Record
from smsid.likelihood.prior import Cad
from smsid.recording import Recording
from smsid.simulate import Inputs
from smsid.tracking._course import Course
from smsid.tracking._drive import CommandMemory
from smsid.tracking._fit_watch import FitWatch
from smsid.tracking._jump_runs import CLOCK
from smsid.tracking._linearisation import point_at
from smsid.tracking._parameter_filter import ParameterFilter
from smsid.tracking._prediction import StatePrediction, covariance_in_units, fill_times, predict
from smsid.tracking._sample import Sample
from smsid.tracking._sample_buffer import EventLog, MomentEvents, SampleBuffer
from smsid.tracking._setting import Setting
from smsid.tracking._update import TrackedState, Update
from smsid.tracking.followed_parameters import UNCERTAIN, Rate, StartingPoint, followed_parameters

SETTLE = 1.0  # [s] that is waited for every channel before the motion begins
WARM = 10.0  # [s] within which a motion that is lost is that of another spacecraft
CHUNK = 25  # samples whose commands are looked up at once
QUATERNION = 4


class Tracker:
    """An extended Kalman filter with chosen parameters in its state, fed sample by sample.

    Memory does not grow with the number of samples. A ``listener`` hears every update as it is made;
    ``watch`` knows whether the model has explained the telemetry so far. Not to be shared between threads.

    Args:
        description: the spacecraft. Parameters start from its values, or from the estimate's.
        follow: rates of the parameters' random walks, as in `followed_parameters`.
        hold: parameters that are not followed.
        estimate: what is known beforehand, with covariance.
        cad: what is known of rigid bodies without an estimate.
        setting: how telemetry is taken; all driven by recorded commands, sensors as described, if not given.

    Raises:
        DescriptionError: as `followed_parameters`.
        RecordingError: the description does not state the noise of a sensor and there is no setting.
    """

    def __init__(
        self,
        description: Description,
        *,
        follow: Mapping[str, Rate] | Sequence[str] | None = None,
        hold: Sequence[str] = (),
        estimate: Estimate | None = None,
        cad: Cad | None = UNCERTAIN,
        setting: Setting | None = None,
    ) -> None:
        self.described = description
        self.description = modal_panels(description)[0]
        origin = Point.of(self.description)
        self.setting = setting or Setting.of(self.description, origin.base)
        start = followed_parameters(
            self.description, follow=follow, hold=hold, estimate=estimate, cad=cad,
            present=self.setting.channels,
        )  # fmt: skip
        self.listener: Callable[[Update], None] | None = None
        # corrects the filter, where it knows why motion is lost
        self.rescue: Callable[[], bool] | None = None
        self.watch = FitWatch()
        self.course = Course()
        self._build(origin, start)

    def _build(self, origin: Point, start: StartingPoint) -> None:
        model, setting = origin.base, self.setting
        unknowns, at = [u for u, _ in start.held], [x for _, x in start.held]
        self.origin, self.start = point_at(origin, unknowns, at), start
        layout = setting.layout(model, self.description)
        locked = np.array(setting.locked, dtype=int)
        scales = np.array([f.unknown.scale for f in start.followed])
        m, k = len(scales), len(unknown_sigmas(setting.unknown_inputs))
        covariance = np.zeros((2 * model.nv + k + m,) * 2)
        covariance[-m:, -m:] = start.covariance / np.outer(scales, scales)
        timing, unknown = CommandTiming(setting.hold), setting.unknown_inputs
        problem = Problem(_NOTHING, layout, locked, timing, setting.noise, unknown_inputs=unknown)
        noise, home = input_covariance(model, problem), model.home.copy()
        self.filter = ParameterFilter(
            self.origin, start.followed, layout, locked, unknown, timing, noise, -np.inf, home,
            np.zeros(model.nv), np.zeros(k), start.mean.copy(), covariance,
        )  # fmt: skip
        self.log = EventLog()
        self.buffer = SampleBuffer(SAME_MOMENT * setting.substep, setting.lateness, self.log, setting.silence)
        self.commands = CommandMemory(model, setting.hold)
        self.moving = False
        self._first = np.inf  # when the first motion began [s]
        self._looks = -np.inf  # when models may be built anew next [s]
        self.samples = 0
        self._settling: list[MomentEvents] = []
        self._before: np.ndarray | None = None
        self._unknown_channels: set[str] = set()
        self._row_names = layout.names
        self._attitudes = [b.channel for b in layout.blocks if b.quantity == "attitude"]
        self._shapes = {
            b.channel: QUATERNION if b.quantity == "attitude" else b.rows.stop - b.rows.start
            for b in layout.blocks
        }

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters followed (m,)."""
        return tuple(f.name for f in self.start.followed)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the parameters followed (m,)."""
        return tuple(f.unknown.unit for f in self.start.followed)

    @property
    def values(self) -> np.ndarray:
        """Values (m,) of the parameters followed, in their units."""
        return self.filter.values

    @property
    def time(self) -> float:
        """Time [s] of the last moment taken in; minus infinity before the first."""
        return self.filter.time

    @property
    def state(self) -> TrackedState:
        """What is believed now."""
        f = self.filter
        own = dict(zip(self.names, f.values.tolist(), strict=True))
        return TrackedState(f.time, f.q.copy(), f.v.copy(), f.unknown.copy(), own)

    @property
    def covariance(self) -> np.ndarray:
        """Covariance (x, x) of the tangent of q (nv,), of v (nv,), of unknown inputs and parameters."""
        return covariance_in_units(self.filter)

    @property
    def parameter_covariance(self) -> np.ndarray:
        """Covariance (m, m) of the parameters followed, in products of their units."""
        return self.filter.parameter_covariance()

    @property
    def sigmas(self) -> np.ndarray:
        """Standard deviations (m,) of the parameters followed."""
        return self.filter.sigmas()

    def update(self, sample: Sample) -> tuple[Update, ...]:
        """Take in a sample of any sensors and return what the moments told whose time has come.

        One that is later than what was taken in already, comes twice or has channels that nobody described is
        named in `log`, not used; a motion that is lost is, too, and begun anew. Raises `RecordingError` for a
        channel of the wrong size, `SimulationError` when the motion is lost within `WARM` of the beginning.
        """
        self._receive(sample)
        return self._take_in(self.buffer.ready(), None)

    def update_all(self, samples: Iterable[Sample], inputs: Inputs | None = None) -> tuple[Update, ...]:
        """Take in samples together, and all that waits; ``inputs`` are what was commanded, if known better.

        Raises as `update`.
        """
        for sample in samples:
            self._receive(sample)
        return self.flush(inputs)

    def flush(self, inputs: Inputs | None = None) -> tuple[Update, ...]:
        """Take in all that waits for late samples."""
        return self._take_in(self.buffer.ready(everything=True), inputs, final=True)

    def begin(self, belief: Belief, time: float) -> None:
        """Begin the motion at a time [s] with what is known of it; parameters go on from where they are."""
        if not np.isfinite(self.filter.time):
            self.filter.time = self._first = time
        self.filter.begin(belief, time)
        self.course.begun(self.filter)
        self._looks = time
        self.moving, self._before, self._settling = True, None, []
        self.log.add(time, "begun", "", "the motion begins")

    def begin_flight(self, flight: Flight, *, start: float | None = None) -> None:
        """Begin a recording: how joints are driven and what noise sensors have is taken from it.

        ``start`` is its time [s] on the tracker's clock, for parameters to wander until then.
        """
        setting = self.setting.with_motion(Setting.of_flight(flight))
        f = self.filter
        values, own, v, known = f.values, f.parameter_covariance(), f.v, f.covariance
        time, log, samples, at = f.time, self.log, self.samples, (f.at.values, f.known_at, f.rebuilt)
        self.setting = setting
        self._build(self.origin, replace(self.start, mean=values, covariance=own))
        if len(known) == len(self.filter.covariance):  # what was used up stays so
            self.filter.v, self.filter.covariance = v, known
        self.filter.time, self.log, self.samples = time, log, samples
        self.buffer.log = log
        self.filter.linearise_at(at[0], at[1])
        self.filter.rebuilt = at[2]
        first = float(flight.problem.data.times[0])
        if flight.problem.begin is None:
            raise RecordingError("The flight does not say how its motion begins.", advice="Use flight_of.")
        elapsed = 0.0 if start is None or not np.isfinite(time) else start - time
        self.filter.time, self._first = first - max(elapsed, 0.0), first
        self.begin(flight.problem.begin, first)
        self.buffer.passed = -np.inf

    def predict(self, horizon: float) -> StatePrediction:
        """Return state and readings ``horizon`` [s] ahead, the last commands going on; nothing is changed.

        Raises `RecordingError` for a negative horizon or before the first sample.
        """
        if not self.moving:
            raise RecordingError("Nothing has been read yet.", advice="Call update first.")
        if not (np.isfinite(horizon) and horizon >= 0.0):
            raise RecordingError(f"A horizon of {horizon} s is none.", advice="Give zero or more seconds.")
        return predict(self.filter, self.commands.inputs(), self.setting, horizon)

    def _receive(self, sample: Sample) -> None:
        known: dict[str, np.ndarray] = {}
        for channel, value in sample.channels.items():
            size = self.commands.sizes.get(channel, self._shapes.get(channel))
            if size is None:
                if channel not in self._unknown_channels and len(self._unknown_channels) < 1000:
                    self._unknown_channels.add(channel)
                    self.log.add(sample.time, "unknown channel", channel, "no sensor measures it; left out")
                continue
            if len(value) != size:
                raise RecordingError(
                    f"'{channel}' has {len(value)} components; the description says {size}.",
                    advice="Give them in the order of the description.",
                    channel=channel,
                )
            if channel in self.commands.sizes and not np.isfinite(value).all():
                self.log.add(sample.time, "not finite", channel, "is not finite; the command before stays")
                continue
            known[channel] = value
        if known:
            self.buffer.add(sample.time, known)

    def _take_in(
        self, entries: list[MomentEvents], inputs: Inputs | None, *, final: bool = False
    ) -> tuple[Update, ...]:
        out: list[Update] = []
        for first in range(0, len(entries), CHUNK):
            out += self._chunk(entries[first : first + CHUNK], inputs)
        if final and self._settling and not self.moving:
            out += self._settle(inputs, force=True)
        return tuple(out)

    def _chunk(self, entries: list[MomentEvents], inputs: Inputs | None) -> list[Update]:
        out: list[Update] = []
        for entry in entries:
            self.commands.add(entry.time, entry.channels)
        last = entries[-1].time
        while entries:
            if self.moving:
                times = [self.time, *(e.time for e in entries)]
                gap = np.flatnonzero(np.diff(times) > self.setting.silence)
                count = int(gap[0]) if len(gap) else len(entries)
                found = self._go_on(entries[:count], inputs)
                out += found
                entries = entries[count if self.moving else len(found) + 1 :]
                if entries and self.moving:
                    text = f"nothing came for {entries[0].time - self.time:.3g} s: the motion begins anew"
                    self.log.add(entries[0].time, "silence", "", text)
                    self.moving = False
            else:
                self._settling.append(entries[0])
                entries = entries[1:]
                out += self._settle(inputs)
        self.commands.forget(self.time if self.moving else last - SETTLE)
        return out

    def _settle(self, inputs: Inputs | None, *, force: bool = False) -> list[Update]:
        """Begin the motion when every channel was read, or enough time has passed."""
        own = self._settling
        seen = {c for e in own for c, x in e.channels.items() if c in self._shapes and np.isfinite(x).all()}
        if not seen or not (force or len(seen) == len(self._shapes) or own[-1].time - own[0].time >= SETTLE):
            return []
        f = self.filter
        values = np.full((len(own), f.layout.rows), np.nan)
        attitudes = np.full((len(own), len(self._attitudes), QUATERNION), np.nan)
        for k, entry in enumerate(own):
            self._stack(entry, values[k], attitudes[k])
        data = replace(
            f.at.base.outputs.data,
            times=np.array([e.time for e in own]),
            values=values,
            attitude={name: attitudes[:, i] for i, name in enumerate(self._attitudes)},
        )
        belief = initial_belief(f.at.base.model, data, f.locked, self.setting.initial)
        self.begin(belief, own[0].time)
        return self._go_on(own, inputs)

    def _go_on(self, entries: list[MomentEvents], inputs: Inputs | None) -> list[Update]:
        """Take in moments without a silence in between."""
        if not entries:
            return []
        f, setting = self.filter, self.setting
        known = inputs if inputs is not None else self.commands.inputs()
        edges, at = [f.time], []
        for entry in entries:
            edges += fill_times(edges[-1], entry.time, setting.longest).tolist()[1:]
            at.append(len(edges) - 1)
        times = np.array(edges)
        drive = f.drive(known, setting.substep, times, self._before)
        values = np.full((len(times), f.layout.rows), np.nan)
        attitudes = np.zeros((len(times), len(self._attitudes), QUATERNION))
        for entry, k in zip(entries, at, strict=True):
            self._stack(entry, values[k], attitudes[k])
        out: list[Update] = []
        done = 0
        while at:
            # up to where models may be built anew: the same samples one by one and together
            count = 1 + int(np.searchsorted(times[at], self._looks - CLOCK))
            reached, at = at[:count], at[count:]
            f.time, last = float(times[done]), reached[-1]
            here = slice(done, last + 1)
            read = values[here].copy()
            if reached[0] > done:  # where this pass begins was read by the one before
                read[0] = np.nan
            passed = times[here], drive.part(done, last), read, attitudes[here]
            try:
                self.course.enter(f, passed)
                record = f.go_on(*passed)
            except SimulationError:
                if self.rescue is not None and self.rescue():
                    at = reached + at
                    drive = f.drive(known, setting.substep, times, self._before)
                    continue
                if self.time < self._first + WARM:
                    raise
                self._lose()
                return out
            f.time = float(times[last])  # of the entry, not summed up
            before = done
            for k in reached:
                there = np.isfinite(read[k - done])
                part = 0 if count == 1 else min(before + 1, k) - done, k - done
                update = self._update_of(
                    record, part, float(times[k]), float(times[k] - times[before]), there
                )
                before = k
                out.append(update)
                self.samples += 1
                self.watch.hear(update)
                if self.listener is not None:
                    self.listener(update)
            done = last
            if f.time >= self._looks - CLOCK:
                self._looks, changed = self.course.look(f, self._first)
                if changed and f.at.drives:
                    drive = f.drive(known, setting.substep, times, self._before)
        if len(times) > 1:
            self._before = drive.before[-1]
        return out

    def _lose(self) -> None:
        """Say that the motion is lost, and begin anew, parameters too: what was believed has led there."""
        f, start = self.filter, self.start
        self.log.add(f.time, "lost", "", "the motion is lost; it and the parameters begin anew")
        f.values = start.mean.copy()
        f.covariance = f.covariance.copy()
        f.covariance[f.parameters, f.parameters] = start.covariance / np.outer(f.scales, f.scales)
        f.linearise_at(f.values, f.sigmas())
        self.moving, self._settling = False, []

    def _stack(self, entry: MomentEvents, values: np.ndarray, attitudes: np.ndarray) -> None:
        """Write the readings of a moment (rows,), and its attitudes (a, 4); what is not there stays."""
        for block in self.filter.layout.blocks:
            value = entry.channels.get(block.channel)
            if value is None:
                continue
            read = value.reshape(1, block.stations, -1) if block.stations > 1 else value[None]
            errors = block.sensor.error(block.quantity)
            if errors.limited and errors.meaningless(np.array([entry.time]), read).any():
                continue
            if block.quantity != "attitude":
                values[block.rows] = value
                continue
            norm = float(np.sqrt(value @ value))
            if norm < 0.5:
                self.log.add(entry.time, "not finite", block.channel, "is no quaternion; left out")
            elif np.isfinite(norm):
                attitudes[self._attitudes.index(block.channel)], values[block.rows] = value / norm, 0.0
        if not np.isfinite(values).all():  # a channel counts as a whole
            for block in self.filter.layout.blocks:
                if not np.isfinite(values[block.rows]).all():
                    values[block.rows] = np.nan

    def _update_of(
        self, record: Record, part: tuple[int, int], time: float, passed: float, there: np.ndarray
    ) -> Update:
        names, k = self._row_names, part[1]
        here = slice(None) if there.all() else there
        return Update(
            time,
            record.values[k],
            record.sigmas[k],
            names if there.all() else tuple(names[i] for i in np.flatnonzero(there)),
            record.innovations[k, here],
            record.normalised[k, here],
            float(record.log_likelihood[k]),
            passed,
            (record, *part),
        )


_NOTHING = Recording.from_arrays([0.0, 1.0], {"command.force": np.zeros((2, 3))})
