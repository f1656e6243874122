"""Servo joints identified from commanded and measured positions: no torque is measured.

With e the position error, a servo's equation is ``e = (links + rotor + friction) / stiffness``: linear, with
the noise of an encoder on its left. Known links give the scale; the errors of each joint are a torque signal
of unknown gain.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid._short_repr import short_repr
from smsid.arm.columns import joint_index
from smsid.arm.friction_shape import FrictionShape, shape_notes, with_found_shapes
from smsid.arm.identify import GROUP, motion_notes, rigid_arm, solve_equations
from smsid.arm.joint_torques import JointTorques, block_length, block_means, joint_torques
from smsid.arm.joints import with_joint_order
from smsid.arm.readings import measured_channel, without_turns
from smsid.arm.regression import JointRegression
from smsid.arm.smooth_motion import SmoothMotion, joined_motion, smooth_motion
from smsid.arm.units import joint_unit
from smsid.description import Description
from smsid.effects import JointFriction, MotorInertia, Servo, TorqueOffset
from smsid.errors import DescriptionError, NotIdentifiableError, RecordingError
from smsid.identify.estimate import Estimate, ParameterEstimate, judged
from smsid.model.identifiable import BaseParameters
from smsid.model.regressor import Regressor
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording
from smsid.recording.checks import consistency_notes

SOURCE = "servo"
COMMAND = "command.joint_position"
ALLOWED = (JointFriction, MotorInertia, TorqueOffset, Servo)
ROUNDS = 8
"""Rounds of leaving out what is beyond the limit of a torque."""

BEYOND = 6.0
"""Noises that the error must exceed what moves the joint by, to be beyond a limit."""

COARSER = 4
"""Blocks of torques in one of position errors: an encoder sees the jumps of friction too smooth."""

REST = 0.1
"""Share of the rate's rms below which a joint may stick."""

SHARP = 0.02
"""Width of friction's sign, as a share of the rate's rms."""

FIRST = 1.5
"""Medians of a position error up to which the first fit goes."""

ALIKE = 0.1
"""Largest scatter of the torque at a limit, as a share of it."""

FEWEST = 3
"""Blocks in a row from which on a limit is believed."""


@short_repr
@dataclass(frozen=True)
class ServoIdentification:
    """Identified servo joints.

    ``description`` has the identified values; ``residual`` (B, joints) [rad | m] is what is left of the
    position errors, NaN where a torque was at its limit; ``noise`` (joints,) its standard deviation.
    """

    estimate: Estimate
    description: Description
    residual: np.ndarray
    noise: np.ndarray
    shapes: tuple[FrictionShape, ...]


def is_of_servos(recordings: Sequence[Recording]) -> bool:
    """Return whether recordings hold commanded and measured joint positions, and no joint torques."""
    names = {n for r in recordings for n in r.channels}
    measured = [
        n for n in names if n.endswith(".joint_position") and not n.startswith(("command.", "truth."))
    ]
    others = (".joint_torque", ".wheel_torque", ".attitude", ".thruster")
    return COMMAND in names and bool(measured) and not any(n.endswith(others) for n in names)


def with_servos(description: Description, joints: Sequence[str]) -> Description:
    """Return the description with a servo of unknown gains on every joint that has none."""
    taken = {e.joint for e in description.effect if isinstance(e, Servo)}
    new = [Servo(name=f"servo_{j.replace('/', '-')}", joint=j) for j in joints if j not in taken]
    return description.with_effects(*new)


