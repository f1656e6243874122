"""Identifying a welded arm from its joint torques.

Weighted linear least squares in base parameters (Gautier and Khalil 1990; Swevers et al. 1997).
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from smsid._short_repr import short_repr
from smsid.arm.columns import torque_columns
from smsid.arm.motion import JointMotion, joint_motion
from smsid.arm.regression import JointRegression, solve_joints
from smsid.description import Description
from smsid.effects import Effect
from smsid.errors import DescriptionError, RecordingError
from smsid.identify.estimate import Estimate, ParameterEstimate, judged
from smsid.model import SpacecraftModel, build_model
from smsid.model.assembly import Assembly
from smsid.model.identifiable import BaseParameters, base_parameters
from smsid.model.regressor import Regressor
from smsid.recording import Recording
from smsid.recording._checks import check_components

GROUP = "arm"


@dataclass(frozen=True)
class TorqueErrors:
    """How far predicted torques are from measured ones.

    ``relative`` is ``|predicted - measured| / |measured|`` over all samples and joints, ``by_joint`` the
    same of each; ``rmse`` by joint [N m].
    """

    relative: float
    by_joint: dict[str, float]
    rmse: dict[str, float]


@short_repr
@dataclass(frozen=True)
class ArmIdentification:
    """An identified arm.

    ``description`` is the given one with the identified values of its effects; ``base`` and ``regression``
    hold the combinations of inertial and effect parameters that torques tell apart, and their values.
    ``motion`` is what was fitted.
    """

    estimate: Estimate
    description: Description
    base: BaseParameters
    regression: JointRegression
    motion: JointMotion
    model: SpacecraftModel

    def predict(self, motion: JointMotion) -> np.ndarray:
        """Return motor torques (N, nv) at the joints for a motion [N m]."""
        rows, _, _ = torque_rows(self.model, motion.q, motion.v, motion.a)
        return rows[:, :, self.base.independent] @ self.regression.x

    def residual(self, recording: Recording | None = None) -> np.ndarray:
        """Return measured minus predicted motor torques (N, nv) at the joints [N m].

        Of the recording identified from, or of another, at the times of its `joint_motion`.

        Raises:
            RecordingError: as `joint_motion`.
        """
        motion = self.motion if recording is None else joint_motion(self.model, recording, self.motion.cutoff)
        return motion.torque - self.predict(motion)

    def judge(self, recording: Recording) -> TorqueErrors:
        """Return the errors on another recording, filtered like the one identified from.

        Raises:
            RecordingError: as `joint_motion`.
        """
        motion = joint_motion(self.model, recording, self.motion.cutoff)
        return torque_errors(self.model, self.predict(motion), motion.torque)


def identify_arm(
    description: Description, recording: Recording, *, cutoff: float | None = None
) -> ArmIdentification:
    """Identify the base parameters of a welded arm and its effects from motion and torque.

    The equations are linear: Pinocchio's torque regressor for the links, `torque_columns` for friction, motor
    inertia, couplings and offsets that the description lists. What only enters in combination is estimated in
    combination; the values the description gives take no part.

    Args:
        description: with ``root = "fixed"``, its gravity, and the effects to identify.
        recording: joint angles and torques; see `joint_motion`.
        cutoff: of the low-pass [Hz]; default a fiftieth of the sampling rate.

    Raises:
        DescriptionError: not a welded arm, or an effect that does not enter torques linearly.
        RecordingError: the recording is for validation, or does not fit.
        NotIdentifiableError: the motion does not excite what is asked.

    Source: Gautier and Khalil (1990) for base parameters, Gautier (1997) for the weights.
    """
    begin = time.perf_counter()
    if recording.role == "validation":
        raise RecordingError(
            f"'{recording.name}' is for validation.", advice="Identify from one in the role estimation."
        )
    model = rigid_arm(description)
    if not recording.provenance.get("unchecked"):
        check_components(recording)
    motion = joint_motion(model, recording, cutoff)
    filtered = time.perf_counter()
    base = structural_base(model)
    rows, names, units = torque_rows(model, motion.q, motion.v, motion.a)
    built = time.perf_counter()
    solved = solve_joints(rows[:, :, base.independent], motion.torque)
    parameters = _parameters(model, base, solved, names, units)
    found, notes = identified_effects(description, base, solved, names)
    done = time.perf_counter()
    notes.append(
        f"low-pass at {motion.cutoff:g} Hz, {len(motion.time)} samples at {motion.rate:.6g} Hz; residuals "
        "are "
        f"correlated over {solved.lags / motion.rate:.3g} s"
    )
    estimate = Estimate(
        description=description.name,
        method="torque least squares",
        parameters=parameters,
        recordings=(recording.name,),
        timing={
            "filter": filtered - begin,
            "regressor": built - filtered,
            "solve": done - built,
            "total": done - begin,
        },
        notes=tuple(notes),
        conditions={"torque regressor": solved.condition},
        covariance=_padded(solved.covariance, len(parameters)),
    )
    return ArmIdentification(estimate, found, base, solved, motion, model)


def rigid_arm(description: Description) -> SpacecraftModel:
    """Return the model of the links alone, which still knows the description's effects.

    Raises:
        DescriptionError: as `build_model`.
    """
    model = build_model(description.model_copy(update={"effect": (_Scaffold(name="scaffold"),)}))
    model.pin.armature[:] = 0.0
    return replace(model, description=description)


class _Scaffold(Effect):
    """Lets a model be built whose links alone leave a joint without inertia: torques need no forward
    dynamics.
    """

    kind: Literal["scaffold"] = "scaffold"

    def attach(self, assembly: Assembly) -> None:
        assembly.model.armature[:] = 1.0


def torque_rows(
    model: SpacecraftModel, q: np.ndarray, v: np.ndarray, a: np.ndarray
) -> tuple[np.ndarray, tuple[str, ...], tuple[str, ...]]:
    """Return rows (N, nv, n) with ``rows @ x`` the motor torques, and names and units of x (n,).

    x stacks the inertial parameters of `Regressor` and those of the effects, for q (N, nq), v and a (N, nv).
    """
    links = Regressor(model)
    extra = [c for effect in model.description.effect for c in torque_columns(effect, model, v, a)]
    parts = [links.torque(q, v, a), *(c.values[:, :, None] for c in extra)]
    names, units = tuple(c.name for c in extra), tuple(c.unit for c in extra)
    return np.concatenate(parts, axis=2), links.names + names, links.units + units


def torque_errors(model: SpacecraftModel, predicted: np.ndarray, measured: np.ndarray) -> TorqueErrors:
    """Compare torques of the model's joints, ``predicted`` and ``measured``, (N, nv) [N m]."""
    error = predicted - measured
    joints = dict(zip(model.arm_joints.names, model.arm_joints.v.tolist(), strict=True))
    return TorqueErrors(
        float(np.linalg.norm(error) / np.linalg.norm(measured)),
        {n: float(np.linalg.norm(error[:, k]) / np.linalg.norm(measured[:, k])) for n, k in joints.items()},
        {n: float(np.sqrt(np.mean(error[:, k] ** 2))) for n, k in joints.items()},
    )


