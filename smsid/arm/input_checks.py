"""What looks wrong in the recording of an arm when it is compared with a description."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from smsid._statistics import NORMAL95
from smsid.arm._smooth_motion import smooth_motion
from smsid.arm.columns import JointStates
from smsid.arm.identify import rigid_arm, torque_rows
from smsid.arm.joint_torques import block_length, block_means
from smsid.arm.presets import with_joint_effects
from smsid.arm.torque_calibration import TorqueScale, known_links, torque_scales
from smsid.description import Description
from smsid.recording import Recording

FAR = 2.0
"""Factor by which a torque signal may differ from what the described links need."""

MENDED = 0.5
"""What is changed must bring the residual below this share of what it is as recorded."""

ALIKE = 1.1
"""Times the least error, up to which another change explains alike: of a joint that drives no other, turned
angles and turned torques do.
"""

DEGREE = np.pi / 180.0


@dataclass(frozen=True)
class JointDoubt:
    """Something that looks wrong about a joint.

    ``kind`` is ``sign of angle``, ``sign of torque``, ``sign of axis`` (both turned), ``degrees``, ``order of
    angles``, ``order of torques``, ``order of joints`` (both; ``joint`` names the two) or ``torque scale``;
    ``before`` and ``after`` are the relative errors as recorded and as suggested, of the torques of its
    joints or of all, whichever falls more (NaN for a scale).
    """

    joint: str
    kind: str
    before: float
    after: float
    told: str
    mend: str = ""

    @property
    def sentence(self) -> str:
        """What is doubted, and what mends it."""
        return f"{self.told}. {self.mend}" if self.mend else self.told


@dataclass(frozen=True)
class _Trial:
    """A change of the recording: angles (B, joints) become ``angles[:, order] * scale``, and torques alike.

    ``own`` are the places of the joints it is about.
    """

    joint: str
    kind: str
    told: str
    mend: str
    scale: np.ndarray
    order: np.ndarray
    torque_scale: np.ndarray
    torque_order: np.ndarray
    own: Sequence[int]


def joint_doubts(
    description: Description,
    recording: Recording,
    *,
    cutoff: float | None = None,
    hold: Mapping[str, float] | None = None,
) -> tuple[JointDoubt, ...]:
    """Return joints whose signs, units, order or torques' scale contradict a description.

    Angle, torque or both of one joint at a time are turned, its angle is taken for degrees, those of two
    joints are exchanged; torques of the described links, times a scale per joint, and effects are fitted each
    time. Every joint may have friction, a rotor and an offset, and no effect leaves its bounds: friction that
    drives would explain a turned angle. What more than halves the error is told; after that, scales further
    than a factor of two from 1 are: a current, or motor torque instead of joint torque.

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
    doubt = wrong_column(description, recording, cutoff=cutoff, hold=hold)
    if doubt is not None:
        return (doubt,)
    return scale_doubts(torque_scales(description, recording, cutoff=cutoff, hold=hold))


def wrong_column(
    description: Description,
    recording: Recording,
    *,
    cutoff: float | None = None,
    hold: Mapping[str, float] | None = None,
) -> JointDoubt | None:
    """Return the sign, unit or order that `joint_doubts` finds wrong; `None` if none is."""
    joints = rigid_arm(description, hold).arm_joints.names
    description = with_joint_effects(description, joints, "joint_friction", "torque_offset", "motor_inertia")
    seen = _BlockMeans(description, recording, cutoff, hold)
    as_recorded = seen.errors(_as_recorded(seen.names))
    found = []
    for trial in _trials(seen.names):
        errors = seen.errors(trial)
        # other joints may have faults of their own, and a turned axis shows at them alone
        sizes = [
            tuple(float(np.sqrt(np.mean(e[list(on)] ** 2))) for e in (as_recorded, errors))
            for on in (trial.own, range(len(errors)))
        ]
        before, after = min(sizes, key=lambda x: x[1] / max(x[0], 1e-300))
        found.append((float(np.linalg.norm(errors)), after < MENDED * before, before, after, trial))
    total, mended, before, after, best = min(found, key=lambda f: f[0])
    if not mended:
        return None
    alike = [t for size, mends, _, _, t in found if t is not best and mends and size < ALIKE * total]
    told = f"{best.told}: relative torque error {after:.3g} instead of {before:.3g}"
    told += "".join(f"; the {t.kind} of '{t.joint}' explains hardly less" for t in alike)
    mend = f"{best.mend} Torques do not tell which it is: ask who made the log." if alike else best.mend
    return JointDoubt(best.joint, best.kind, before, after, told, mend)


def _as_recorded(names: Sequence[str]) -> _Trial:
    same, order = np.ones(len(names)), np.arange(len(names))
    return _Trial("", "", "", "", same, order, same, order, range(len(names)))


