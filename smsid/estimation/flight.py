"""One recording as a filter problem: how joints and wheels are driven, process noise, the initial state."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import pinocchio as pin

from smsid.errors import RecordingError
from smsid.estimation.initial_state import InitialPrior, initial_belief
from smsid.estimation.input_hold import input_channels
from smsid.estimation.input_timing import timings
from smsid.estimation.kalman import Noise, Problem
from smsid.estimation.measurements import Measured, measured
from smsid.estimation.parameter_vector import Point
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording
from smsid.recording.column_order import order_columns

LOGGER = logging.getLogger(__name__)
LONGEST = 0.1  # [s] between times of the filter: what it linearises over
PHASE = 0.3  # [rad] of the fastest mode, the same
UNKNOWN = 3.0  # times its root mean square that a torque which is not known may be
STILL = 5.0  # standard deviations of its noise within which a joint or an attitude stands still
FITTED = 9  # samples of a reading whose parabola gives its rate and acceleration
SHORTEST = 20  # samples a flight needs

Drive = Literal["command", "measured", "locked"]


@dataclass(frozen=True)
class FlightOptions:
    """What is assumed of a flight.

    ``drive``: what moves joints and wheels: ``command``, their recorded torque, is believed exactly;
    ``measured``, their motion: torques are free. ``auto`` takes the motion where it is measured and no listed
    effect has to do with the motor's torque. ``disturbance`` are standard deviations of a force [N] and a
    torque [N m] on the bus that nobody recorded, white from sample to sample.
    """

    drive: Literal["auto", "command", "measured"] = "auto"
    disturbance: tuple[float, float] = (0.0, 0.0)
    initial: InitialPrior = field(default_factory=InitialPrior)


@dataclass(frozen=True)
class Flight:
    """A recording made ready: the filter's problem, and in words what was assumed."""

    label: str
    problem: Problem
    drives: dict[str, Drive]
    notes: tuple[str, ...]


def flight_of(point: Point, recording: Recording, label: str, options: FlightOptions | None = None) -> Flight:
    """Return a recording as a problem for the filter.

    Raises `RecordingError` when it holds nothing the sensors measure, is too short, or does not say what
    drove a joint that is neither measured nor still.
    """
    options = options or FlightOptions()
    model, sensors = point.base, point.description.effective_sensors()
    recording = order_columns(recording, model)
    data = measured(model, recording, sensors, longest_step(model))
    if len(data.times) < SHORTEST:
        raise RecordingError(
            f"'{recording.name}' has {len(data.times)} samples; an estimate needs {SHORTEST}.",
            advice="Record longer.",
            samples=len(data.times),
        )
    inputs = input_channels(model, recording)
    drives, notes = _drives(point, data, inputs, options)
    locked = np.array(sorted(v for v, how in drives.items() if how == "locked"), dtype=int)
    noise = _process_noise(model, recording, data, inputs, drives)
    disturbance, held = _disturbance(model, recording, data, inputs, options)
    noise = replace(noise, force=max(disturbance[0], noise.force), torque=max(disturbance[1], noise.torque))
    notes += held
    begin = initial_belief(model, data, locked, options.initial)
    problem = Problem(recording, data, locked, timings(recording)[0], noise, (), longest_substep(data), begin)
    names = {int(v): n for g in (model.arm_joints, model.wheels) for n, v in zip(g.names, g.v, strict=True)}
    return Flight(label, problem, {names[v]: how for v, how in drives.items()}, tuple(notes))


def longest_step(model: SpacecraftModel) -> float:
    """Return the longest time [s] between two times of the filter that its linearisation allows."""
    if not len(model.spring_v):
        return LONGEST
    mass = pin.crba(model.pin, model.pin.createData(), model.home)
    own = np.maximum(mass.diagonal()[model.spring_v], 1e-12)
    fastest = float(np.sqrt(np.max(model.stiffness / own, initial=0.0)))
    return min(LONGEST, PHASE / max(1.2 * fastest, 1e-9))


def longest_substep(data: Measured) -> float:
    """Return the longest step of the integration [s]: that of the filter, or less where samples are apart."""
    return min(0.025, float(np.median(np.diff(data.times))))


