"""What looks wrong in the recording of an arm when it is compared with a description."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
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
    torques`` (``joint`` names both) or ``torque scale``; ``before`` and ``after`` are the relative errors
    as recorded and as suggested, of the torques that it touches (NaN for a scale).
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
    none, count = np.ones(len(seen.names)), len(seen.names)
    every = range(count)
    trials: list[tuple[np.ndarray, Sequence[int], str, str]] = []
    for k, name in enumerate(seen.names):
        turned = np.where(np.arange(count) == k, -1.0, 1.0)
        reversed_torque = seen.torque * np.where(np.arange(seen.torque.shape[1]) == seen.index[k], -1.0, 1.0)
        trials += [
            (seen.errors(scale, torque), on, kind, f"Joint '{name}' fits the description with its {what}")
            for kind, what, scale, torque, on in (
                ("sign of angle", "angle turned round", turned, seen.torque, every),
                ("sign of torque", "torque turned round", none, reversed_torque, (k,)),
                ("sign of axis", "angle and torque both turned round", turned, reversed_torque, every),
                ("degrees", "angle in degrees", np.where(turned < 0.0, DEGREE, 1.0), seen.torque, every),
            )
        ]
    for a, b in itertools.combinations(every, 2):
        order = np.arange(seen.torque.shape[1])
        order[[seen.index[a], seen.index[b]]] = order[[seen.index[b], seen.index[a]]]
        told = (
            f"Joints '{seen.names[a]}' and '{seen.names[b]}' fit the description with their torques exchanged"
        )
        trials.append((seen.errors(none, seen.torque[:, order]), (a, b), "order of torques", told))
    errors, on, kind, told = min(trials, key=lambda t: float(np.sum(t[0] ** 2)))
    # what a change of torques does not touch may have a fault of its own
    before, after = (
        float(np.sqrt(np.mean(e[list(on)] ** 2))) for e in (seen.errors(none, seen.torque), errors)
    )
    if after < MENDED * before:
        joint = ", ".join(seen.names[k] for k in on) if kind == "order of torques" else told.split("'")[1]
        sentence = f"{told}: relative torque error {after:.3g} instead of {before:.3g}."
        return (JointDoubt(joint, kind, before, after, sentence),)
    return scale_doubts(torque_scales(description, recording, cutoff=cutoff, hold=hold))


def scale_doubts(scales: Sequence[TorqueScale]) -> tuple[JointDoubt, ...]:
    """Return joints whose torque signals are further than a factor of two from what their links need."""
    doubts = []
    for s in scales:
        if not s.sure or 1.0 / FAR < s.value < FAR:
            continue
        guess = "is it a current, measured at the motor before its gear, or is a load not described?"
        told = (
            f"The torque signal of joint '{s.joint}' is {s.value:.3g} +- {NORMAL95 * s.sigma:.2g} times what "
            f"the described links need: {'has it the wrong sign?' if s.value < 0.0 else guess}"
        )
        doubts.append(JointDoubt(s.joint, "torque scale", float("nan"), float("nan"), told))
    return tuple(doubts)


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

    def errors(self, scale: np.ndarray, torque: np.ndarray) -> np.ndarray:
        """Return the relative errors (joints,) of torques (B, nv) with angles times ``scale`` (joints,).

        One positive scale per joint for the links, and the effects are fitted.
        """
        rows = self._at(scale)
        links, extra = rows[:, :, : self.theta.size] @ self.theta, rows[:, :, self.theta.size :]
        out = np.zeros(len(self.names))
        for k, j in enumerate(self.index.tolist()):
            own = extra[:, j]
            own = own[:, np.any(own != 0.0, axis=0)]
            size = np.linalg.norm(torque[:, j])
            columns = np.column_stack([links[:, j], own])
            x = np.linalg.lstsq(columns, torque[:, j], rcond=1e-10)[0]
            if x[0] < 0.0:  # the links' torque has one sign
                x = np.concatenate([[0.0], np.linalg.lstsq(own, torque[:, j], rcond=1e-10)[0]])
            out[k] = float(np.linalg.norm(torque[:, j] - columns @ x)) / size if size > 0.0 else 0.0
        return out

    def _at(self, scale: np.ndarray) -> np.ndarray:
        key = scale.tobytes()
        if key not in self._rows:
            rates = np.ones(self.v.shape[1])
            rates[self.index] = scale
            q = np.array([self.model.set_joint_angles(self.model.home, x) for x in self.angles * scale])
            states = JointStates(q, self.v * rates, self.a * rates, self.torque, self.temperature)
            self._rows[key], _, _ = torque_rows(self.model, states)
        return self._rows[key]