def structural_base(model: SpacecraftModel, samples: int = 200) -> BaseParameters:
    """Base parameters of the arm for any motion: from random states, so that names do not depend on the
    log. Raises `DescriptionError` when torques depend on none.
    """
    rng = np.random.default_rng(0)
    angles = rng.uniform(-np.pi, np.pi, (samples, len(model.arm_joints)))
    q = np.array([model.set_joint_angles(model.home, x) for x in angles])
    v, a = rng.normal(size=(2, samples, model.nv))
    rows, names, units = torque_rows(model, q, v, a)
    if len(set(names)) != len(names):
        raise DescriptionError(
            "Two parameters share a name.", advice="Rename an effect that is named like a link."
        )
    return base_parameters(rows.reshape(-1, len(names)), names, units)


def _parameters(
    model: SpacecraftModel,
    base: BaseParameters,
    solved: JointRegression,
    names: tuple[str, ...],
    units: tuple[str, ...],
) -> tuple[ParameterEstimate, ...]:
    known = {p.name: p.value for effect in model.description.effect for p in effect.parameters()}
    nominal = np.concatenate([Regressor(model).parameters, [known[n] for n in names if n in known]])
    listed = base.values(nominal)
    found = [
        judged(name, x, unit, s, GROUP, nominal=float(n))
        for name, unit, x, s, n in zip(base.names, base.units, solved.x, solved.sigma, listed, strict=True)
    ]
    kept = {names[i] for i in base.independent.tolist()}
    found += [
        ParameterEstimate(
            name, float("nan"), units[names.index(name)], float("nan"), "not_identifiable", GROUP, value,
            note="no motion of the arm tells it apart from the links; it is part of a combination above",
        )
        for name, value in known.items()
        if name in names and name not in kept
    ]  # fmt: skip
    return tuple(found)


def _padded(covariance: np.ndarray, size: int) -> np.ndarray:
    """Return the covariance with rows and columns that are not known for the parameters no motion shows."""
    out = np.full((size, size), np.nan)
    out[: len(covariance), : len(covariance)] = covariance
    return out


def identified_effects(
    description: Description, base: BaseParameters, solved: JointRegression, names: tuple[str, ...]
) -> tuple[Description, list[str]]:
    """Return the description with its effects at the identified values, and notes on those at a bound.

    A parameter that only enters in combination keeps its value, and the rest of the combination belongs to
    the links.
    """
    value = {names[i]: float(x) for i, x in zip(base.independent.tolist(), solved.x, strict=True)}
    effects, notes = [], []
    for effect in description.effect:
        own = {}
        for p in effect.parameters():
            if p.name not in value:
                continue
            own[p.name] = min(max(value[p.name], p.lower), p.upper)
            if own[p.name] != value[p.name]:
                notes.append(
                    f"{p.name} came out at {value[p.name]:.4g} {p.unit}; the description takes "
                    f"{own[p.name]:g}"
                )
        effects.append(effect.with_values(own) if own else effect)
    return description.with_effects(*effects), notes
