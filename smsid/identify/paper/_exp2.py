"""Exp. 2 from recording to parameters: hidden states, Step A, Step B, with the slosh state and as printed."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from smsid._short_repr import short_repr
from smsid.errors import NotIdentifiableError
from smsid.identify.estimate import ParameterEstimate
from smsid.identify.momentum_rows import CORRELATION_TIME
from smsid.identify.paper._exp2_errors import Steps, slosh_mass, with_errors
from smsid.identify.paper._momentum_printed import step_b_printed
from smsid.identify.paper.exp2_result import of_pose_point, of_printed, of_step_a, of_step_b
from smsid.identify.paper.hidden_states import HiddenStates, Modal, check_on_bus, hidden_states
from smsid.identify.paper.momentum import StepA, step_a, step_b
from smsid.identify.paper.momentum_regression import Regression
from smsid.identify.paper.motion import MeasuredMotion, prepare, raw_rates
from smsid.identify.paper.noise_replicates import add_noise_replicate
from smsid.identify.paper.pose_point import PosePoint, refine_pose_point
from smsid.identify.paper.rest import check_at_rest
from smsid.identify.stationary_joints import StationaryJoints, not_seen
from smsid.model.column_order import order_columns
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording

LEAST_RATE = 1e-3  # [rad/s] joint or wheel rate below which nothing was excited
SHORTEST = 10 * CORRELATION_TIME  # [s] below which correlated errors cannot be told from motion

T = TypeVar("T")


@short_repr
@dataclass(frozen=True)
class MomentumResult:
    """What Exp. 2 identified: Step A and B with the slosh state, and as printed beside them.

    ``pose_point`` is there when it was asked for; ``motion`` has it then.
    """

    motion: MeasuredMotion
    hidden: HiddenStates
    a: StepA
    b: Regression
    a_printed: StepA | None
    b_printed: Regression | None
    parameters: tuple[ParameterEstimate, ...]
    timing: dict[str, float]
    notes: tuple[str, ...] = ()
    conditions: dict[str, float] = field(default_factory=dict)
    pose_point: PosePoint | None = None


def identify_momentum(
    model: SpacecraftModel,
    recording: Recording,
    mass: float,
    *,
    cutoff: float | None = 2.0,
    rate: float | None = 20.0,
    modal: Modal = "smoother",
    perturbed: Sequence[tuple[SpacecraftModel, float]] = (),
    described: SpacecraftModel | None = None,
    refine: bool = False,
    replicates: bool = True,
) -> MomentumResult:
    """Identify inertial parameters from one recording of Exp. 2, starting at rest, without thrust.

    ``model`` carries what Exp. 1 found for slosh and appendages, ``mass`` is M [kg]. ``modal``: 'smoother'
    (with the identified modes) or 'printed' ((31)-(32) as printed). ``perturbed``
    are the model and mass with the results of Exp. 1 moved by a standard deviation in one direction after the
    other: what that moves is added to the covariance. ``refine`` corrects the tracked point first
    (`refine_pose_point`). ``described`` is the model that nominal values are taken from (default: ``model``).
    Without ``replicates`` of the noise, covariances are those of the regressions alone, and the steps as
    printed are left out.

    Raises `RecordingError` for missing or unusable channels, `NotIdentifiableError` when the recording cannot
    identify inertia, saying why.
    """
    timing: dict[str, float] = {}

    def timed(label: str, run: Callable[[], T]) -> T:
        started = time.perf_counter()
        out = run()
        timing[f"Exp. 2: {label}"] = time.perf_counter() - started
        return out

    check_on_bus(model)
    recording = order_columns(recording, model)
    _check_free(recording)
    still = StationaryJoints.of(model, recording)
    recording = still.held(model, recording)
    motion = timed("filtering", lambda: _prepare_twice(model, recording, cutoff, rate))
    _check_excited(model, recording, motion, still)
    check_at_rest(recording.name, raw_rates(model, recording))
    notes = [
        f"{a.appendage.name} has no accelerometers: its bending follows from the base's motion alone"
        for a in model.appendages
        if a.appendage.name not in motion.panels
    ]
    notes += still.notes(model) + _hardly_moving(model, motion, still)
    refined = None
    if refine:
        refined = timed("tracked point", lambda: refine_pose_point(model, motion, mass, modal=modal))
        motion = refined.motion
    hidden = timed("slosh and modal states", lambda: hidden_states(model, motion, modal))
    a = timed("Step A", lambda: step_a(model, motion, hidden, mass))
    b = timed("Step B", lambda: step_b(model, motion, hidden, mass, a.position))
    without = hidden.without_slosh()
    a_printed = b_printed = None
    if replicates:
        a_printed = step_a(model, motion, without, mass)
        try:
            b_printed = timed(
                "Step B as printed",
                lambda: step_b_printed(model, motion, without, mass, slosh_mass(model), a.position),
            )
        except NotIdentifiableError as error:
            notes.append(f"Step B as printed: {error}")
    steps = Steps(a, b, b_printed)
    place = {"pose_point": motion.pose_point, "imu_point": motion.imu_point}

    def noisier(rng: np.random.Generator) -> MeasuredMotion:
        recorded = add_noise_replicate(recording, model.description.effective_sensors(), rng)
        return replace(prepare(model, recorded, cutoff=cutoff, rate=rate), **place)

    if replicates:
        steps = timed("errors", lambda: with_errors(steps, model, motion, mass, modal, noisier, perturbed))
    if b_printed is not None and steps.printed is None:
        notes.append(
            "Step B as printed: the combinations it identifies change with the noise; it is left out"
        )
    parameters: list[ParameterEstimate] = []
    if refined:
        refined = replace(refined, sigma=steps.b.sigma[refined.chosen] / mass)
        parameters += of_pose_point(model, recording, refined)
    parameters += [*of_step_a(steps.a), *of_step_b(described or model, steps.b)]
    parameters += not_seen(described or model, still.joints, steps.b.base)
    conditions = {"Exp. 2, Step A": a.moments.solution.condition, "Exp. 2, Step B": b.solution.condition}
    if steps.printed is not None:
        parameters += of_printed(model, motion, without, slosh_mass(model), steps.printed)
        conditions["Exp. 2, Step B as printed"] = steps.printed.solution.condition
    return MomentumResult(
        motion,
        hidden,
        steps.a,
        steps.b,
        a_printed,
        steps.printed,
        tuple(parameters),
        timing,
        tuple(notes),
        conditions,
        refined,
    )


def _prepare_twice(
    model: SpacecraftModel, recording: Recording, cutoff: float | None, rate: float | None
) -> MeasuredMotion:
    noisier = add_noise_replicate(recording, model.description.effective_sensors(), np.random.default_rng(0))
    again = prepare(model, noisier, cutoff=cutoff, rate=rate)
    return replace(prepare(model, recording, cutoff=cutoff, rate=rate), again=again)


def _check_free(recording: Recording) -> None:
    if "command.force" in recording and np.abs(recording["command.force"]).max() > 1e-9:
        raise NotIdentifiableError(
            f"'{recording.name}' has thrust, so its momentum is not conserved: it is no Exp. 2.",
            advice="Fly Exp. 2 on wheels and arms only.",
        )


def _hardly_moving(model: SpacecraftModel, motion: MeasuredMotion, still: StationaryJoints) -> list[str]:
    speed = np.abs(motion.angle_rates).max(axis=0, initial=0.0)
    slow = [k for k in range(len(speed)) if speed[k] < LEAST_RATE and k not in still.joints]
    return [
        f"{model.arm_joints.names[k]} hardly moves (below {LEAST_RATE:g} rad/s, but more than its noise): "
        "what it tells of its link is little, and that makes the others' intervals wide; move it, or lock it"
        for k in slow
    ]


def _check_excited(
    model: SpacecraftModel, recording: Recording, motion: MeasuredMotion, still: StationaryJoints
) -> None:
    length = float(motion.time[-1] - motion.time[0])
    if length < SHORTEST:
        raise NotIdentifiableError(
            f"'{recording.name}' lasts {length:.3g} s: too short to tell motion from errors that stay for "
            f"{CORRELATION_TIME:g} s.",
            advice=f"Record at least {SHORTEST:g} s; the paper flies 80 s.",
            length=length,
            unexcited=True,
        )
    speed = np.abs(motion.angle_rates).max(axis=0, initial=0.0)
    if len(speed) and (speed.max() < LEAST_RATE or len(still.joints) == len(speed)):
        raise NotIdentifiableError(
            f"No joint moves in '{recording.name}' (all below {LEAST_RATE:g} rad/s, or within their noise): "
            "link inertias cannot be identified.",
            advice="Excite every joint of the arm; `smsid simulate DESC exp2` shows how.",
            speed=speed,
            unexcited=True,
        )
    turning = np.delete(motion.wheel_rates, still.wheels, axis=1)
    if np.abs(turning).max(initial=0.0) < LEAST_RATE:
        raise NotIdentifiableError(
            f"No wheel turns in '{recording.name}'{_by_wheel_channels(recording)}: without a known momentum, "
            "inertias are known only up to a factor.",
            advice="Spin the reaction wheels.",
            unexcited=True,
        )


def _by_wheel_channels(recording: Recording) -> str:
    """Return which channel says that wheels stand still, and what speaks against it."""
    channel = next((c for c in recording.channels if c.endswith(".wheel_rate")), None)
    told = "" if channel is None else f" by '{channel}'"
    command = "command.wheel_torque"
    driven = command in recording and bool(np.any(recording[command]))
    return told + (f", though '{command}' drives them (is the tachometer stuck?)" if driven else "")
