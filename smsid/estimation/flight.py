"""One recording as a filter problem: how joints and wheels are driven, process noise, the initial state."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
import pinocchio as pin

from smsid.errors import RecordingError, SmsidError
from smsid.estimation._followed_torques import followed_torques
from smsid.estimation._sensor_uncertainty import reading_uncertainty
from smsid.estimation._torque_walk import UNKNOWN_FACTOR
from smsid.estimation.bias_walk import bias_walks, with_walk_noise
from smsid.estimation.initial_state import InitialPrior, initial_belief
from smsid.estimation.input_hold import (
    SHARES,
    input_channels,
    is_mixed_hold,
    is_stepwise,
    thruster_shares,
)
from smsid.estimation.input_timing import timings
from smsid.estimation.measurements import (
    COMPONENTS,
    OUTLIER_SIGMAS,
    ChannelSlice,
    Measurements,
    measurements_of,
)
from smsid.estimation.parameter_vector import Point
from smsid.estimation.problem import CommandTiming, Problem, ProcessNoise, UnknownInput
from smsid.identify.sensor_correction import without_known_errors
from smsid.model.column_order import order_columns
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording
from smsid.recording.checks.sample_faults import outliers

LOGGER = logging.getLogger(__name__)
PART_OF_THRUST = 1e-3  # of full thrust, within which a share is none, or all
LONGEST_STEP = 0.1  # [s] between times of the filter: what it linearises over
LARGEST_PHASE = 0.3  # [rad] of the fastest mode, the same
STILL_SIGMAS = 5.0  # standard deviations of its noise within which a joint or an attitude stands still
FEWEST_SAMPLES = 20  # samples a flight needs
FEWEST_FOR_OUTLIERS = 20  # readings of a component from twice which on its outliers can be told

Drive = Literal["command", "measured", "locked"]
DriveOption = Literal["auto", "command", "measured"]


@dataclass(frozen=True)
class FlightOptions:
    """What is assumed of a flight.

    ``drive``: what moves joints and wheels: ``command``, their recorded torque, is believed exactly;
    ``measured``, their motion: torques are free. ``auto`` takes the motion where it is measured and no listed
    effect has to do with the motor's torque. ``force`` [N] and ``torque`` [N m] on the bus that nobody
    recorded are estimated where their standard deviation at the start and the rate of their random walk
    [per sqrt(s)] are given, body axes.
    """

    drive: DriveOption = "auto"
    force: tuple[float, float] | None = None
    torque: tuple[float, float] | None = None
    initial: InitialPrior = field(default_factory=InitialPrior)

    def __post_init__(self) -> None:
        """Raise `SmsidError` for a drive that there is not."""
        if self.drive not in get_args(DriveOption):
            raise SmsidError(
                f"There is no drive '{self.drive}'.", advice=f"Use {', '.join(get_args(DriveOption))}."
            )


@dataclass(frozen=True)
class Flight:
    """A recording made ready: the filter's problem, and in words what was assumed.

    ``model`` is the described one, which says how many degrees of freedom there are and what drives them.
    """

    label: str
    model: SpacecraftModel
    problem: Problem
    drives: dict[str, Drive]
    notes: tuple[str, ...]


def flight_of(
    point: Point,
    recording: Recording,
    label: str,
    options: FlightOptions | None = None,
    *,
    shift: float = 0.0,
) -> Flight:
    """Return a recording as a problem for the filter; it is ``shift`` [s] later there than by its own clock.

    Effects of the point begin by the clock of the problem (`on_shifted_clock`).

    Raises `RecordingError` when it holds nothing the sensors measure, is too short, or does not say what
    drove a joint that is neither measured nor still.
    """
    options = options or FlightOptions()
    model, sensors = point.base, point.description.effective_sensors()
    recording = recording.shifted(shift)
    known = without_known_errors(recording, sensors)
    doubts = [f"doubtful: {said}" for said in known.check_consistency()]
    recording = order_columns(recording, model)
    data = measurements_of(model, recording, sensors, longest_step(model))
    if len(data.times) < FEWEST_SAMPLES:
        raise RecordingError(
            f"'{recording.name}' has {len(data.times)} samples; an estimate needs {FEWEST_SAMPLES}.",
            advice="Record longer.",
            samples=len(data.times),
        )
    doubts += _without_noise(data)
    data, dropped = _without_outliers(data)
    data = with_walk_noise(data)
    inputs = input_channels(model, recording)
    drives, notes = _drives(point, recording, data, inputs, options)
    locked = np.array(sorted(v for v, how in drives.items() if how == "locked"), dtype=int)
    followed = [v for v, how in drives.items() if how == "measured"]
    unknown = followed_torques(model, recording, data, followed)
    further, held = _disturbances(model, recording, data, inputs, options)
    problem = Problem(
        recording,
        data,
        locked,
        likely_timing(recording),
        ProcessNoise(),
        substep=longest_substep(data),
        begin=initial_belief(model, data, locked, options.initial, reading_uncertainty(point, data)),
        unknown_inputs=(*unknown, *further),
        bias_walks=bias_walks(data),
        shift=shift,
    )
    notes += held + dropped + doubts + _without_switching_times(model, recording, inputs)
    names = {int(v): n for g in (model.arm_joints, model.wheels) for n, v in zip(g.names, g.v, strict=True)}
    return Flight(label, model, problem, {names[v]: how for v, how in drives.items()}, tuple(notes))


def _without_switching_times(
    model: SpacecraftModel, recording: Recording, inputs: dict[str, str]
) -> list[str]:
    """Return a note where thrusters fire at a share of their thrust: of a pulse that is only its mean."""
    field = next((f for f in SHARES if f in inputs), None)
    if field is None:
        return []
    channel = inputs[field]
    shares = thruster_shares(model, field, np.asarray(recording[channel], dtype=float))
    shares = shares[:, [t.pulse == "spread" for t in model.description.thruster]]
    if not shares.size:
        return []
    part = np.mean((shares > PART_OF_THRUST) & (shares < 1.0 - PART_OF_THRUST))
    if part == 0.0:
        return []
    return [
        f"{100 * part:.0f} % of '{channel}' are between no and full thrust, taken as thrust all through "
        'their sample: of valves that open once in it say where, by `pulse = "begin"` of the [[thruster]]'
    ]


def _without_noise(data: Measurements) -> list[str]:
    """Return which channels repeat one value although noise is stated that would change it."""
    said = []
    for block in data.blocks:
        step = block.sensor.error(block.quantity).quantisation
        read = data.values[:, block.rows]
        if block.quantity == "attitude":
            read = data.attitude[block.channel]
        read = read[np.isfinite(read).all(axis=1)]
        # encoders and tachometers may count: what stands still then reads the same
        if block.quantity in COMPONENTS and len(read) and step == 0.0 and not np.ptp(read, axis=0).any():
            said.append(
                f"doubtful: '{block.channel}' repeats one value, though noise of "
                f"{data.sigma[block.rows].max():.3g} is stated; leave the channel out"
            )
    return said


def _without_outliers(data: Measurements) -> tuple[Measurements, list[str]]:
    """Return the readings without isolated outliers, and what was left out, in words."""
    bad = np.zeros(data.values.shape, dtype=bool)
    for block in data.blocks:
        if block.quantity == "attitude":
            continue
        for row in range(block.rows.start, block.rows.stop):
            there = np.flatnonzero(np.isfinite(data.values[:, row]))
            if len(there) > 2 * FEWEST_FOR_OUTLIERS:
                bad[there, row] = outliers(data.values[there, row], OUTLIER_SIGMAS * data.sigma[row])
    if not bad.any():
        return data, []
    notes = [
        f"{bad[:, row].sum()} isolated outliers of {data.names[row]} left out"
        for row in np.flatnonzero(bad.any(axis=0))
    ]
    return data.without(bad), notes


def likely_timing(recording: Recording) -> CommandTiming:
    """Return how commands act between samples, as the recording says or as they look."""
    choices = timings(recording)
    looks = "jumps" if is_mixed_hold(recording) else "held" if is_stepwise(recording) else "linear"
    return next((t for t in choices if t.hold == looks), choices[0])


def longest_step(model: SpacecraftModel) -> float:
    """Return the longest time [s] between two times of the filter that its linearisation allows."""
    if not len(model.spring_v):
        return LONGEST_STEP
    mass = pin.crba(model.pin, model.pin.createData(), model.home)
    own = np.maximum(mass.diagonal()[model.spring_v], 1e-12)
    fastest = float(np.sqrt(np.max(model.stiffness / own, initial=0.0)))
    return min(LONGEST_STEP, LARGEST_PHASE / max(1.2 * fastest, 1e-9))


def longest_substep(data: Measurements) -> float:
    """Return the longest step of the integration [s]: that of the filter, or less where samples are apart."""
    return min(0.025, float(np.median(np.diff(data.times))))


def _drives(
    point: Point, recording: Recording, data: Measurements, inputs: dict[str, str], options: FlightOptions
) -> tuple[dict[int, Drive], list[str]]:
    """Return how every joint and wheel is driven, by its index in v, and what there is to say of it."""
    model = point.base
    by_torque = {n for e in point.description.effect if e.unknowns() for n in e.driven_joints()}
    drives: dict[int, Drive] = {}
    notes: list[str] = []
    groups = (
        (model.arm_joints, "joint_torque", ("joint_position", "joint_velocity"), "joints"),
        (model.wheels, "wheel_torque", ("wheel_rate",), "wheels"),
    )
    for group, torque, quantities, kind in groups:
        if not len(group):
            continue
        seen = [b for b in data.blocks if b.quantity in quantities]
        moves = _moving_joints(data, seen, len(group))
        for i, (name, v) in enumerate(zip(group.names, group.v, strict=True)):
            commanded = torque in inputs
            if seen and not moves[i] and name not in by_torque:
                drives[int(v)] = "locked"
                if kind == "wheels" and commanded and np.any(np.asarray(recording[inputs[torque]])[:, i]):
                    notes.append(
                        f"doubtful: {seen[0].channel} says that '{name}' stands still while {inputs[torque]} "
                        "drives it; leave the channel out if the wheel turned"
                    )
            elif commanded and (options.drive == "command" or name in by_torque or not seen):
                drives[int(v)] = "command"
            elif seen and options.drive != "command":
                drives[int(v)] = "measured"
            elif not seen and not commanded:
                drives[int(v)] = "locked"
                notes.append(f"'{name}' is neither measured nor commanded: taken as held still")
            else:
                raise RecordingError(
                    f"What drives '{name}' is not recorded.",
                    advice=f"Record command.{torque}, or leave out --drive command.",
                    joint=name,
                )
        own = [drives[int(v)] for v in group.v]
        for how, text in (
            ("measured", "follow their measured motion: their torques and friction do not enter"),
            ("command", f"are driven by {inputs.get(torque, torque)}, taken as exact"),
            ("locked", "stand still"),
        ):
            named = [n for n, h in zip(group.names, own, strict=True) if h == how]
            if named:
                notes.append(f"{kind} {', '.join(named)} {text}")
    return drives, notes


def _moving_joints(data: Measurements, blocks: list[ChannelSlice], size: int) -> np.ndarray:
    """Return which joints (size,) move by more than their sensors' noise; all where none is measured.

    So does a wheel at a constant speed.
    """
    out = np.zeros(size, dtype=bool)
    for block in blocks:
        x, sigma = data.values[:, block.rows], data.sigma[block.rows]
        low, high = np.nanpercentile(x, 1, axis=0), np.nanpercentile(x, 99, axis=0)
        out |= high - low > 2.0 * STILL_SIGMAS * sigma
        if block.quantity == "wheel_rate":
            out |= np.maximum(low, -high) > STILL_SIGMAS * sigma
    return out if blocks else np.ones(size, dtype=bool)


def _disturbances(
    model: SpacecraftModel,
    recording: Recording,
    data: Measurements,
    inputs: dict[str, str],
    options: FlightOptions,
) -> tuple[list[UnknownInput], list[str]]:
    """Return unrecorded forces and torques on the bus, and a note where they are assumed."""
    if not model.free:
        return [], []
    found, notes = [], []
    for first, given in ((0, options.force), (3, options.torque)):
        if given is not None:
            found += [UnknownInput(first + i, *given) for i in range(3)]
    rates = [b for b in data.blocks if b.quantity == "angular_rate"]
    if options.torque is None and "force" in inputs and rates:
        thrust = float(np.nanmax(np.abs(np.asarray(recording[inputs["force"]])), initial=0.0))
        others = [inputs[x] for x in ("torque", "wheel_torque") if x in inputs]
        turned = any(np.any(np.asarray(recording[c])) for c in others) or bool(
            _moving_joints(data, rates, 3).any()
        )
        if thrust > 0.0 and not turned:
            size = UNKNOWN_FACTOR * thrust * (float(np.linalg.norm(model.thrust_point)) + 1.0)
            walk = 0.5 * size / float(np.sqrt(np.median(np.diff(data.times))))
            found += [UnknownInput(3 + i, size, walk) for i in range(3)]
            notes.append("the attitude stands still under thrust: the torques that hold it are estimated")
    return found, notes
