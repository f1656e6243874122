"""What looks wrong in the recording of an arm when it is compared with a description."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from smsid.arm.identify import rigid_arm
from smsid.arm.joints import with_joint_order
from smsid.arm.motion import measured_channel
from smsid.arm.scales import TorqueScale, link_torques, torque_scales
from smsid.description import Description
from smsid.recording import Recording

FAR = 2.0
"""Factor by which a torque signal may differ from what the described links need."""

MENDED = 0.5
"""A turned sign must bring the residual below this share of what it is as recorded."""


@dataclass(frozen=True)
class JointDoubt:
    """Something that looks wrong about a joint.

    ``kind`` is ``sign of angle``, ``sign of torque``, ``sign of axis`` (both turned) or ``torque scale``;
    ``before`` and ``after`` are the relative torque errors as recorded and as suggested (NaN for a scale).
    """

    joint: str
    kind: str
    before: float
    after: float
    sentence: str


def joint_doubts(
    description: Description, recording: Recording, *, cutoff: float | None = None
) -> tuple[JointDoubt, ...]:
    """Return joints whose signs, or whose torques' scale, contradict a description.

    Angle, torque or both of one joint at a time are turned; torques of the described links, times a scale
    per joint, and the description's effects are fitted each time. What more than halves the error is told;
    after that, scales further than a factor of two from 1 are: a current, or motor torque instead of joint
    torque.

    Args:
        description: a welded arm whose link inertias are about right.
        recording: joint angles and torques, see `joint_motion`.
        cutoff: of the low-pass [Hz].

    Raises:
        DescriptionError: not a welded arm, or links without inertia.
        RecordingError: as `joint_motion`.
    """
    position, torque = (measured_channel(recording, q) for q in ("joint_position", "joint_torque"))
    model = rigid_arm(description)
    recording, names = with_joint_order(model, recording), model.arm_joints.names
    plain = _error(description, recording, cutoff)
    trials: list[tuple[float, str, str]] = []
    for k, name in enumerate(names):
        for kind, turned in (
            ("sign of angle", (position,)),
            ("sign of torque", (torque,)),
            ("sign of axis", (position, torque)),
        ):
            other = recording
            for channel in turned:
                values = np.array(recording[channel])
                values[:, k] *= -1.0
                other = other.with_channels({channel: values})
            trials.append((_error(description, other, cutoff), name, kind))
    least, name, kind = min(trials)
    found = []
    if least < MENDED * plain:
        what = {
            "sign of angle": "its angle turned round",
            "sign of torque": "its torque turned round",
            "sign of axis": "its angle and torque both turned round",
        }[kind]
        found.append(
            JointDoubt(
                name,
                kind,
                plain,
                least,
                f"Joint '{name}' fits the description with {what}: relative torque error {least:.3g} instead "
                f"of {plain:.3g}.",
            )
        )
    else:
        found += [
            JointDoubt(s.joint, "torque scale", float("nan"), float("nan"), _scale_sentence(s))
            for s in torque_scales(description, recording, cutoff=cutoff)
            if s.sure and not 1.0 / FAR < s.value < FAR
        ]
    return tuple(found)


def _scale_sentence(s: TorqueScale) -> str:
    told = (
        f"The torque signal of joint '{s.joint}' is {s.value:.3g} +- {1.96 * s.sigma:.2g} times what the "
        "described links need: "
    )
    if s.value < 0.0:
        return told + "has it the wrong sign?"
    return told + "is it a current, or measured at the motor before its gear?"


def _error(description: Description, recording: Recording, cutoff: float | None) -> float:
    """Relative torque error with one positive scale per joint for the links, and the effects fitted."""
    _, motion, links, extra = link_torques(description, recording, cutoff)
    square = 0.0
    for j in range(motion.torque.shape[1]):
        measured = motion.torque[:, j]
        own = extra[:, j]
        own = own[:, np.any(own != 0.0, axis=0)]
        size = np.linalg.norm(measured)
        columns = np.column_stack([links[:, j], own])
        x = np.linalg.lstsq(columns, measured, rcond=1e-10)[0]
        if x[0] < 0.0:  # the links' torque has one sign
            x = np.concatenate([[0.0], np.linalg.lstsq(own, measured, rcond=1e-10)[0]])
        square += float(np.sum((measured - columns @ x) ** 2)) / size**2 if size > 0.0 else 0.0
    return float(np.sqrt(square / motion.torque.shape[1]))