def _drives(
    point: Point, data: Measured, inputs: dict[str, str], options: FlightOptions
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
        moves = _moving(data, seen, len(group))
        for i, (name, v) in enumerate(zip(group.names, group.v, strict=True)):
            commanded = torque in inputs
            if seen and not moves[i] and name not in by_torque:
                drives[int(v)] = "locked"
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


def _moving(data: Measured, blocks: list, size: int) -> np.ndarray:
    """Return which joints (size,) move by more than their sensors' noise; all where none is measured."""
    out = np.zeros(size, dtype=bool)
    for block in blocks:
        x, sigma = data.values[:, block.rows], data.sigma[block.rows]
        spread = np.nanpercentile(x, 99, axis=0) - np.nanpercentile(x, 1, axis=0)
        out |= spread > 2.0 * STILL * sigma
    return out if blocks else np.ones(size, dtype=bool)


def _process_noise(
    model: SpacecraftModel,
    recording: Recording,
    data: Measured,
    inputs: dict[str, str],
    drives: dict[int, Drive],
) -> Noise:
    """Return the process noise: torques of what follows its measured motion are free, the rest is exact."""
    more: list[tuple[int, float]] = []
    mass = np.diag(pin.crba(model.pin, model.pin.createData(), model.home))
    for group, torque, quantities in (
        (model.arm_joints, "joint_torque", ("joint_velocity", "joint_position")),
        (model.wheels, "wheel_torque", ("wheel_rate",)),
    ):
        free = [i for i, v in enumerate(group.v) if drives[int(v)] == "measured"]
        if not free:
            continue
        block = next(b for q in quantities for b in data.blocks if b.quantity == q)
        size = mass[group.v] * _acceleration_rms(data, block)
        if torque in inputs:
            commands = np.asarray(recording[inputs[torque]], dtype=float).reshape(-1, len(group))
            size = np.maximum(size, np.sqrt(np.nanmean(commands**2, axis=0)))
        more += [(int(group.v[i]), UNKNOWN * float(size[i])) for i in free]
    return Noise(more=tuple(more))


def _acceleration_rms(data: Measured, block) -> np.ndarray:
    """Return the root mean square acceleration (k,) of what a channel of angles or rates (N, k) reads."""
    x = data.values[:, block.rows]
    there = np.isfinite(x).all(axis=1)
    t, x = data.times[there], x[there]
    every = max(1, len(t) // 20000)
    half = FITTED // 2
    if len(t) < 2 * FITTED:
        return np.zeros(x.shape[1])
    squares = []
    for k in range(half, len(t) - half, every * half):
        own = slice(k - half, k + half + 1)
        fit = np.polynomial.polynomial.polyfit(t[own] - t[k], x[own], 2)
        squares.append((2.0 * fit[2] if block.quantity == "joint_position" else fit[1]) ** 2)
    return np.sqrt(np.mean(squares, axis=0))


def _disturbance(
    model: SpacecraftModel,
    recording: Recording,
    data: Measured,
    inputs: dict[str, str],
    options: FlightOptions,
) -> tuple[tuple[float, float], list[str]]:
    """Return the standard deviations of unrecorded force and torque on the bus, and a note where assumed."""
    force, torque = options.disturbance
    rates = [b for b in data.blocks if b.quantity == "angular_rate"]
    if torque > 0.0 or not (model.free and "force" in inputs and rates):
        return (force, torque), []
    thrust = float(np.nanmax(np.abs(np.asarray(recording[inputs["force"]])), initial=0.0))
    others = [inputs[x] for x in ("torque", "wheel_torque") if x in inputs]
    if (
        thrust == 0.0
        or any(np.any(np.asarray(recording[c])) for c in others)
        or _moving(data, rates, 3).any()
    ):
        return (force, torque), []
    lever = float(np.linalg.norm(model.thrust_point)) + 1.0
    note = "the attitude stands still under thrust: held by torques that are not recorded, and taken as free"
    return (force, UNKNOWN * thrust * lever), [note]
