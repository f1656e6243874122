"""What a recording says was commanded, as means over the steps of an integration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from smsid.errors import RecordingError
from smsid.inputs.changed import Delayed, Switched
from smsid.inputs.pulses import Pulse, switched
from smsid.inputs.signals import Constant, Sampled, Signal, Sum, sample
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording
from smsid.simulate import Inputs

Hold = Literal["held", "linear", "smooth", "jumps"]
JUMP_RATIO = 5.0  # times its neighbours' changes together that a change is a jump between samples
RAMP_SHARE = 1e-9  # share of a sample interval that a jump takes: less than `limits` looks aside
WAVE_CHANGES = 10  # least number of neighbouring changes that tell a wave
VARYING: tuple[Hold, ...] = ("linear", "smooth")  # without jumps, so without a side of one
CURVED_SHARE = 1e-5  # of a command's size: by how much a cubic leaves the straight line before it matters;
# parameters known to 1e-4 leaned by 4 standard deviations where a share of 1e-4 was left out

DEGREE: dict[Hold, int] = {"held": 0, "linear": 1, "jumps": 1, "smooth": 3}
COMMANDS = {
    "force": "command.force",
    "torque": "command.torque",
    "thruster": "command.thruster",
    "thruster_force": "command.thruster_force",
    "wheel_torque": "command.wheel_torque",
    "joint_torque": "command.joint_torque",
}
OVER = 1e-6  # share of a sample by which rounding may have a pulse longer than it
SHARES = ("thruster", "thruster_force")  # the same, of full thrust and in newtons
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)


def commanded_inputs(
    model: SpacecraftModel, recording: Recording, hold: Hold, *, required: bool = True, slowly: bool = False
) -> Inputs:
    """Return the commanded inputs of a recording; between samples they are held or vary linearly.

    ``"smooth"`` ones follow a cubic spline: telemetry that is slow beside what it commands. With ``"jumps"``
    they vary linearly but where they jump: there the sample before is held until the one after, or with
    ``slowly`` not: what jumps goes straight from the one to the other, and what is held is otherwise. So are
    thrusters that switch beside wheels or a torque that do not; where their pulses lie in a sample is known,
    they are held in any case. What is not commanded but measured (``<sensor>.joint_torque``, say) stands in.

    Its columns are in the model's order (`order_columns`).

    Raises `RecordingError` when nothing is commanded at all and that is ``required``: a diagnosis needs to
    know what drove the motion.
    """
    signals: dict[str, Signal | None] = dict.fromkeys(COMMANDS)
    for field, channel in input_channels(model, recording).items():
        values = np.asarray(recording[channel])
        times = np.asarray(recording.time(channel), dtype=float)
        if field in SHARES and has_pulses(model):
            shares = thruster_shares(model, field, values)
            signals["thruster"] = pulsed_thrust(model, times, shares, channel)
            continue
        degree, flat = DEGREE[hold], values.reshape(len(values), -1)
        if slowly and hold == "held" and jump_intervals(flat).any():
            (times, values), degree = _with_ramps(times, flat, ~jump_intervals(flat)), 1
        elif hold == "jumps" and not slowly:
            times, values = _with_ramps(times, flat, jump_intervals(flat))
        if field in SHARES:
            field, values = "thruster", thruster_shares(model, field, values)
        signals[field] = Sampled.from_samples(times, values, degree)
    if required and all(s is None for s in signals.values()):
        raise RecordingError(
            f"The recording '{recording.name}' has no command.* channel.",
            advice="Record what was commanded: " + ", ".join(COMMANDS.values()) + ".",
            channels=recording.channels,
        )
    signals.pop("thruster_force")
    return Inputs(**signals)  # type: ignore[arg-type]


def thruster_shares(model: SpacecraftModel, field: str, values: np.ndarray) -> np.ndarray:
    """Return shares of full thrust (N, thrusters) of what an input among `SHARES` says of it."""
    full = [t.force for t in model.description.thruster] if field == "thruster_force" else 1.0
    return values.reshape(len(values), -1) / full


def has_pulses(model: SpacecraftModel) -> bool:
    """Whether some thruster is a valve that is open for a part of each sample, at a place that is known."""
    return any(t.pulse != "spread" for t in model.description.thruster)


def pulsed_thrust(model: SpacecraftModel, times: np.ndarray, shares: np.ndarray, channel: str) -> Sampled:
    """Return what valves do, of ``shares`` (N, thrusters) of samples at ``times`` (N,) [s].

    Whatever other commands do between samples. Raises `RecordingError` where a share is none.
    """
    pulses: list[Pulse] = [t.pulse for t in model.description.thruster]
    wrong = ~((shares >= -OVER) & (shares <= 1.0 + OVER)) & np.array([p != "spread" for p in pulses])
    if wrong.any():
        row, column = np.argwhere(wrong)[0]
        raise RecordingError(
            f"'{channel}' says that thruster '{model.description.thruster[column].name}' is open for "
            f"{shares[row, column]:.4g} of the sample at index {row}.",
            advice="A pulse is a share of its sample, from 0 to 1. Of percent state the unit in the mapping; "
            "of a throttle leave out `pulse`.",
            channel=channel,
        )
    return Sampled.from_samples(*switched(times, np.clip(shares, 0.0, 1.0), pulses), 0)


def input_channels(model: SpacecraftModel, recording: Recording) -> dict[str, str]:
    """Return which channel of a recording says what each input was: a command, else a measured torque."""
    wanted = {"wheel_torque": len(model.wheels), "joint_torque": len(model.arm_joints)}
    wanted |= {"force": 3, "torque": 3} if model.free else {}
    thrusters = len(model.description.thruster)
    wanted |= {"thruster": thrusters, "thruster_force": thrusters}
    found = {}
    for field, size in wanted.items():
        others = [c for c in recording.channels if c.partition(".")[2] == field]
        others = [c for c in others if c.partition(".")[0] not in ("command", "truth")]
        named = [c for c in (COMMANDS[field], *others) if c in recording]
        if size and named:
            found[field] = named[0]
    if "thruster" in found:  # share and force say the same
        found.pop("thruster_force", None)
    return found


def is_mixed_hold(recording: Mapping[str, np.ndarray] | Recording) -> bool:
    """Whether some commands (N, k) of a recording jump between samples while some vary smoothly."""
    return all(_looks(recording))


def is_stepwise(recording: Mapping[str, np.ndarray] | Recording) -> bool:
    """Whether commands (N, k) of a recording jump between samples, and none varies smoothly."""
    return _looks(recording) == (True, False)


def has_jumps(recording: Mapping[str, np.ndarray] | Recording) -> bool:
    """Whether some commands (N, k) of a recording jump between samples."""
    return _looks(recording)[0]


def bends_between_samples(recording: Mapping[str, np.ndarray] | Recording) -> bool:
    """Whether smooth commands (N, k) bend between samples by as much as matters: none jumps, and halfway
    between samples a cubic through them leaves the straight line by more than `CURVED_SHARE` of their size.
    """
    steps, smooth = _looks(recording)
    if steps or not smooth:
        return False
    bend = 0.0
    for channel in COMMANDS.values():
        if channel in recording:
            values = np.asarray(recording[channel], dtype=float)
            values = values.reshape(len(values), -1)
            if len(values) > 3:
                # of four equidistant samples the cubic's middle is (-1, 9, 9, -1) / 16
                off = np.abs(values[1:-2] + values[2:-1] - values[:-3] - values[3:]).max(initial=0.0) / 16.0
                bend = max(bend, float(off) / max(float(np.abs(values).max(initial=0.0)), 1e-300))
    return bend > CURVED_SHARE


def _looks(recording: Mapping[str, np.ndarray] | Recording) -> tuple[bool, bool]:
    """Return whether some commands (N, k) jump between samples, and whether some vary smoothly.

    Noise, pulses and what is rounded are held, as far as anyone can see.
    """
    steps, smooth = False, False
    for channel in COMMANDS.values():
        if channel in recording:
            values = np.asarray(recording[channel], dtype=float)
            values = values.reshape(len(values), -1)
            jumps = jump_intervals(values)
            steps |= bool(jumps.any())
            smooth |= any(_smooth(x, j) for x, j in zip(values.T, jumps.T, strict=True))
    return steps, smooth


def jump_intervals(values: np.ndarray) -> np.ndarray:
    """Return in which intervals (N - 1, k) samples (N, k) jump: change far more than before and after.

    A pulse of one sample is two jumps, one back from the other. At the ends, where there is no change before
    or after, the one after next stands in: a wave at its crest changes little once.
    """
    change = np.diff(values, axis=0)
    size = np.pad(np.abs(change), ((2, 2), (0, 0)))
    if len(change) > 2:
        size[1], size[-2] = size[4], size[-5]
    here, least = size[2:-2], 1e-9 * np.abs(values).max(initial=0.0)
    alone = here > JUMP_RATIO * (size[1:-3] + size[3:-1]) + least
    up = np.zeros_like(alone)
    back = -change[1:] / np.where(change[:-1] == 0.0, np.inf, change[:-1])
    flat = here[:-1] > JUMP_RATIO * (size[1:-4] + size[4:-1]) + least
    up[:-1] = flat & (np.abs(back - 1.0) < 1.0 / JUMP_RATIO)
    return alone | up | np.vstack([np.zeros_like(up[:1]), up[:-1]])


def _smooth(values: np.ndarray, jumps: np.ndarray) -> bool:
    """Whether samples (N,) vary without kinks over many neighbours between jumps (N - 1,)."""
    change = np.diff(values)
    first, second = change[:-1], change[1:]
    both = ~jumps[:-1] & ~jumps[1:] & (first != 0.0) & (second != 0.0)
    kinks = float(np.abs(second - first)[both].sum())
    return int(both.sum()) >= WAVE_CHANGES and kinks < 0.5 * float(
        (np.abs(first) + np.abs(second))[both].sum()
    )


def _with_ramps(times: np.ndarray, values: np.ndarray, jumps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return samples (N,), (N, k) with one more just before every jump: what is held until then.

    ``jumps`` (N - 1, k) are the intervals that end with one. The last value goes on for another interval: a
    jump there is one, too, and no slope to be extrapolated.
    """
    at = np.flatnonzero(jumps.any(axis=1))
    ramp = max(RAMP_SHARE * float(np.diff(times).min()), 4.0 * float(np.spacing(np.abs(times).max())))
    before = np.where(jumps[at], values[at], values[at + 1])
    later, after = np.append(times, 2.0 * times[-1] - times[-2]), np.vstack([values, values[-1:]])
    return np.insert(later, at + 1, times[at + 1] - ramp), np.insert(after, at + 1, before, axis=0)


