"""Identifying a welded arm from its joint torques.

Weighted linear least squares in base parameters (Gautier and Khalil 1990; Swevers et al. 1997).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid._short_repr import short_repr
from smsid.arm._friction_shape import FrictionShape, shape_notes, shape_values, with_found_shapes
from smsid.arm._smooth_motion import SmoothMotion, joined_motion, smooth_motion
from smsid.arm._solve import IN_STEP, AngleDelay, delay_note, settled_load, solve_equations, torque_means
from smsid.arm.columns import JointStates, effect_columns
from smsid.arm.comparison import JudgedArm, TorqueComparison
from smsid.arm.joint_torques import JointTorques, block_length, joint_torques
from smsid.arm.level import SHOWN, Level, with_gravity
from smsid.arm.readings import measured_channel, without_turns
from smsid.arm.regression import JointRegression
from smsid.arm.setup import with_held_joints
from smsid.description import Description
from smsid.effects.external import tilt_of, tilted_gravity
from smsid.errors import DescriptionError
from smsid.identify.estimate import HELD, SHAPE, Estimate, ParameterEstimate, classify
from smsid.model import SpacecraftModel
from smsid.model.identifiable import BaseParameters, base_parameters
from smsid.model.regressor import Regressor
from smsid.model.rigid_bodies import rigid_model
from smsid.recording import Recording
from smsid.recording.checks import check_roles, consistency_notes

GROUP = "arm"
COMMANDED = (
    "no torque was measured: the equations take the commanded ones; --method filter fits the motion under "
    "these"
)
RANDOM_STATES = 200  # that base parameters of any motion are told from


@short_repr
@dataclass(frozen=True)
class ArmIdentification(JudgedArm):
    """An identified arm.

    ``description`` is the given one with the identified values of its effects; ``base`` and ``regression``
    hold the combinations of inertial and effect parameters that torques tell apart, and their values.
    ``motion`` is what was fitted, ``delay`` by how much its angles are late against its torques,
    ``unused`` the joints whose torque signals took no part.
    """

    estimate: Estimate
    description: Description
    base: BaseParameters
    regression: JointRegression
    motion: SmoothMotion
    model: SpacecraftModel
    torques: JointTorques
    shapes: tuple[FrictionShape, ...] = ()
    delay: AngleDelay = IN_STEP
    unused: tuple[str, ...] = ()

    def compare(self, recording: Recording | None = None) -> TorqueComparison:
        """Return measured and predicted torques, averaged over the same blocks of time.

        Of the recording identified from, or of another.

        Raises:
            RecordingError: as `smooth_motion`.
        """
        if recording is None:
            torques = self.torques
            predicted = torques.rows[:, :, self.base.independent] @ self.regression.x
            return TorqueComparison(torques.time, torques.torque, predicted)
        motion = smooth_motion(self.model, recording)
        length = max(1, round(self.torques.length * self.motion.step / motion.step))
        made: list[JointTorques] = []

        def with_load(load: np.ndarray) -> np.ndarray:
            equations = joint_torques(self.model, motion, length, shape_values(self.shapes), load)
            aligned = torque_means(motion, equations.starts, self.delay.value)
            equations = replace(equations, torque=aligned)
            made.append(equations.only(np.broadcast_to(self._kept, aligned.shape)))
            return made[-1].rows[:, :, self.base.independent] @ self.regression.x

        blocks = np.zeros((len(motion.blocks(length)), motion.v.shape[1]))
        predicted = settled_load(self.model.description, with_load, blocks)
        return TorqueComparison(made[-1].time, made[-1].torque, predicted)

    def verdict(self) -> list[str]:
        """Return whether what is left is noise, and hints at what is plainly missing."""
        from smsid.arm._residual_dependence import leftover_sentences

        return leftover_sentences(self)

    @property
    def _kept(self) -> np.ndarray:
        """Tell (nv,) whose torque signals are used."""
        return np.array([n not in self.unused for n in list(self.model.pin.names)[1:]])


def identify_arm(
    description: Description,
    recording: Recording | Sequence[Recording],
    *,
    cutoff: float | None = None,
    hold: Mapping[str, float] | None = None,
    without: Collection[str] = (),
    gain_sigma: Mapping[str, float] | None = None,
    equal_errors: bool = False,
) -> ArmIdentification:
    """Identify the base parameters of a welded arm and its effects from motion and torque.

    The equations are linear: Pinocchio's torque regressor for the links, `effect_columns` for friction, motor
    inertia, couplings and offsets that the description lists. What only enters in combination is estimated in
    combination; the values the description gives take no part.

    Args:
        description: with ``root = "fixed"``, its gravity, and the effects to identify.
        recording: joint angles and torques, rates where measured; one recording or several, see
            `smooth_motion`.
        cutoff: up to where torques are compared [Hz]; by default as far as a few thousand equations go. The
            motion is smoothed at what its own data say.
        hold: joints that did not move and were not measured, with their positions [rad | m].
        without: joints whose torque signals are not used, as their gain is not known.
        gain_sigma: relative standard deviations of the gains of torque signals, by joint, for the intervals.
        equal_errors: take a joint's errors for as large near rest and at reversals as elsewhere, as published
            studies do; by default they count as large as they are, see `smsid.arm.near_rest`.

    Raises:
        DescriptionError: not a welded arm, or an effect that does not enter torques linearly.
        RecordingError: the recording is for validation, or does not fit.
        NotIdentifiableError: the motion does not excite what is asked.

    Source: Gautier and Khalil (1990) for base parameters, Gautier (1997) for the weights.
    """
    begin = time.perf_counter()
    model = rigid_arm(description, hold)
    recordings, motion, doubts = recorded_motion(model, recording)
    smoothed = time.perf_counter()
    tilt = tilt_of(description.effect)
    nominal = np.asarray(description.gravity)
    names = list(model.pin.names)[1:]
    kept = np.array([n not in without for n in names])
    doubt = np.array([gain_sigma.get(n, 0.0) for n in names]) if gain_sigma else None
    shown = with_gravity(model, tilted_gravity(nominal, *SHOWN)) if tilt else model
    base = structural_base(shown, kept=kept)
    torques = joint_torques(model, motion, block_length(motion, cutoff))
    if not kept.all():
        torques = torques.only(np.broadcast_to(kept, torques.torque.shape))
    level = Level.of(model, motion, torques, tilt) if tilt else None
    built = time.perf_counter()
    equations = solve_equations(model, motion, torques, base, level, doubt, equal_errors=equal_errors)
    shapes, torques, whole = equations.shapes, equations.torques, equations.regression
    count = len(base)
    solved = replace(whole, x=whole.x[:count], covariance=whole.covariance[:count, :count])
    parameters = _parameters(model, base, solved, torques.names, torques.units)
    # a parameter that only enters in combination keeps its value; the rest of that belongs to the links
    alone = zip(base.independent.tolist(), solved.x, strict=True)
    found, notes = with_values_in_bounds(description, {torques.names[i]: float(x) for i, x in alone})
    if tilt and level:
        sigmas = whole.sigma[count:]
        own = [
            classify(f"{tilt.name}.{axis}", float(x), "rad", float(s), GROUP, nominal=getattr(tilt, axis))
            for axis, x, s in zip("xy", equations.tilt, sigmas, strict=True)
        ]
        parameters = (*parameters[:count], *own, *parameters[count:])
        values = {p.name: p.value for p in own}
        found = found.with_effects(tilt.with_values(values))
        model = with_gravity(model, level.at(equations.tilt))
    found = with_found_shapes(found, shapes)
    done = time.perf_counter()
    notes += [*doubts, *motion_notes(model, motion, torques, solved)]
    notes += [
        f"'{e.name}' is part of the link that carries it: identified with it, its own values take no part"
        for e in description.effect
        if e.adds_to_body
    ]
    notes += [*shape_notes(shapes), *delay_note(equations.delay)]
    if any(measured_channel(one, "joint_torque").startswith("command.") for one in recordings):
        notes.append(COMMANDED)
    if equal_errors:
        notes.append("errors near rest were taken for as large as elsewhere, as was asked")
    estimate = Estimate(
        description=description.name,
        method="torque least squares",
        parameters=parameters,
        recordings=tuple(one.name for one in recordings),
        timing={
            "smoothing": smoothed - begin,
            "regressor": built - smoothed,
            "solve": done - built,
            "total": done - begin,
        },
        notes=tuple(notes),
        conditions={"torque regressor": solved.condition}
        | {HELD + j: x for j, x in (hold or {}).items()}
        | {f"{SHAPE}{s.effect}.{s.field}": s.value for s in shapes if s.status == "found"},
        covariance=padded_covariance(whole.covariance, len(parameters)),
    )
    return ArmIdentification(
        estimate, found, base, solved, motion, model, torques, shapes, equations.delay, tuple(without)
    )


def recorded_motion(
    model: SpacecraftModel,
    recording: Recording | Sequence[Recording],
    taken: Callable[[SpacecraftModel, Recording], Recording] = lambda _, recording: recording,
) -> tuple[tuple[Recording, ...], SmoothMotion, list[str]]:
    """Return recordings to identify from, their motion as ``taken``, and what is doubtful about them.

    Raises:
        RecordingError: a recording is for validation, or as `smooth_motion`.
    """
    recordings = (recording,) if isinstance(recording, Recording) else tuple(recording)
    check_roles(recordings)
    doubts = consistency_notes([without_turns(model, one) for one in recordings])
    motion = joined_motion([smooth_motion(model, taken(model, one)) for one in recordings])
    return recordings, motion, list(doubts)


def rigid_arm(description: Description, hold: Mapping[str, float] | None = None) -> SpacecraftModel:
    """Return the model of the links alone, and what they carry, which still knows the description's effects.

    Raises:
        DescriptionError: as `build_model`.
    """
    model = rigid_model(description)
    if tilt := tilt_of(description.effect):
        model.pin.gravity.linear = tilted_gravity(model.pin.gravity.linear, tilt.x, tilt.y)
    return with_held_joints(model, hold or {})


def torque_rows(
    model: SpacecraftModel, states: JointStates
) -> tuple[np.ndarray, tuple[str, ...], tuple[str, ...]]:
    """Return rows (N, nv, n) with ``rows @ x`` the motor torques, and names and units of x (n,).

    x stacks the inertial parameters of `Regressor` and those of the effects. ``states`` holds q (N, nq), v
    and a (N, nv), and what friction depends on.
    """
    links = Regressor(model)
    extra = [c for effect in model.description.effect for c in effect_columns(effect, model, states)]
    assert states.q is not None
    parts = [links.torque(states.q, states.v, states.a), *(c.values[:, :, None] for c in extra)]
    names, units = tuple(c.name for c in extra), tuple(c.unit for c in extra)
    return np.concatenate(parts, axis=2), links.names + names, links.units + units


def structural_base(model: SpacecraftModel, *, kept: np.ndarray | None = None) -> BaseParameters:
    """Base parameters of the arm for any motion: from random states, so that names do not depend on the
    log. Of the torques of the joints ``kept`` (nv,), all by default. Raises `DescriptionError` when torques
    depend on none.
    """
    rng = np.random.default_rng(0)
    angles = rng.uniform(-np.pi, np.pi, (RANDOM_STATES, len(model.arm_joints)))
    q = model.set_joint_angles(model.home, angles)
    v, a, load, warmth = rng.normal(size=(4, RANDOM_STATES, model.nv))
    rows, names, units = torque_rows(model, JointStates(q, v, a, load, 20.0 + 5.0 * warmth))
    if kept is not None:
        rows = rows * kept[:, None]
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
        classify(name, x, unit, s, GROUP, nominal=float(n))
        for name, unit, x, s, n in zip(base.names, base.units, solved.x, solved.sigma, listed, strict=True)
    ]
    kept = {names[i] for i in base.independent.tolist()}
    found += [
        ParameterEstimate(
            name, float("nan"), units[names.index(name)], float("nan"), "not_identifiable", GROUP, value,
            note="no torque tells it apart from the links: part of a combination above, or its joint unused",
        )
        for name, value in known.items()
        if name in names and name not in kept
    ]  # fmt: skip
    return tuple(found)


def padded_covariance(covariance: np.ndarray, size: int) -> np.ndarray:
    """Return a covariance (n, n) with rows and columns (size, size) of NaN for parameters no motion shows."""
    out = np.full((size, size), np.nan)
    out[: len(covariance), : len(covariance)] = covariance
    return out


def with_values_in_bounds(
    description: Description, values: Mapping[str, float]
) -> tuple[Description, list[str]]:
    """Return the description with values of its effects by name, and notes on those kept at a bound."""
    effects, notes = [], []
    for effect in description.effect:
        listed = [p for p in effect.parameters() if p.name in values]
        own = {p.name: min(max(values[p.name], p.lower), p.upper) for p in listed}
        effects.append(effect.with_values(own))
        notes += [
            f"{p.name} came out at {values[p.name]:.4g} {p.unit}; the description takes {own[p.name]:g}"
            for p in listed
            if own[p.name] != values[p.name]
        ]
    return description.with_effects(*effects), notes


def motion_notes(
    model: SpacecraftModel, motion: SmoothMotion, torques: JointTorques, solved: JointRegression
) -> list[str]:
    """Return sentences on how well the motion is known, and over what the torques were averaged."""
    names = model.arm_joints.names
    followed = ", ".join(f"{n} {j.cutoff:.3g} Hz" for n, j in zip(names, motion.joints, strict=True))
    noise = [j.noise for j in motion.joints]
    notes = [
        f"motion smoothed at cutoffs found from the data: {followed}; encoder noise {min(noise):.2g} to "
        f"{max(noise):.2g}" + (", measured rates taken in" if motion.readings.velocity.size else ""),
        f"{len(motion.time)} samples averaged over {torques.length} each: {len(torques.time)} equations a "
        "joint; "
        f"residuals are correlated over {solved.lags * torques.length * motion.step:.3g} s",
    ]
    if idle := [n for n, k in zip(names, model.arm_joints.v, strict=True) if not motion.torque[:, k].any()]:
        notes.append(f"no torque at {', '.join(idle)}: taken for joints without motors")
    notes += [
        f"the encoder of {n} begins anew after each turn: unwrapped {k} times"
        for n, k in motion.readings.unwrapped.items()
    ]
    notes += [f"{k} isolated outliers of {n} left out" for n, k in motion.readings.outliers.items()]
    return notes