def _trials(names: Sequence[str]) -> Iterator[_Trial]:
    """Yield every joint's angle and torque turned, its angle in degrees, and every two joints exchanged."""
    plain = _as_recorded(names)
    sign = "Mend the mapping: -1 at its place in `sign = [...]` of the"
    for k, name in enumerate(names):
        turned = np.where(plain.order == k, -1.0, 1.0)
        degrees = np.where(plain.order == k, DEGREE, 1.0)
        one = replace(plain, own=(k,), joint=name, told=f"Joint '{name}' fits the description with its ")
        for kind, what, mend, changed in (
            ("sign of angle", "angle turned round", f"{sign} angles", {"scale": turned}),
            ("sign of torque", "torque turned round", f"{sign} torques",
             {"torque_scale": turned}),
            ("sign of axis", "angle and torque both turned round", f"{sign} angles and of the torques",
             {"scale": turned, "torque_scale": turned}),
            ("degrees", "angle in degrees", 'Mend the mapping: unit = "degree" for it', {"scale": degrees}),
        ):  # fmt: skip
            yield replace(one, kind=kind, told=one.told + what, mend=f"{mend}.", **changed)
    for a, b in itertools.combinations(range(len(names)), 2):
        order = plain.order.copy()
        order[[a, b]] = b, a
        for what, changed in (
            ("angles", {"order": order}),
            ("torques", {"torque_order": order}),
            ("joints", {"order": order, "torque_order": order}),
        ):
            both = "angles and torques" if what == "joints" else what
            told = f"Joints '{names[a]}' and '{names[b]}' fit the description with their {both} exchanged"
            mend = f"Mend the mapping: their places in `columns` of the {both}."
            joint = f"{names[a]}, {names[b]}"
            yield replace(
                plain, own=(a, b), joint=joint, kind=f"order of {what}", told=told, mend=mend, **changed
            )


def scale_doubts(scales: Sequence[TorqueScale]) -> tuple[JointDoubt, ...]:
    """Return joints whose torque signals are further than a factor of two from what their links need."""
    doubts = []
    for s in scales:
        if not s.is_significant or 1.0 / FAR < s.value < FAR:
            continue
        guess = "is it a current, measured at the motor before its gear, or is a load not described?"
        told = (
            f"The torque signal of joint '{s.joint}' is {s.value:.3g} +- {NORMAL95 * s.sigma:.2g} times what "
            f"the described links need: {'has it the wrong sign?' if s.value < 0.0 else guess}"
        )
        doubts.append(JointDoubt(s.joint, "torque scale", float("nan"), float("nan"), told))
    return tuple(doubts)


class _BlockMeans:
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
        self._rows: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def errors(self, trial: _Trial) -> np.ndarray:
        """Return the relative errors (joints,) of the torques, changed as a trial says.

        One positive scale per joint for the links, and the effects within their bounds, are fitted.
        """
        rows, bounds = self._at(trial)
        links, extra = rows[:, :, : self.theta.size] @ self.theta, rows[:, :, self.theta.size :]
        out = np.zeros(len(self.names))
        torque = self.torque[:, self.index][:, trial.torque_order] * trial.torque_scale
        for k, j in enumerate(self.index.tolist()):
            acts = np.any(extra[:, j] != 0.0, axis=0)
            columns = np.column_stack([links[:, j], extra[:, j][:, acts]])
            limits = np.vstack([[0.0, np.inf], bounds[acts]])  # the links' torque has one sign
            size = np.linalg.norm(torque[:, k])
            out[k] = _residual_norm(columns, torque[:, k], limits) / size if size > 0.0 else 0.0
        return out

    def _at(self, trial: _Trial) -> tuple[np.ndarray, np.ndarray]:
        """Return rows (B, nv, n) of changed angles, and bounds (m, 2) of the effects' columns."""
        key = trial.scale.tobytes() + trial.order.tobytes()
        if key not in self._rows:
            v, a = self.v.copy(), self.a.copy()
            for rates, own in ((v, self.v), (a, self.a)):
                rates[:, self.index] = own[:, self.index][:, trial.order] * trial.scale
            angles = self.angles[:, trial.order] * trial.scale
            q = np.array([self.model.set_joint_angles(self.model.home, x) for x in angles])
            rows, names, _ = torque_rows(self.model, JointStates(q, v, a, self.torque, self.temperature))
            listed = {p.name: p for e in self.model.description.effect for p in e.parameters()}
            own = [listed[n] for n in names[self.theta.size :]]
            self._rows[key] = rows, np.array([[p.lower, p.upper] for p in own]).reshape(-1, 2)
        return self._rows[key]


def _residual_norm(columns: np.ndarray, target: np.ndarray, limits: np.ndarray) -> float:
    """Return the norm of what columns (B, n) with coefficients within limits (n, 2) leave of a target."""
    size = np.linalg.norm(columns, axis=0)
    columns, limits = columns[:, size > 0.0] / size[size > 0.0], limits[size > 0.0]
    basis, triangle = np.linalg.qr(columns)
    shown = basis.T @ target
    limits = limits * size[size > 0.0, None]
    x = lsq_linear(triangle, shown, (limits[:, 0], limits[:, 1]), method="bvls").x
    return float(np.linalg.norm(target - columns @ x))