def starts_with_jump(recording: Recording) -> bool:
    """Whether held commands are not zero when a recording begins: what was held until then is not known."""
    return any(bool(np.any(np.asarray(recording[c])[0])) for c in COMMANDS.values() if c in recording)


def locked_coordinates(model: SpacecraftModel, recording: Recording) -> np.ndarray:
    """Return the degrees of freedom (k,) held still: arms and wheels without a commanded torque."""
    found: list[int] = []
    if COMMANDS["joint_torque"] not in recording:
        found += [int(i) for i in model.arm_joints.v]
    if COMMANDS["wheel_torque"] not in recording:
        found += [int(i) for i in model.wheels.v]
    return np.array(found, dtype=int)


def means(signal: Signal, edges: np.ndarray) -> np.ndarray:
    """Return the means of a signal between consecutive edges (N + 1,): (N, size).

    Held and linear signals exactly, so that a command that jumps, or comes late, gives the right impulse;
    others by Gauss's rule of four points.
    """
    if isinstance(signal, Constant):
        return np.tile(signal.value, (len(edges) - 1, 1))
    if isinstance(signal, Sum):
        return np.sum([means(part, edges) for part in signal.parts], axis=0)
    width = np.diff(edges)
    if isinstance(signal, Sampled):
        return np.diff(_integral(signal, edges, 1), axis=0) / width[:, None]
    if isinstance(signal, Delayed):
        return means(signal.signal, edges - signal.delay)
    if isinstance(signal, Switched):
        late = (edges[:-1] >= signal.at)[:, None]
        return np.where(late, means(signal.after, edges), means(signal.before, edges))
    points = edges[:-1, None] + 0.5 * width[:, None] * (1.0 + _NODES)
    values = sample(signal, points.ravel()).reshape(*points.shape, -1)
    return 0.5 * np.einsum("npk,p->nk", values, _WEIGHTS)