def identify_servos(
    description: Description,
    recording: Recording | Sequence[Recording],
    *,
    cutoff: float | None = None,
    hold: Mapping[str, float] | None = None,
) -> ServoIdentification:
    """Identify gains, friction and rotors of servo joints from commands and encoders.

    The described links are taken as known: they give the scale, unless a servo's stiffness is `known`. The
    damping of a controller that damps the rate, and back-EMF, are part of ``viscous``, less what is known.

    Args:
        description: a welded arm with an effect `Servo` on every joint, and the friction, rotors and offsets
            to identify.
        recording: ``command.joint_position`` and measured joint positions; a command is held until the next.
        cutoff: up to where position errors are compared [Hz]; by default a quarter of what
            the motion is followed to.
        hold: joints that did not move and were not measured, with their positions [rad | m].

    Raises:
        DescriptionError: a joint without servo, or effects that several joints share.
        RecordingError: no command, or as `smooth_motion`.
        NotIdentifiableError: nothing gives a joint's stiffness.
    """
    begin = time.perf_counter()
    recordings = (recording,) if isinstance(recording, Recording) else tuple(recording)
    model = rigid_arm(description, hold)
    servos = _servos(model)
    doubts = consistency_notes([without_turns(model, r) for r in recordings])
    motion = joined_motion([smooth_motion(model, _with_errors(model, r)) for r in recordings])
    model = _sharp(model, motion)
    length = block_length(motion, cutoff) * (COARSER if cutoff is None else 1)
    torques = joint_torques(model, motion, length)
    whole = _servo_equations(model, motion, torques, servos)
    base = _every_column(whole)
    moves = _moves(motion, torques)
    size = np.abs(whole.torque)  # the first fit keeps away from limits
    inside = moves & (size <= FIRST * np.median(size, axis=0))
    for k in range(ROUNDS):
        shapes, shaped, solved, _ = solve_equations(model, motion, whole.only(inside), base)
        left = whole.torque - np.einsum("bjn,n->bj", whole.rows, solved.x)
        found = _within_limits(whole.torque, left, inside) & moves & (inside | (k < 4))
        if np.array_equal(found, inside):
            break
        inside = found
    left = shaped.torque - np.einsum("bjn,n->bj", shaped.rows, solved.x)
    parameters, covariance = _physical(model, whole, solved, servos, inside)
    inside |= ~moves  # from here on: not at a limit
    values = {p.name: p.value for p in parameters}
    rates = block_means(motion.v, whole.starts)
    limits = _limits(model, whole, rates, solved, servos, inside, values)
    size = len(parameters)
    full = np.full((size + len(limits), size + len(limits)), np.nan)
    full[:size, :size] = covariance
    parameters = (*parameters, *limits)
    values = {p.name: p.value for p in parameters if np.isfinite(p.value)}
    estimate = Estimate(
        description=description.name,
        method="servo least squares",
        parameters=parameters,
        recordings=tuple(r.name for r in recordings),
        timing={"total": time.perf_counter() - begin},
        notes=(
            *doubts,
            *motion_notes(model, motion, torques, solved),
            *shape_notes([s for s in shapes if s.status == "found"]),
            *_notes(servos, inside),
        ),
        conditions={"servo regressor": solved.condition},
        covariance=full,
    )
    described = with_found_shapes(_with_values(description, values), shapes)
    return ServoIdentification(estimate, described, np.where(inside, left, np.nan), solved.noise, shapes)


def _servos(model: SpacecraftModel) -> dict[int, Servo]:
    """Return servos by degree of freedom; raises as `identify_servos`."""
    strange = [e for e in model.description.effect if not isinstance(e, ALLOWED)]
    loaded = [e for e in model.description.effect if isinstance(e, JointFriction) and "load" in e.asked()]
    if strange or loaded:
        other = (strange or loaded)[0]
        raise DescriptionError(
            f"'{other.name}' ({other.kind}) has no place beside servos.",
            advice="Leave it out: friction, rotor and offset of single joints are identified, not by load.",
        )
    by_joint = {e.joint: e for e in model.description.effect if isinstance(e, Servo)}
    joints = dict(zip(model.arm_joints.names, model.arm_joints.v.tolist(), strict=True))
    lacking = [j for j in joints if j not in by_joint]
    if lacking:
        raise DescriptionError(
            f"{', '.join(lacking)} has no servo.", advice="Add effects of the kind 'servo'."
        )
    return {k: by_joint[j] for j, k in joints.items()}


