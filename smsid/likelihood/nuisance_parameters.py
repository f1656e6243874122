"""What belongs to one recording alone: its initial pose, biases, gains and scales, and its joints' motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from smsid.likelihood.channels import Channel
from smsid.likelihood.inputs import DrivenMotion

START = {"position": 100.0, "attitude": 1.0}  # priors of the initial pose [m, rad]
BIAS = {"acceleration": 0.1, "angular_rate": 0.01}  # priors of biases [m/s^2, rad/s]
CLOCK = {"offset": 0.1, "drift": 1e-2}  # priors of clocks [s, 1]
CLOCK_KINDS = ("clock_offset", "clock_drift")
SWITCH = "switch_time"


@dataclass(frozen=True)
class Nuisance:
    """Which nuisance parameters are estimated beside biases and initial pose, by their prior's sigma.

    ``thrust_gain``: relative error of the thrust per axis [1]; ``scale``: relative scale error of a channel
    by name [1]. What is not given is taken as zero: masses are known only as well as the thrust is.
    ``clocks``: sensors whose clock is off by a constant and drifts; others are put to the test (`clocks`).
    ``driving_clocks``: those of encoders and tachometers in free floating are, against all the others.
    """

    biases: bool = True
    thrust_gain: float | None = None
    scale: Mapping[str, float] | None = None
    clocks: tuple[str, ...] = ()
    driving_clocks: bool = True


@dataclass(frozen=True)
class NuisanceValues:
    """What belongs to one recording alone.

    ``position`` (3,) [m] and ``quaternion`` (4,) of the bus at the start; ``gain`` (3,) relative thrust
    error; ``bias`` (k,) and ``scale`` by channel; ``motion`` (m, joints) spline coefficients of the joints;
    ``clock`` (2,) by sensor: what it shows too much at the start [s], and drift [1]. ``switch`` (k,) are the
    times at which thrust switches [s], where they are sought.
    """

    position: np.ndarray
    quaternion: np.ndarray
    gain: np.ndarray
    bias: dict[str, np.ndarray]
    scale: dict[str, float]
    motion: np.ndarray
    clock: dict[str, np.ndarray]
    switch: np.ndarray = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class NuisanceIndex:
    """Where one group of local parameters stands in the step of a piece, with the prior's sigma and unit, and
    its ``mean`` (size,) where that is not zero; ``sigmas`` (size,) where they differ.
    """

    kind: str
    channel: str
    start: int
    size: int
    sigma: float
    unit: str
    mean: tuple[float, ...] = ()
    sigmas: tuple[float, ...] = ()


def slots_of(
    channels: Sequence[Channel], nuisance: Nuisance, driving: Sequence[str] = ()
) -> tuple[NuisanceIndex, ...]:
    """Return where the local parameters of a recording stand, those of the joints' motion left out.

    ``driving``: the sensors whose readings drive the prediction.
    """
    found: list[NuisanceIndex] = []

    def add(kind: str, channel: str, size: int, sigma: float, unit: str) -> None:
        found.append(NuisanceIndex(kind, channel, sum(s.size for s in found), size, sigma, unit))

    add("initial_position", "", 3, START["position"], "m")
    add("initial_attitude", "", 3, START["attitude"], "rad")
    if nuisance.thrust_gain is not None:
        add("thrust_gain", "", 3, nuisance.thrust_gain, "1")
    for c in channels:
        if nuisance.biases and c.biased:
            unit = "rad/s" if c.quantity == "angular_rate" else "m/s^2"
            errors = c.sensor.error(c.quantity)
            stated = np.hypot(np.asarray(errors.bias_sigma, dtype=float), errors.gauss_markov_sigma)
            add("bias", c.name, c.width, float(stated.max()) or BIAS[c.quantity], unit)
    for c in channels:
        if nuisance.scale and c.name in nuisance.scale:
            add("scale", c.name, 1, nuisance.scale[c.name], "1")
    doubted = {c.sensor.name for c in channels} & set(nuisance.clocks)
    for name in sorted(doubted) + (list(driving) if nuisance.driving_clocks else []):
        found += clock_slots(name, sum(s.size for s in found))
    return tuple(found)


def clock_slots(sensor: str, start: int) -> tuple[NuisanceIndex, NuisanceIndex]:
    """Return where offset and drift of a sensor's clock stand, from ``start`` on."""
    return (
        NuisanceIndex("clock_offset", sensor, start, 1, CLOCK["offset"], "s"),
        NuisanceIndex("clock_drift", sensor, start + 1, 1, CLOCK["drift"], "1"),
    )


