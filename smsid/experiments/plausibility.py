"""Is what an experiment commands possible at all? Asked before hours of simulation."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from scipy.integrate import cumulative_trapezoid

from smsid.errors import ExperimentError
from smsid.experiments.scaling import spin_inertias
from smsid.experiments.schema import Experiment
from smsid.model.spacecraft import SpacecraftModel

ACCELERATION = 30.0  # [m/s^2] of a craft by its thrust; launchers take 60, free-flyers less than 1
ANGULAR_ACCELERATION = 30.0  # [rad/s^2] of a craft by its torque
WHEEL_RATE = 1500.0  # [rad/s] of a wheel without declared limit, 14 000 turns a minute
STROKE = 6.0  # of a slosh mass, in sizes of the bus; the paper's Exp. 1 drives its own to 4.4, and is flown
BEYOND = 3.0  # times a declared limit is no experiment any more; less is warned of after the flight
JOINT_ACCELERATION = 1e4  # [rad/s^2] of a joint by the torque commanded
JOINT_RATE = 100.0  # [rad/s] of a prescribed motion
SAMPLES = 2000
ADVICE = "Check the units, or scale the experiment; exp1 and exp2 fit themselves to the craft."


def check_plausible(model: SpacecraftModel, experiment: Experiment) -> None:
    """Raise `ExperimentError`, with number and limit, for commands no machine of this size can follow.

    Looked at are accelerations by thrust and torques, the rates wheels reach, and prescribed joint rates.
    Limits of the description may be passed by less than three times: a flight tells which. How far slosh goes
    only the flight knows: `check_stroke`.
    """
    inputs = experiment.inputs()
    times = np.linspace(0.0, experiment.duration, SAMPLES)
    mass = pin.crba(model.pin, model.pin.createData(), model.home)
    if inputs.force is not None and model.free:
        peak = float(np.abs(_sampled(inputs.force, times)).max())
        _refuse(peak / model.mass, ACCELERATION, "m/s^2", f"Thrust of {peak:.4g} N accelerates the craft by")
        limit = model.description.thrust.max_force
        if limit is not None:
            _refuse(peak, BEYOND * limit, "N", f"Thrust per axis ([thrust] max_force = {limit:g} N) reaches")
    if inputs.torque is not None and model.free:
        peak = float(np.abs(_sampled(inputs.torque, times)).max())
        least = float(np.diag(mass)[3:6].min())
        _refuse(peak / least, ANGULAR_ACCELERATION, "rad/s^2", f"A torque of {peak:.4g} N m turns the bus by")
    if inputs.wheel_torque is not None and len(model.wheels) and not experiment.lock_wheels:
        torque = _sampled(inputs.wheel_torque, times)
        if torque.shape[1] == len(model.wheels):  # otherwise the simulation says so
            momentum = np.abs(cumulative_trapezoid(torque, times, axis=0)).max(axis=0)
            for name, wheel, h, inertia in zip(
                model.wheels.names, model.description.wheel, momentum, spin_inertias(model), strict=True
            ):
                limit = WHEEL_RATE if wheel.max_rate is None else BEYOND * wheel.max_rate
                _refuse(
                    h / inertia, limit, "rad/s", f"Its torque spins wheel '{name}' ({inertia:.4g} kg m^2) to"
                )
    if inputs.joint_torque is not None and len(model.arm_joints) and not experiment.lock_joints:
        torque = _sampled(inputs.joint_torque, times)
        if torque.shape[1] == len(model.arm_joints):
            for i, name in enumerate(model.arm_joints.names):
                peak = float(np.abs(torque[:, i]).max())
                moved = float(mass[model.arm_joints.v[i], model.arm_joints.v[i]])
                what = f"A torque of {peak:.4g} N m accelerates joint '{name}' by"
                _refuse(peak / moved, JOINT_ACCELERATION, "rad/s^2", what)
    if inputs.joint_motion is not None:
        rates = np.abs(_sampled(inputs.joint_motion.velocity, times)).max(axis=0)
        for name, rate in zip(model.arm_joints.names, rates.tolist(), strict=False):
            _refuse(rate, JOINT_RATE, "rad/s", f"The motion asked moves joint '{name}' at")


def check_stroke(what: str, stroke: float, room: float) -> None:
    """Raise `ExperimentError` for a slosh mass that flew far out of the bus, both in m: less is warned of."""
    advice = "Check its stiffness and the thrust, or fly for a shorter time."
    _refuse(stroke, STROKE * room, "m", f"In a bus of {room:.4g} m the {what} reaches", advice)


def _sampled(signal: object, times: np.ndarray) -> np.ndarray:
    return np.array([signal(float(t)) for t in times])  # type: ignore[operator]


def _refuse(value: float, limit: float, unit: str, what: str, advice: str = ADVICE) -> None:
    if not value <= limit:
        raise ExperimentError(
            f"{what} {value:.4g} {unit}; more than {limit:.4g} {unit} is not possible.",
            advice=advice,
            value=value,
            limit=limit,
        )