def _with_errors(model: SpacecraftModel, recording: Recording) -> Recording:
    """Return the recording with position errors in the place of torques, command minus encoder.

    A command is held: half a step to either side of an encoder's sample, its mean is taken.
    """
    if COMMAND not in recording.channels:
        raise RecordingError(
            f"The recording has no '{COMMAND}'.", advice="Map the commanded positions to it."
        )
    ordered = with_joint_order(model, recording)
    encoder = measured_channel(ordered, "joint_position")
    times, angle = np.asarray(ordered.time(encoder)), np.asarray(ordered[encoder], dtype=float)
    sent, value = np.asarray(ordered.time(COMMAND)), np.asarray(ordered[COMMAND], dtype=float)
    half = 0.5 * float(np.median(np.diff(times)))
    area = np.vstack([np.zeros(value.shape[1]), np.cumsum(np.diff(sent)[:, None] * value[:-1], axis=0)])

    def integral(at: np.ndarray) -> np.ndarray:
        k = np.clip(np.searchsorted(sent, at, side="right") - 1, 0, len(sent) - 1)
        return area[k] + (at - sent[k])[:, None] * value[k]

    inside = (times - half >= sent[0]) & (times + half <= sent[-1] + 2.0 * half)
    held = (integral(times + half) - integral(times - half)) / (2.0 * half)
    return Recording.from_arrays(
        times[inside],
        {encoder: angle[inside], f"{SOURCE}.joint_torque": (held - angle)[inside]},
        labels={"joint": model.arm_joints.names},
        role=ordered.role,
        name=ordered.name,
    )


def _servo_equations(
    model: SpacecraftModel, motion: SmoothMotion, torques: JointTorques, servos: Mapping[int, Servo]
) -> JointTorques:
    """Return ``rows x = e``: x the inverse stiffnesses, and everything else divided by them.

    Where a stiffness is known, its links are taken to the other side.
    """
    theta = Regressor(model).parameters
    if not np.any(theta):
        raise DescriptionError("The links have no inertia.", advice="Give the URDF inertias.")
    links, signal = torques.rows[:, :, : theta.size] @ theta, np.array(torques.torque)
    extra, names, units = [], [], []

    def add(name: str, k: int, values: np.ndarray) -> None:
        column = np.zeros(links.shape)
        column[:, k] = values
        extra.append(column)
        names.append(name)
        units.append("1")

    # samples of the angle have their mean, the held command its integral: second order in the step
    signal -= motion.step**2 / 24.0 * block_means(motion.a, torques.starts)
    angles = block_means(model.joint_angles(motion.q), torques.starts)
    for place, k in enumerate(model.arm_joints.v.tolist()):
        s = servos[k]
        if _is_known(s, "stiffness"):
            signal[:, k] -= links[:, k] / s.stiffness
        else:
            add(f"{s.name}.stiffness", k, links[:, k])
        if s.damps == "error":
            command = angles[:, place] + torques.torque[:, k]
            rate = np.gradient(command, torques.time)
            if _is_known(s, "damping") and _is_known(s, "stiffness"):
                signal[:, k] += s.damping / s.stiffness * rate
            else:
                add(f"{s.name}.damping", k, -rate)
    return replace(
        torques,
        rows=np.concatenate([*(c[:, :, None] for c in extra), torques.rows[:, :, theta.size :]], axis=2),
        torque=signal,
        names=(*names, *torques.names[theta.size :]),
        units=(*units, *torques.units[theta.size :]),
    )


def _is_known(servo: Servo, field: str) -> bool:
    return field in servo.known or "all" in servo.known


def _every_column(torques: JointTorques) -> BaseParameters:
    n = len(torques.names)
    return BaseParameters(torques.names, torques.units, np.arange(n), np.eye(n), (), 1.0)


