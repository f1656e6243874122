"""The paper's excitations: the thrust profile (48) and truncated Fourier series for wheels and arms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from smsid.errors import ExperimentError
from smsid.experiments.fly import LimitUse, limit_use
from smsid.experiments.scaling import SWING, THRUST, swings, wheel_strengths
from smsid.experiments.schema import Experiment, FourierProfile, StepProfile
from smsid.model.identifiable import base_parameters
from smsid.model.regressor import Regressor
from smsid.model.spacecraft import SpacecraftModel, outside_limits
from smsid.simulate import Tolerance, simulate

HARMONICS = 5
ROOM = 1e-3  # [rad] that a joint at a limit is left at least
DRAFT = Tolerance(1e-6, 1e-8)  # to rank candidates and see limits, not to make data


def thrust_experiment(
    axes: str = "xyz", *, force: float = THRUST, duration: float = 120.0, limited_by: str = ""
) -> Experiment:
    """Return Exp. 1, equation (48): +force, -force, 0 over thirds of ``duration / 2``, attitude held.

    ``axes`` are the body axes thrust acts along. Thrust is +f for t_f/6, -f until t_f/3, then zero.
    ``limited_by`` says in the note why ``force`` [N] is what it is. Raises `ExperimentError` for other axes.
    """
    if not axes or set(axes) - set("xyz"):
        raise ExperimentError(f"Thrust axes are letters of 'xyz', not '{axes}'.")
    direction = tuple(force if a in axes else 0.0 for a in "xyz")
    return Experiment(
        name="exp1" if axes == "xyz" else f"exp1_{axes}",
        note="Exp. 1: thrust (48), attitude held, joints and wheels locked"
        + (f"; {force:.4g} N, limited by {limited_by}" if limited_by else ""),
        duration=duration,
        hold_attitude=True,
        lock_joints=True,
        lock_wheels=True,
        force=StepProfile(
            times=(0.0, duration / 6, duration / 3),
            values=(direction, tuple(-f for f in direction), (0.0, 0.0, 0.0)),
        ),
    )


@dataclass(frozen=True)
class Excitation:
    """An Exp. 2 with the condition number of its scaled regressor and its use of the limits."""

    experiment: Experiment
    condition: float
    limits: tuple[LimitUse, ...]


def fourier_experiment(
    model: SpacecraftModel,
    rng: np.random.Generator,
    *,
    duration: float = 80.0,
    wheel_share: float = 0.5,
    candidates: int = 10,
    name: str = "exp2",
) -> Excitation:
    """Return Exp. 2: truncated Fourier series on wheels (torque) and arm joints (motion), free floating.

    Two periods in ``duration`` [s]. Of ``candidates`` random draws within joint, rate, torque and wheel
    limits, the one whose column-scaled momentum regressor has the smallest condition number is kept.
    Joints move by `SWING` about home at most, before limits shrink it; ``wheel_share`` is the share of wheel
    torque and rate limits used. The arm starts at rest.

    Raises `ExperimentError` when no candidate respects the limits.
    """
    if not len(model.arm_joints) and not len(model.wheels):
        raise ExperimentError("Exp. 2 needs wheels or arm joints to move.")
    best: Excitation | None = None
    broken: tuple[LimitUse, ...] = ()
    for _ in range(candidates):
        scale = 1.0
        for _ in range(6):  # torque depends on the motion: shrink until within limits
            experiment = _draw(model, rng.spawn(1)[0], duration, SWING * scale, wheel_share, name)
            trajectory = simulate(
                model, experiment.inputs(), duration, q0=experiment.start(model), tolerance=DRAFT
            )
            states = trajectory.states(np.linspace(0.0, duration, int(4 * duration) + 1))
            limits = limit_use(model, states)
            broken = tuple(u for u in limits if u.exceeded)
            if not broken:
                break
            scale *= 0.7
        if broken:
            continue
        condition = momentum_condition(model, states.q, states.v)
        if best is None or condition < best.condition:
            best = Excitation(experiment, condition, limits)
    if best is None:
        raise ExperimentError(
            "No candidate respects the limits: " + "; ".join(map(str, broken)) + ".",
            advice="Use a smaller wheel_share, or a longer duration.",
            limits=broken,
        )
    return best


def momentum_condition(model: SpacecraftModel, q: np.ndarray, v: np.ndarray) -> float:
    """Return the condition number of the column-scaled regressor of angular momentum, rigid bodies only.

    Of motions q (N, nq), v (N, nv) [rad, rad/s].
    """
    regressor = Regressor(model)
    rigid = set(regressor.bodies[: 1 + len(model.arm_joints)])
    keep = [i for i, n in enumerate(regressor.names) if n.rsplit(".", 1)[0] in rigid]
    y = regressor.momentum(q, v)[:, 3:, keep].reshape(-1, len(keep))
    base = base_parameters(y, [regressor.names[i] for i in keep], [regressor.units[i] for i in keep])
    return base.condition


def _draw(
    model: SpacecraftModel,
    rng: np.random.Generator,
    duration: float,
    amplitude: float,
    wheel_share: float,
    name: str,
) -> Experiment:
    frequency = 2.0 / duration
    order = np.arange(1, HARMONICS + 1)
    t = np.linspace(0.0, duration / 2, 400)
    phase = 2 * np.pi * frequency * np.outer(order, t)
    n, w = len(model.arm_joints), len(model.wheels)
    motion, notes, moved = None, [], []
    if n:
        home, moved = _start_angles(model)
        notes += moved
        a, b = rng.normal(size=(2, n, HARMONICS)) / order
        b -= (b @ order)[:, None] * order / (order @ order)  # zero rate at the start
        swing = a @ (np.cos(phase) - 1.0) + b @ np.sin(phase)
        rate = 2 * np.pi * frequency * (-(a * order) @ np.sin(phase) + (b * order) @ np.cos(phase))
        limits = model.joint_limits
        factor = swings(model, amplitude) / np.abs(swing).max(axis=1)
        for room, reach in (
            (limits.upper - home, swing.max(axis=1)),
            (home - limits.lower, -swing.min(axis=1)),
            (limits.rate, np.abs(rate).max(axis=1)),
        ):
            room = np.where(np.isfinite(room), np.maximum(room, ROOM), room)
            factor = np.minimum(factor, 0.9 * room / np.maximum(reach, 1e-12))
        a, b = a * factor[:, None], b * factor[:, None]
        motion = FourierProfile(
            frequency=frequency, cos=a.tolist(), sin=b.tolist(), offset=tuple(home - a.sum(axis=1))
        )
    torque = None
    if w:
        a, b = rng.normal(size=(2, w, HARMONICS)) / order
        peak = np.abs(a @ np.cos(phase) + b @ np.sin(phase)).max(axis=1)
        spin = (a / order) @ np.sin(phase) - (b / order) @ (np.cos(phase) - 1.0)
        swing = np.abs(spin).max(axis=1) / (2 * np.pi * frequency)
        limit, momentum, weak = wheel_strengths(model, wheel_share)
        notes += weak
        factor = np.minimum(limit / peak, momentum / swing)
        torque = FourierProfile(
            frequency=frequency, cos=(a * factor[:, None]).tolist(), sin=(b * factor[:, None]).tolist()
        )
    return Experiment(
        name=name,
        note="; ".join(["Exp. 2: truncated Fourier series on wheels and arms, free floating", *notes]),
        duration=duration,
        wheel_torque=torque,
        joint_motion=motion,
        joints=tuple(home.tolist()) if moved else None,
    )


def _start_angles(model: SpacecraftModel) -> tuple[np.ndarray, list[str]]:
    """Return the angles the arm starts from (joints,), home or, where that is beyond a limit, the middle."""
    angles = model.joint_angles(model.home)
    notes = []
    for use in outside_limits(model.pin, model.arm_joints, angles):
        angles[use.index] = use.middle
        notes.append(f"{use.name} starts at {use.middle:.4g}, the middle of its limits: {use}")
    return angles, notes
