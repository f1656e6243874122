"""What looks wrong in the recording of an arm when it is compared with a description."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from smsid._statistics import NORMAL95
from smsid.arm.columns import JointStates
from smsid.arm.identify import rigid_arm, torque_rows
from smsid.arm.joint_torques import block_length, block_means
from smsid.arm.smooth_motion import smooth_motion
from smsid.arm.torque_calibration import TorqueScale, known_links, torque_scales
from smsid.description import Description
from smsid.recording import Recording

FAR = 2.0
"""Factor by which a torque signal may differ from what the described links need."""

MENDED = 0.5
"""What is changed must bring the residual below this share of what it is as recorded."""

DEGREE = np.pi / 180.0


@dataclass(frozen=True)
class JointDoubt:
    """Something that looks wrong about a joint.

    ``kind`` is ``sign of angle``, ``sign of torque``, ``sign of axis`` (both turned), ``degrees``, ``order of
    torques`` (``joint`` names both) or ``torque scale``; ``before`` and ``after`` are the relative torque
    errors as recorded and as suggested (NaN for a scale).
    """

    joint: str
    kind: str
    before: float
    after: float
    sentence: str


def joint_doubts(
    description: Description,
    recording: Recording,
    *,
    cutoff: float | None = None,
    hold: Mapping[str, float] | None = None,
) -> tuple[JointDoubt, ...]:
    """Return joints whose signs, units, order or torques' scale contradict a description.

    Angle, torque or both of one joint at a time are turned, its angle is taken for degrees, torques of two
    joints are exchanged; torques of the described links, times a scale per joint, and the description's
    effects are fitted each time. What more than halves the error is told; after that, scales further than a
    factor of two from 1 are: a current, or motor torque instead of joint torque.

    Args:
        description: a welded arm whose link inertias are about right.
        recording: joint angles and torques, see `smooth_motion`.
        cutoff: up to where torques are compared [Hz]; by default as `identify_arm`.
        hold: joints that did not move and were not measured, with their positions [rad | m].

    Raises:
        DescriptionError: not a welded arm, or links without inertia.
        RecordingError: as `smooth_motion`.
        NotIdentifiableError: no joint moves.
    """
    seen = _Compared(description, recording, cutoff, hold)
    none = np.ones(len(seen.names))
    plain = seen.error(none, seen.torque)
    trials: list[tuple[float, str, str, str]] = []
    for k, name in enumerate(seen.names):
        turned = np.where(np.arange(none.size) == k, -1.0, 1.0)
        reversed_torque = seen.torque * np.where(np.arange(seen.torque.shape[1]) == seen.index[k], -1.0, 1.0)
        trials += [
            (seen.error(scale, torque), name, kind, f"Joint '{name}' fits the description with its {what}")
            for kind, what, scale, torque in (
                ("sign of angle", "angle turned round", turned, seen.torque),
                ("sign of torque", "torque turned round", none, reversed_torque),
                ("sign of axis", "angle and torque both turned round", turned, reversed_torque),
                ("degrees", "angle in degrees", np.where(turned < 0.0, DEGREE, 1.0), seen.torque),
            )
        ]
    for a, b in itertools.combinations(range(none.size), 2):
        order = np.arange(seen.torque.shape[1])
        order[[seen.index[a], seen.index[b]]] = order[[seen.index[b], seen.index[a]]]
        pair = (seen.names[a], seen.names[b])
        told = "Joints '{}' and '{}' fit the description with their torques exchanged".format(*pair)
        trials.append((seen.error(none, seen.torque[:, order]), ", ".join(pair), "order of torques", told))
    least, name, kind, told = min(trials)
    if least < MENDED * plain:
        sentence = f"{told}: relative torque error {least:.3g} instead of {plain:.3g}."
        return (JointDoubt(name, kind, plain, least, sentence),)
    return tuple(
        JointDoubt(s.joint, "torque scale", float("nan"), float("nan"), _scale_sentence(s))
        for s in torque_scales(description, recording, cutoff=cutoff, hold=hold)
        if s.sure and not 1.0 / FAR < s.value < FAR
    )


def _scale_sentence(s: TorqueScale) -> str:
    told = (
        f"The torque signal of joint '{s.joint}' is {s.value:.3g} +- {NORMAL95 * s.sigma:.2g} times what the "
        "described links need: "
    )
    if s.value < 0.0:
        return told + "has it the wrong sign?"
    return told + "is it a current, or measured at the motor before its gear?"


class _Compared:
    """Mean motion and torques of blocks of a recording, to be compared with a description.

    ``torque`` (B, nv); ``index`` (joints,) says where in it the joints ``names`` stand.
    """

    def __init__(
        self,
        description: Description,
        recording: Recording,
        cutoff: float | None,
        hold: Mapping[str, float] | None,
    ) -> None:
        self.model = rigid_arm(description, hold)
        self.theta = known_links(self.model)
        self.names, self.index = self.model.arm_joints.names, self.model.arm_joints.v
        motion = smooth_motion(self.model, recording)
        starts = motion.blocks(block_length(motion, cutoff))
        self.angles = block_means(self.model.joint_angles(motion.q), starts)
        self.v, self.a = block_means(motion.v, starts), block_means(motion.a, starts)
        self.torque = block_means(motion.torque, starts)
        self.temperature = None if motion.temperature is None else block_means(motion.temperature, starts)
        self._rows: dict[bytes, np.ndarray] = {}

    def error(self, scale: np.ndarray, torque: np.ndarray) -> float:
        """Return the relative error of torques (B, nv) with angles times ``scale`` (joints,).

        One positive scale per joint for the links, and the effects are fitted.
        """
        rows = self._at(scale)
        links, extra = rows[:, :, : self.theta.size] @ self.theta, rows[:, :, self.theta.size :]
        square = 0.0
        for j in range(torque.shape[1]):
            own = extra[:, j]
            own = own[:, np.any(own != 0.0, axis=0)]
            size = np.linalg.norm(torque[:, j])
            columns = np.column_stack([links[:, j], own])
            x = np.linalg.lstsq(columns, torque[:, j], rcond=1e-10)[0]
            if x[0] < 0.0:  # the links' torque has one sign
                x = np.concatenate([[0.0], np.linalg.lstsq(own, torque[:, j], rcond=1e-10)[0]])
            square += float(np.sum((torque[:, j] - columns @ x) ** 2)) / size**2 if size > 0.0 else 0.0
        return float(np.sqrt(square / torque.shape[1]))

    def _at(self, scale: np.ndarray) -> np.ndarray:
        key = scale.tobytes()
        if key not in self._rows:
            rates = np.ones(self.v.shape[1])
            rates[self.index] = scale
            q = np.array([self.model.set_joint_angles(self.model.home, x) for x in self.angles * scale])
            states = JointStates(q, self.v * rates, self.a * rates, self.torque, self.temperature)
            self._rows[key], _, _ = torque_rows(self.model, states)
        return self._rows[key]