def _sharp(model: SpacecraftModel, motion: SmoothMotion) -> SpacecraftModel:
    """Return the model whose friction changes sign where nothing is looked at, see `_moves`."""
    rms = np.sqrt(np.mean(motion.v**2, axis=0))
    effects = [
        e.model_copy(update={"smoothing": SHARP * float(rms[joint_index(model, e, e.joint)])})
        if isinstance(e, JointFriction)
        else e
        for e in model.description.effect
    ]
    return replace(model, description=model.description.with_effects(*effects))


def _moves(motion: SmoothMotion, torques: JointTorques) -> np.ndarray:
    """Return where (B, joints) a joint moves throughout a block: at rest, dry friction is what it must be."""
    slow = REST * np.sqrt(np.mean(motion.v**2, axis=0))
    least = np.minimum.reduceat(np.abs(motion.v), torques.starts, axis=0)
    turned = np.minimum.reduceat(motion.v, torques.starts, axis=0) * np.maximum.reduceat(
        motion.v, torques.starts, axis=0
    )
    return (least > slow) & (turned > 0.0)


def _within_limits(error: np.ndarray, left: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Return where (B, joints) a torque was not at a limit: there the error grows and the torque does not."""
    out = np.ones(error.shape, dtype=bool)
    for k in range(error.shape[1]):
        noise = 1.4826 * float(np.median(np.abs(left[inside[:, k], k])))
        beyond = np.sign(error[:, k]) * left[:, k] > BEYOND * noise
        run = np.convolve(beyond, np.ones(FEWEST), mode="same") >= FEWEST
        long = np.convolve(run, np.ones(FEWEST), mode="same") > 0
        out[:, k] = ~(beyond & long)
    return out


def _physical(
    model: SpacecraftModel,
    torques: JointTorques,
    solved: JointRegression,
    servos: Mapping[int, Servo],
    inside: np.ndarray,
) -> tuple[tuple[ParameterEstimate, ...], np.ndarray]:
    """Return gains, friction, rotors and offsets, and their covariance, from those divided by stiffness."""
    known = {p.name: p for e in model.description.effect for p in e.parameters()}
    joint_of = {e.name: str(getattr(e, "joint", "")) for e in model.description.effect}
    by_joint = {s.joint: (k, s) for k, s in servos.items()}
    n = len(torques.names)
    jacobian, values, units, shares = np.zeros((n, n)), np.zeros(n), [], np.ones(n)
    for i, name in enumerate(torques.names):
        joint = joint_of[name.partition(".")[0]]
        k, servo = by_joint[joint]
        scale = f"{servo.name}.stiffness"
        shares[i] = max(float(np.mean(inside[:, k])), 1e-3)
        units.append(joint_unit(known[name].unit, model, joint))
        if name == scale:
            values[i] = 1.0 / solved.x[i]
            jacobian[i, i] = -1.0 / solved.x[i] ** 2
            continue
        at = torques.names.index(scale) if scale in torques.names else None
        inverse = solved.x[at] if at is not None else 1.0 / servo.stiffness
        values[i] = solved.x[i] / inverse
        jacobian[i, i] = 1.0 / inverse
        if at is not None:
            jacobian[i, at] = -solved.x[i] / inverse**2
        if name.endswith(".viscous"):
            gain = f"{servo.name}.damping"
            if gain in torques.names:  # on the rate as on the command
                g = torques.names.index(gain)
                values[i] -= solved.x[g] / inverse
                jacobian[i, g] = -1.0 / inverse
                if at is not None:
                    jacobian[i, at] += solved.x[g] / inverse**2
            elif _is_known(servo, "damping"):
                values[i] -= servo.damping
    lost = 1.0 / np.sqrt(shares)  # blocks left out count as without noise
    covariance = jacobian @ (solved.covariance * np.outer(lost, lost)) @ jacobian.T
    sigma = np.sqrt(np.diag(covariance))
    for i, name in enumerate(torques.names):
        if name.endswith(".stiffness") and not (solved.x[i] > 3.0 * solved.sigma[i]):
            raise NotIdentifiableError(
                f"Neither gravity nor inertia of the links shows at '{joint_of[name.partition('.')[0]]}': "
                "its stiffness cannot be told.",
                advice="Move it more, or state its stiffness and list it in `known`.",
                parameter=name,
            )
    found = [
        judged(name, float(x), unit, float(s), GROUP, nominal=known[name].value)
        for name, x, unit, s in zip(torques.names, values, units, sigma, strict=True)
    ]
    return tuple(found), covariance


def _limits(
    model: SpacecraftModel,
    torques: JointTorques,
    rates: np.ndarray,
    solved: JointRegression,
    servos: Mapping[int, Servo],
    inside: np.ndarray,
    values: Mapping[str, float],
) -> list[ParameterEstimate]:
    """Return the torques that servos were limited to: what moved the joint while the error grew.

    There the controller's damping acts no more, which viscous friction holds: both are regressed.

    Raises:
        NotIdentifiableError: what moves the joint there is not alike.
    """
    predicted = np.einsum("bjn,n->bj", torques.rows, solved.x)
    found = []
    for k, s in servos.items():
        beyond = ~inside[:, k]
        if not beyond.any():
            continue
        stiffness = values.get(f"{s.name}.stiffness", s.stiffness)
        own = predicted[:, k]
        sign = np.sign(torques.torque[beyond, k])
        columns = np.column_stack([np.ones(sign.size), sign * rates[beyond, k]])
        given = stiffness * sign * own[beyond]
        (limit, _), *_ = np.linalg.lstsq(columns, given, rcond=None)
        spread = float(np.std(given - columns @ np.linalg.lstsq(columns, given, rcond=None)[0]))
        if not max(spread, stiffness * float(solved.noise[k])) < ALIKE * limit:
            raise NotIdentifiableError(
                f"The error of '{s.joint}' grows beyond what moves it for {beyond.mean():.0%} of the time, "
                "not at one limit of its torque.",
                advice="Record a motion that keeps away from the limit, or loads that the servo can move.",
                joint=s.joint,
            )
        runs = max(int(np.count_nonzero(np.diff(beyond.astype(int)) == 1)), 1)
        lever = float(np.linalg.pinv(columns.T @ columns)[0, 0]) * beyond.sum() / runs
        sigma = max(spread * float(np.sqrt(lever)), stiffness * float(solved.noise[k]))
        unit = joint_unit("N m", model, s.joint)
        found.append(judged(f"{s.name}.limit", float(limit), unit, sigma, GROUP))
    return found


def _with_values(description: Description, values: Mapping[str, float]) -> Description:
    """Return the description with identified values, kept within their bounds."""
    effects = []
    for e in description.effect:
        if isinstance(e, Servo) and e.limit is None and f"{e.name}.limit" in values:
            e = e.model_copy(update={"limit": values[f"{e.name}.limit"]})
        own = {p.name: min(max(values[p.name], p.lower), p.upper) for p in e.parameters() if p.name in values}
        effects.append(e.with_values(own))
    return description.with_effects(*effects)


def _notes(servos: Mapping[int, Servo], inside: np.ndarray) -> list[str]:
    notes = []
    lumped = [s.joint for s in servos.values() if s.damps == "rate" and not _is_known(s, "damping")]
    if lumped:
        notes.append(f"viscous holds the controller's damping and back-EMF as well: {', '.join(lumped)}")
    notes += [
        f"{s.joint} was at its torque's limit for {100 * float(np.mean(~inside[:, k])):.2g} % of the time"
        for k, s in servos.items()
        if not inside[:, k].all()
    ]
    return notes