def unrecorded(signal: Signal, edges: np.ndarray) -> np.ndarray | None:
    """Return how far the means between edges (N + 1,) may be off, one standard deviation (N, size) in all
    components at once: of what is late, what acts first was commanded before the recording. ``None`` where
    that is nothing.

    It may have been nothing, as where a simulation begins, or what the first command says, as where an arm
    was held: the means have the latter, give or take as much. Of a first command of zero nothing is known.
    """
    if isinstance(signal, Sum):
        parts = [x for x in (unrecorded(p, edges) for p in signal.parts) if x is not None]
        return np.sum(parts, axis=0) if parts else None
    if isinstance(signal, Switched):
        before, after = unrecorded(signal.before, edges), unrecorded(signal.after, edges)
        if before is None and after is None:
            return None
        none = np.zeros((len(edges) - 1, signal.size))
        late = (edges[:-1] >= signal.at)[:, None]
        return np.where(late, none if after is None else after, none if before is None else before)
    if isinstance(signal, Delayed) and edges[0] < signal.begin + signal.delay:
        width = np.diff(edges)
        share = np.clip((signal.begin + signal.delay - edges[:-1]) / width, 0.0, 1.0)
        return share[:, None] * limits(signal.signal, np.array([signal.begin]), "right")
    return None


