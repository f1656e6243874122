"""What a recording says about an arm's joints: readings at the joints, in stretches without gaps."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from smsid.arm.joints import unlabelled_error, with_joint_order
from smsid.arm.units import slides
from smsid.effects.gear import gear_matrix, gears_of
from smsid.effects.joint_bias import encoder_zeros
from smsid.errors import RecordingError
from smsid.model.spacecraft import JointGroup, JointLimits, SpacecraftModel
from smsid.recording import Recording
from smsid.recording.checks.sample_faults import outliers

MOTOR = "motor"
"""Source of channels measured at the motors; every other source is at the joints."""

GAP = 5.0
"""Median steps from which on a step is a gap."""

TINY = 1e-9
"""Size below which nothing is an outlier [rad | m, rad/s | m/s, N m | N]."""

TURN = 2.0 * np.pi
JUMP = 0.25
"""How far a jump may be from whole turns, as a share of a turn, to be the encoder's and not the joint's."""


BEYOND = 5.0
"""Times the span of its limits that a joint's angles may span: more is another unit."""


@dataclass(frozen=True)
class JointReadings:
    """What was measured, at the joints, each on its own clock and in the model's order of joints.

    ``position_time`` (N,) [s] and ``position`` (N, joints) [rad | m]; ``velocity_time`` (K,) and ``velocity``
    (K, joints), empty where no rate was measured; ``torque_time`` (M,) and ``torque`` (M, joints)
    [N m | N]; ``temperature_time``, ``temperature`` (L, joints) [degC], empty where it was not measured. Rows
    with a sample missing are left out, and with isolated outliers, which ``outliers`` counts by channel and
    joint. ``unwrapped`` counts the whole turns that encoders jumped by, by joint.
    """

    position_time: np.ndarray
    position: np.ndarray
    velocity_time: np.ndarray
    velocity: np.ndarray
    torque_time: np.ndarray
    torque: np.ndarray
    unwrapped: dict[str, int]
    temperature_time: np.ndarray = field(default_factory=lambda: np.zeros(0))
    temperature: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    outliers: dict[str, int] = field(default_factory=dict)

    def temperature_at(self, times: np.ndarray) -> np.ndarray | None:
        """Return the temperatures (n, joints) [degC] at times (n,), between samples by straight lines;
        ``None`` where none was measured.
        """
        if not self.temperature.size:
            return None
        return np.column_stack([np.interp(times, self.temperature_time, x) for x in self.temperature.T])

    @property
    def stretches(self) -> tuple[slice, ...]:
        """Stretches of the positions without a gap."""
        steps = np.diff(self.position_time)
        cuts = np.flatnonzero(steps > GAP * np.median(steps)) + 1
        edges = [0, *cuts.tolist(), len(self.position_time)]
        return tuple(slice(a, b) for a, b in itertools.pairwise(edges))


