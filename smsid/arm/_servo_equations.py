"""The equations of servo joints: position errors in the place of torques, and where they hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.ndimage import minimum_filter1d

from smsid.arm._smooth_motion import SmoothMotion
from smsid.arm.joint_torques import SIGN_FIELD, JointTorques, block_means, sign_rate
from smsid.arm.joints import with_joint_order
from smsid.arm.readings import measured_channel
from smsid.effects import Servo
from smsid.errors import DescriptionError, RecordingError
from smsid.model.regressor import Regressor
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording

SOURCE = "servo"
COMMAND = "command.joint_position"

BEYOND = 6.0
"""Noises that the error must exceed what moves the joint by, to be beyond a limit."""

REST = 0.1
"""Share of the rate's rms below which a joint may stick."""

SHARP = 0.02
"""Width of friction's sign, as a share of the rate's rms."""

AGAIN = 2.0
"""Encoder's steps within which a command has to come again for its steps to shake the joint unseen."""

FEWEST = 3
"""Blocks in a row from which on a limit is believed."""


def with_position_errors(model: SpacecraftModel, recording: Recording) -> Recording:
    """Return the recording with position errors in the place of torques, command minus encoder.

    A command is held, and an encoder does not see how its steps shake the joint between samples: a command
    that comes again soon (`AGAIN`) is taken without what is periodic with it, for its mean over half an
    encoder's step to either side, and from that mean, to second order, its value at the sample.

    Raises:
        RecordingError: there is no command, or as `with_joint_order`.
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

    steps, slopes = np.append(np.diff(sent), np.inf), np.zeros(value.shape)
    slopes[1:-1] = 0.5 * (value[2:] - value[:-2])
    unseen = steps <= AGAIN * 2.0 * half

    def integral(at: np.ndarray) -> np.ndarray:
        k = np.clip(np.searchsorted(sent, at, side="right") - 1, 0, len(sent) - 1)
        since, step = at - sent[k], np.where(unseen, steps, 1.0)[k]
        saw = np.where(unseen[k], 0.5 * since * (1.0 - since / step) - step / 12.0, 0.0)
        return area[k] + since[:, None] * value[k] - saw[:, None] * slopes[k]

    inside = (times - half >= sent[0]) & (times + half <= sent[-1] + 2.0 * half)
    held = (integral(times + half) - integral(times - half)) / (2.0 * half)
    held[1:-1] -= np.diff(held, 2, axis=0) / 24.0
    return Recording.from_arrays(
        times[inside],
        {encoder: angle[inside], f"{SOURCE}.joint_torque": (held - angle)[inside]},
        labels={"joint": model.arm_joints.names},
        role=ordered.role,
        name=ordered.name,
    )


def servo_equations(
    model: SpacecraftModel, motion: SmoothMotion, torques: JointTorques, servos: Mapping[int, Servo]
) -> JointTorques:
    """Return ``rows x = e``: x the inverse stiffnesses, and everything else divided by them.

    Where a stiffness is known, its links are taken to the other side.

    Raises:
        DescriptionError: the links have no inertia.
    """
    theta = Regressor(model).parameters
    if not np.any(theta):
        raise DescriptionError("The links have no inertia.", advice="Give the URDF inertias.")
    links, signal = torques.rows[:, :, : theta.size] @ theta, np.array(torques.torque)
    extra: dict[str, np.ndarray] = {}

    def add(name: str, k: int, values: np.ndarray) -> None:
        extra[name] = np.zeros(links.shape)
        extra[name][:, k] = values

    angles = block_means(model.joint_angles(motion.q), torques.starts)
    for place, k in enumerate(model.arm_joints.v.tolist()):
        s = servos[k]
        if is_known(s, "stiffness"):
            signal[:, k] -= links[:, k] / s.stiffness
        else:
            add(f"{s.name}.stiffness", k, links[:, k])
        if s.damps == "error":
            command = angles[:, place] + torques.torque[:, k]
            rate = np.gradient(command, torques.time)
            if is_known(s, "damping") and is_known(s, "stiffness"):
                signal[:, k] += s.damping / s.stiffness * rate
            else:
                add(f"{s.name}.damping", k, -rate)
    return replace(
        torques,
        rows=np.dstack([*extra.values(), torques.rows[:, :, theta.size :]]),
        torque=signal,
        names=(*extra, *torques.names[theta.size :]),
        units=(*["1"] * len(extra), *torques.units[theta.size :]),
    )


def is_known(servo: Servo, field: str) -> bool:
    """Return whether a field of a servo is stated to be known."""
    return field in servo.known or "all" in servo.known


def with_sharp_friction(model: SpacecraftModel, motion: SmoothMotion) -> SpacecraftModel:
    """Return the model whose friction changes sign where nothing is looked at, see `moves_throughout`."""
    sharp = [
        e.model_copy(update={SIGN_FIELD: SHARP * float(np.sqrt(np.mean(sign_rate(e, model, motion.v) ** 2)))})
        for e in model.description.effect
        if SIGN_FIELD in e.torque_shapes()
    ]
    return replace(model, description=model.description.with_effects(*sharp))


def moves_throughout(motion: SmoothMotion, torques: JointTorques) -> np.ndarray:
    """Return where (B, joints) a joint moves throughout a block: at rest, dry friction is what it must be.

    Where it turns round, friction and with it the acceleration jump; a spline sees that too smooth, over its
    correlation time to either side.
    """
    moves = np.abs(motion.v) > REST * np.sqrt(np.mean(motion.v**2, axis=0))
    for k, joint in enumerate(motion.joints):
        width = 2 * round(joint.edge / motion.step) + 1
        moves[:, k] = minimum_filter1d(moves[:, k], width, mode="nearest")
    return np.minimum.reduceat(moves, torques.starts, axis=0)


def within_limits(error: np.ndarray, left: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Return where (B, joints) a torque was not at a limit: there the error grows and the torque does not.

    ``error`` and what the fit has ``left`` of it (B, joints) [rad | m]; ``inside`` (B, joints) what it used.
    """
    out = np.ones(error.shape, dtype=bool)
    for k in range(error.shape[1]):
        noise = 1.4826 * float(np.median(np.abs(left[inside[:, k], k])))
        beyond = np.sign(error[:, k]) * left[:, k] > BEYOND * noise
        run = np.convolve(beyond, np.ones(FEWEST), mode="same") >= FEWEST
        long = np.convolve(run, np.ones(FEWEST), mode="same") > 0
        out[:, k] = ~(beyond & long)
    return out