def initial(
    slots: Sequence[NuisanceIndex], drive: DrivenMotion, channels: Sequence[Channel]
) -> NuisanceValues:
    """Return where the search starts: pose from the mean of the first samples, all else zero."""
    attitude, position = np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3)
    for c in channels:
        if c.quantity == "attitude":
            # a held attitude is constant; a free one starts at rest
            first = c.values if drive.held else c.values[:10]
            attitude = Rotation.from_quat(first).mean().as_quat()
    for c in channels:
        if c.quantity == "position":
            offset = Rotation.from_quat(attitude).apply(np.asarray(c.sensor.position))
            position = c.values[:10].mean(axis=0) - offset
    bias = {s.channel: np.zeros(s.size) for s in slots if s.kind == "bias"}
    scale = {s.channel: 0.0 for s in slots if s.kind == "scale"}
    motion = drive.joints.coefficients if drive.joints is not None else np.zeros((0, 0))
    return NuisanceValues(position, attitude, np.zeros(3), bias, scale, motion, zero_clocks(slots))


def zero_clocks(slots: Sequence[NuisanceIndex]) -> dict[str, np.ndarray]:
    """Return clocks (2,) by sensor that show nothing too much."""
    return {s.channel: np.zeros(2) for s in slots if s.kind == "clock_offset"}


def moved(slots: Sequence[NuisanceIndex], local: NuisanceValues, step: np.ndarray) -> NuisanceValues:
    """Return the local values a step (size,) away; the pose moves in the bus frame."""
    position, quaternion, gain = local.position, local.quaternion, local.gain
    bias, scale, clock, switch = dict(local.bias), dict(local.scale), dict(local.clock), local.switch
    turn = Rotation.from_quat(local.quaternion)
    for s in slots:
        part = step[s.start : s.start + s.size]
        if s.kind == "initial_position":
            position = position + turn.apply(part)
        elif s.kind == "initial_attitude":
            quaternion = (turn * Rotation.from_rotvec(part)).as_quat()
        elif s.kind == "thrust_gain":
            gain = gain + part
        elif s.kind == "bias":
            bias[s.channel] = bias[s.channel] + part
        elif s.kind in CLOCK_KINDS:
            clock[s.channel] = clock[s.channel] + np.eye(2)[CLOCK_KINDS.index(s.kind)] * part
        elif s.kind == SWITCH:
            switch = switch + part
        else:
            scale[s.channel] = scale[s.channel] + float(part[0])
    return NuisanceValues(position, quaternion, gain, bias, scale, local.motion, clock, switch)


def values(slots: Sequence[NuisanceIndex], local: NuisanceValues) -> np.ndarray:
    """Return the local values (size,); the initial attitude as rotation vector."""
    out = np.zeros(sum(s.size for s in slots))
    for s in slots:
        match s.kind:
            case "initial_position":
                value = local.position
            case "initial_attitude":
                value = Rotation.from_quat(local.quaternion).as_rotvec()
            case "thrust_gain":
                value = local.gain
            case "switch_time":
                value = local.switch
            case _:
                value = deviation(s, local)
        out[s.start : s.start + s.size] = value
    return out


def deviation(slot: NuisanceIndex, local: NuisanceValues) -> np.ndarray:
    """Return how far the values of a slot (size,) are from where its prior has them.

    The initial pose has its prior where it is: the weight keeps what no sensor sees from running off.
    """
    match slot.kind:
        case "thrust_gain":
            return local.gain
        case "bias":
            return local.bias[slot.channel]
        case "scale":
            return np.array([local.scale[slot.channel]])
        case "clock_offset" | "clock_drift":
            return local.clock[slot.channel][CLOCK_KINDS.index(slot.kind)][None]
        case "switch_time":
            return local.switch - np.array(slot.mean)
    return np.zeros(slot.size)