def joint_readings(model: SpacecraftModel, recording: Recording, *, velocity: bool = True) -> JointReadings:
    """Return the readings of a recording at the joints.

    Channels of the source ``motor`` are taken to the joints by the description's `Gear` effects;
    `JointOffset` effects are added to the angles. Encoders that begin anew after each turn are unwrapped.

    Args:
        model: a welded arm.
        recording: with ``<source>.joint_position`` and ``<source>.joint_torque``; ``joint_velocity`` is taken
            where it was measured.
        velocity: whether to take measured rates.

    Raises:
        RecordingError: a channel is missing, joints are unlabelled or not the model's, nothing moves, or an
            encoder jumps by a turn that its joint cannot make.
        DescriptionError: the gears do not fit.
    """
    position, torque = (measured_channel(recording, q) for q in ("joint_position", "joint_torque"))
    recording, names = with_joint_order(model, recording), model.arm_joints.names
    order = np.argsort(model.arm_joints.v)
    gears = gears_of(model.description.effect)
    found: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    turns: dict[str, int] = {}
    spiked: dict[str, int] = {}
    channels = {"position": position, "torque": torque}
    for what in ("velocity", "temperature") if velocity else ("temperature",):
        told = _measured_channels(recording, f"joint_{what}")
        channels |= {what: told[0]} if len(told) == 1 else {}
    for what, channel in channels.items():
        values, times = np.asarray(recording[channel], dtype=float), np.asarray(recording.time(channel))
        whole = np.isfinite(values).all(axis=1) & np.isfinite(times)
        values, times = values[whole], times[whole]
        if len(values) < (2 if what == "temperature" else 50):
            raise RecordingError(
                f"'{channel}' has {len(values)} whole samples.", advice="Record longer.", channel=channel
            )
        at_motor = channel.startswith(f"{MOTOR}.")
        if what == "position":
            values, turns = _unwrap_angles(model, names, values, channel, at_motor=at_motor)
        if what != "temperature":
            spikes = np.column_stack([outliers(column, TINY) for column in values.T])
            counts = zip(names, spikes.sum(axis=0).tolist(), strict=True)
            spiked |= {f"'{channel}' {name}": count for name, count in counts if count}
            values, times = values[~spikes.any(axis=1)], times[~spikes.any(axis=1)]
        if at_motor and what != "temperature":
            matrix, gain = gear_matrix(gears, names)
            values = (values * gain) @ matrix if what == "torque" else np.linalg.solve(matrix, values.T).T
        if what == "position":
            zero = encoder_zeros(model.description.effect)
            values = values + np.array([zero.get(name, 0.0) for name in names])
            _require_limits(model, names, values, channel)
        found[what] = times, values[:, order]
    none = np.zeros(0), np.zeros((0, len(names)))
    return JointReadings(
        *found["position"],
        *found.get("velocity", none),
        *found["torque"],
        turns,
        *found.get("temperature", none),
        spiked,
    )


def without_turns(model: SpacecraftModel, recording: Recording) -> Recording:
    """Return the recording with encoders that begin anew after each turn unwrapped.

    Raises:
        RecordingError: as `joint_readings`.
    """
    channel = measured_channel(recording, "joint_position")
    ordered = with_joint_order(model, recording)
    at_motor = channel.startswith(f"{MOTOR}.")
    values, turns = _unwrap_angles(
        model, model.arm_joints.names, np.asarray(ordered[channel]), channel, at_motor=at_motor
    )
    return ordered.with_channels({channel: values}) if turns else ordered


def with_passive_joints(recording: Recording, joints: Sequence[str]) -> Recording:
    """Return the recording with torques of zero at joints that no motor drives.

    Such a joint bends: a gear or a link that gives, whose deflection is recorded as the joint's position.

    Raises:
        RecordingError: as `measured_channel`, or its joints have no names.
    """
    channel = measured_channel(recording, "joint_torque")
    source, dim = channel.partition(".")[0], list(recording.columns(channel))[-1]
    if dim not in recording.labels:
        raise unlabelled_error(channel)
    known, values = recording.labels[dim], np.asarray(recording[channel], dtype=float)
    torque = np.where(np.isin(known, joints), 0.0, values)
    new = [j for j in joints if j not in known]
    torque = np.hstack([torque, np.zeros((len(torque), len(new)))])
    return with_joint_torque(recording, torque, source if source == MOTOR else "joints", (*known, *new))


def with_joint_torque(
    recording: Recording, torque: np.ndarray, source: str, joints: Sequence[str] | None
) -> Recording:
    """Return the recording with other torques (N, joints) [N m | N] of its times, of another source."""
    channel = measured_channel(recording, "joint_torque")
    labels = {f"{source}.joint": joints} if joints else None
    new = {f"{source}.joint_torque": (np.asarray(recording.time(channel)), torque)}
    return recording.without(channel).with_channels(new, labels=labels)