def unevenness(signal: Signal, edges: np.ndarray) -> np.ndarray:
    """Return what a signal's course within each step (N,) adds to the double integral of its mean: (N, size).

    ``int (h - s) (x(s) - mean) ds`` over a step h: with x a force per mass, how much further it gets.
    """
    if isinstance(signal, Constant):
        return np.zeros((len(edges) - 1, signal.size))
    if isinstance(signal, Sum):
        return np.sum([unevenness(part, edges) for part in signal.parts], axis=0)
    h = np.diff(edges)[:, None]
    if isinstance(signal, Sampled):
        once, twice = _integral(signal, edges, 1), _integral(signal, edges, 2)
        return np.diff(twice, axis=0) - h * once[:-1] - 0.5 * h * np.diff(once, axis=0)
    if isinstance(signal, Delayed):
        return unevenness(signal.signal, edges - signal.delay)
    if isinstance(signal, Switched):
        late = (edges[:-1] >= signal.at)[:, None]
        return np.where(late, unevenness(signal.after, edges), unevenness(signal.before, edges))
    points = edges[:-1, None] + 0.5 * h * (1.0 + _NODES)
    values = sample(signal, points.ravel()).reshape(*points.shape, -1)
    return -0.25 * h**2 * np.einsum("npk,p->nk", values, _WEIGHTS * _NODES)


def _integral(signal: Sampled, times: np.ndarray, order: int) -> np.ndarray:
    """Return the first or second antiderivative (N, size) of samples; beyond them, the nearest goes on."""
    knots = signal.spline.t
    inside = np.clip(times, knots[signal.degree], knots[-1 - signal.degree])
    beyond = (times - inside)[:, None]
    nearest = np.asarray(signal.spline(inside))
    once = np.asarray(signal.integrals[0](inside))
    if order == 1:
        return once + beyond * nearest
    twice = np.asarray(signal.integrals[1](inside))
    return twice + beyond * once + 0.5 * beyond**2 * nearest


def limits(signal: Signal, times: np.ndarray, side: Literal["left", "right"]) -> np.ndarray:
    """Return the signal just before or just after the times (N,): (N, size)."""
    step = np.diff(times).min(initial=1.0) * 1e-6
    return sample(signal, times + (step if side == "right" else -step))