def measured_channel(recording: Recording, quantity: str) -> str:
    """Return the name of the channel of a quantity: measured rather than commanded.

    Raises:
        RecordingError: none, or several.
    """
    commanded = f"command.{quantity}"
    chosen = _measured_channels(recording, quantity) or [n for n in recording.channels if n == commanded]
    if len(chosen) != 1:
        raise RecordingError(
            f"The recording has {len(chosen)} channels of '{quantity}' to choose from: "
            f"{', '.join(chosen) or 'none'}.",
            advice=f"It takes exactly one, such as 'encoder.{quantity}', or '{MOTOR}.{quantity}' at the "
            "motors; leave the others out with recording.without(...).",
            quantity=quantity,
            found=tuple(chosen),
        )
    return chosen[0]


def _measured_channels(recording: Recording, quantity: str) -> list[str]:
    own = (n for n in recording.channels if n.endswith(f".{quantity}"))
    return [n for n in own if not n.startswith(("command.", "truth."))]


def whole_turns(values: np.ndarray) -> np.ndarray:
    """Return the whole turns (N, joints) that an encoder has jumped by up to every sample [turns].

    A jump counts when it is a whole number of turns but for `JUMP`, and the steps beside it are small.
    """
    steps = np.diff(values, axis=0)
    turns = np.round(steps / TURN)
    near = np.abs(steps - TURN * turns) < JUMP * TURN
    usual = 10.0 * np.median(np.abs(steps), axis=0) + 0.05 * TURN
    jumps = np.where(near & (turns != 0.0) & (np.abs(steps - TURN * turns) < usual), -turns, 0.0)
    return np.vstack([np.zeros((1, values.shape[1])), np.cumsum(jumps, axis=0)])


def _limits(model: SpacecraftModel, names: tuple[str, ...]) -> JointLimits:
    return JointLimits.of(model.pin, JointGroup.of(model.pin, [model.pin.getJointId(name) for name in names]))


def _unwrap_angles(
    model: SpacecraftModel, names: tuple[str, ...], values: np.ndarray, channel: str, *, at_motor: bool
) -> tuple[np.ndarray, dict[str, int]]:
    turns, limits = whole_turns(values), _limits(model, names)
    jumped = {}
    for k, name in enumerate(names):
        count = int(np.count_nonzero(np.diff(turns[:, k])))
        if not count or (slides(model, name) and not at_motor):
            continue
        span = limits.upper[k] - limits.lower[k]
        if not at_motor and not span >= TURN:
            first = int(np.flatnonzero(np.diff(turns[:, k]))[0]) + 1
            raise RecordingError(
                f"'{channel}' of joint '{name}' jumps by a whole turn {count} times, first at sample "
                f"{first}, but its limits in the URDF leave it {np.degrees(span):.0f} degrees.",
                advice="Mend the encoder's zero in the log, or the joint's limits or type in the URDF.",
                joint=name,
                jumps=count,
                sample=first,
            )
        jumped[name] = count
        values = np.array(values)
        values[:, k] += TURN * turns[:, k]
    return values, jumped


def _require_limits(model: SpacecraftModel, names: tuple[str, ...], values: np.ndarray, channel: str) -> None:
    """Refuse angles that no joint of these limits can have: they are in another unit."""
    limits = _limits(model, names)
    for k, name in enumerate(names):
        low, high = float(limits.lower[k]), float(limits.upper[k])
        least, most = float(values[:, k].min()), float(values[:, k].max())
        if not most - least > BEYOND * (high - low):
            continue
        unit, other = ("m", "mm") if slides(model, name) else ("rad", "degrees, or before its gear")
        raise RecordingError(
            f"'{channel}' of joint '{name}' is from {least:.4g} to {most:.4g} {unit}; its limits in the URDF "
            f"are {low:.4g} and {high:.4g}: is it in {other}?",
            advice="State the unit of this column in the mapping, or mend the joint's limits in the URDF.",
            joint=name,
            span=most - least,
            limits=(low, high),
        )
