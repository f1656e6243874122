"""Flying an experiment in simulation: motion, what the sensors saw, and which limits were passed."""

from __future__ import annotations

import platform
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
import scipy  # loads a part of it when that is used

from smsid._short_repr import short_repr
from smsid._version import __version__
from smsid.errors import ExperimentError
from smsid.experiments.scaling import bus_size, spin_inertias
from smsid.experiments.schema import Experiment
from smsid.inputs.signals import sample
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording
from smsid.sensing import observe
from smsid.simulate import Inputs, Tolerance, Trajectory, simulate, truth_of
from smsid.simulate.trajectory import States

LOOKS = 2001  # times of an experiment at which shares of thrust are looked at
PART = 1e-6  # of full thrust, within which a share is none, or all


@dataclass(frozen=True)
class LimitUse:
    """How far an experiment goes towards a limit: largest value and the limit (``None``: no limit stated)."""

    quantity: str
    value: float
    limit: float | None
    unit: str

    @property
    def exceeded(self) -> bool:
        """True when the limit is passed."""
        return self.limit is not None and self.value > self.limit * (1 + 1e-9)

    def __str__(self) -> str:
        limit = "no limit stated" if self.limit is None else f"limit {self.limit:.4g} {self.unit}"
        return f"{self.quantity}: {self.value:.4g} {self.unit} ({limit})"


@short_repr
@dataclass(frozen=True)
class FlownExperiment:
    """A flown experiment."""

    trajectory: Trajectory
    recording: Recording
    limits: tuple[LimitUse, ...]

    @property
    def exceeded(self) -> tuple[LimitUse, ...]:
        """The limits that were passed."""
        return tuple(u for u in self.limits if u.exceeded)


def fly(
    model: SpacecraftModel,
    experiment: Experiment,
    rng: np.random.Generator,
    *,
    role: str = "estimation",
    tolerance: Tolerance | None = None,
    progress: Callable[[float], None] | None = None,
) -> FlownExperiment:
    """Simulate an experiment and record it with the description's sensors.

    Raises `ExperimentError` when the experiment does not fit the spacecraft, asks for what is not possible or
    drives a slosh mass far out of the bus, or the description has no sensors.
    """
    check_sensors(model)
    check_plausible(model, experiment)
    inputs = experiment.inputs()
    _check_pulses(model, inputs, experiment.duration)
    how: dict[str, Any] = {"q0": experiment.start(model), "tolerance": tolerance, "progress": progress}
    trajectory = simulate(model, inputs, experiment.duration + clock_lead(model), **how)
    return record_motion(trajectory, experiment, rng, role=role, hold_attitude=inputs.hold_attitude)


def _check_pulses(model: SpacecraftModel, inputs: Inputs, duration: float) -> None:
    """Raise `ExperimentError` where thrusters that fire in pulses are to give a part of their thrust.

    What is simulated has no samples yet: a share acts all through, and would be read as another motion's.
    """
    pulsed = [k for k, t in enumerate(model.description.thruster) if t.pulse != "spread"]
    if inputs.thruster is None or not pulsed:
        return
    shares = sample(inputs.thruster, np.linspace(0.0, duration, LOOKS))[:, pulsed]
    part = (shares > PART) & (shares < 1.0 - PART)
    if part.any():
        thruster = model.description.thruster[pulsed[int(np.argmax(part.any(axis=0)))]]
        raise ExperimentError(
            f"Thruster '{thruster.name}' fires in pulses, and the experiment asks for "
            f"{shares[part][0]:.3g} of its thrust all through.",
            advice="Switch it between 0 and 1, or leave out `pulse` for what is a throttle.",
        )


def record_motion(
    trajectory: Trajectory,
    experiment: Experiment,
    rng: np.random.Generator,
    *,
    role: str = "estimation",
    hold_attitude: bool = False,
    provenance: Mapping[str, Any] | None = None,
) -> FlownExperiment:
    """Return what the description's sensors record of an experiment's motion, and which limits it meets.

    ``hold_attitude`` says that something held the bus; ``provenance`` is remembered beside the experiment.
    Raises `ExperimentError` when a slosh mass is driven far out of the bus.
    """
    model = trajectory.model
    sensors = model.description.effective_sensors()
    truth = truth_of(trajectory, sensors)
    available = truth(np.array([trajectory.start]))
    exact = [name for name in available if name.startswith(("command.", "truth"))]
    labels = {"joint": list(model.arm_joints.names), "wheel": list(model.wheels.names)}
    labels["thruster"] = [t.name for t in model.description.thruster]
    recording = observe(
        truth,
        sensors,
        start=trajectory.start,
        stop=trajectory.start + experiment.duration,
        known_until=trajectory.stop,
        rng=rng,
        exact=exact,
        labels={k: v for k, v in labels.items() if v},
        role=role,
        name=experiment.name,
        provenance={
            "simulated_by": f"smsid {__version__}",
            "pinocchio": pin.__version__,
            "python": platform.python_version(),
            "description": model.description.name,
            "experiment": experiment.model_dump(mode="json", by_alias=True, exclude_none=True),
            **(provenance or {}),
        },
    )
    times = np.linspace(
        trajectory.start, trajectory.start + experiment.duration, max(200, int(20 * experiment.duration)) + 1
    )
    states = trajectory.states(times)
    for use in _strokes(model, states):
        if use.limit is not None:
            check_stroke(use.quantity, use.value, use.limit)
    return FlownExperiment(trajectory, recording, limit_use(model, states, hold_attitude))


def clock_lead(model: SpacecraftModel) -> float:
    """Return how far the clock of a sensor is ahead at most [s]: it reports what happens after the end."""
    sensors = model.description.effective_sensors()
    return max([0.0, *(-s.error(q).lag for s in sensors for q in s.quantities)])


def check_sensors(model: SpacecraftModel) -> None:
    """Raise `ExperimentError` for a description without sensors, or with one that has nothing to measure."""
    if not model.description.sensor:
        raise ExperimentError(
            f"'{model.description.name}' has no sensors, so nothing would be recorded.",
            advice="Add [[sensor]] tables to the description.",
        )
    empty = {"encoder": ("arm joint", model.arm_joints), "tachometer": ("wheel", model.wheels)}
    for sensor in model.description.sensor:
        what, group = empty.get(sensor.kind, ("", (None,)))
        if not len(group):
            raise ExperimentError(
                f"Sensor '{sensor.name}' has nothing to measure: '{model.description.name}' has no {what}.",
                advice="Remove the sensor from the description.",
                sensor=sensor.name,
            )


def limit_use(model: SpacecraftModel, s: States, hold_attitude: bool = False) -> tuple[LimitUse, ...]:
    """Return how far states go towards every limit of wheels, joints and thrust, and the slosh stroke."""
    d, own = model.description, model.joint_limits
    torque, rate = np.abs(s.tau + s.reaction).max(axis=0), np.abs(s.v).max(axis=0)
    found: list[LimitUse] = []

    def add(name: str, k: int, most: float | None, fastest: float | None) -> None:
        found.append(LimitUse(f"torque of {name}", float(torque[k]), most, "N m"))
        found.append(LimitUse(f"rate of {name}", float(rate[k]), fastest, "rad/s"))

    for name, k, wheel in zip(model.wheels.names, model.wheels.v, d.wheel, strict=True):
        add(name, k, wheel.max_torque, wheel.max_rate)
    angles = model.joint_angles(s.q)
    for i, (name, k) in enumerate(zip(model.arm_joints.names, model.arm_joints.v, strict=True)):
        add(name, k, _limit(own.effort[i]), _limit(own.rate[i]))
        low, high = float(own.lower[i]), float(own.upper[i])
        if high < np.inf:
            reach = float(np.abs(angles[:, i] - (low + high) / 2).max())
            found.append(LimitUse(f"angle of {name} from its middle", reach, (high - low) / 2, "rad"))
    if model.free:
        force = np.abs(s.tau[:, :3]).max()
        found.append(LimitUse("thrust per axis", float(force), d.thrust.max_force, "N"))
        if hold_attitude:
            found.append(
                LimitUse("torque holding the attitude", float(np.abs(s.reaction[:, 3:6]).max()), None, "N m")
            )
    return (*found, *_strokes(model, s))


def _strokes(model: SpacecraftModel, s: States) -> list[LimitUse]:
    found = []
    for joint in model.slosh:
        stroke = np.linalg.norm(s.q[:, joint.q], axis=1).max()
        # a slosh mass that leaves the bus is beyond its model
        room = bus_size(model) if joint.joint and model.pin.parents[joint.joint] == 1 else None
        found.append(LimitUse(f"stroke of {joint.name}", float(stroke), room, "m"))
    return found


def _limit(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


IMPLAUSIBLE_ACCELERATION = 30.0  # [m/s^2] by thrust; launchers take 60, free-flyers less than 1
ANGULAR_ACCELERATION = 30.0  # [rad/s^2] of a craft by its torque
IMPLAUSIBLE_WHEEL_RATE = 1500.0  # [rad/s] of a wheel without declared limit, 14 000 turns a minute
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
        peak = float(np.abs(sample(inputs.force, times)).max())
        what = f"Thrust of {peak:.4g} N accelerates the craft by"
        _refuse(peak / model.mass, IMPLAUSIBLE_ACCELERATION, "m/s^2", what)
        limit = model.description.thrust.max_force
        if limit is not None:
            _refuse(peak, BEYOND * limit, "N", f"Thrust per axis ([thrust] max_force = {limit:g} N) reaches")
    if inputs.torque is not None and model.free:
        peak = float(np.abs(sample(inputs.torque, times)).max())
        least = float(np.diag(mass)[3:6].min())
        _refuse(peak / least, ANGULAR_ACCELERATION, "rad/s^2", f"A torque of {peak:.4g} N m turns the bus by")
    if inputs.wheel_torque is not None and len(model.wheels) and not experiment.lock_wheels:
        torque = sample(inputs.wheel_torque, times)
        if torque.shape[1] == len(model.wheels):  # otherwise the simulation says so
            momentum = np.abs(scipy.integrate.cumulative_trapezoid(torque, times, axis=0)).max(axis=0)
            for name, wheel, h, inertia in zip(
                model.wheels.names, model.description.wheel, momentum, spin_inertias(model), strict=True
            ):
                limit = IMPLAUSIBLE_WHEEL_RATE if wheel.max_rate is None else BEYOND * wheel.max_rate
                _refuse(
                    h / inertia, limit, "rad/s", f"Its torque spins wheel '{name}' ({inertia:.4g} kg m^2) to"
                )
    if inputs.joint_torque is not None and len(model.arm_joints) and not experiment.lock_joints:
        torque = sample(inputs.joint_torque, times)
        if torque.shape[1] == len(model.arm_joints):
            for i, name in enumerate(model.arm_joints.names):
                peak = float(np.abs(torque[:, i]).max())
                moved = float(mass[model.arm_joints.v[i], model.arm_joints.v[i]])
                what = f"A torque of {peak:.4g} N m accelerates joint '{name}' by"
                _refuse(peak / moved, JOINT_ACCELERATION, "rad/s^2", what)
    if inputs.joint_motion is not None:
        rates = np.abs(sample(inputs.joint_motion.velocity, times)).max(axis=0)
        for name, rate in zip(model.arm_joints.names, rates.tolist(), strict=False):
            _refuse(rate, JOINT_RATE, "rad/s", f"The motion asked moves joint '{name}' at")


def check_stroke(what: str, stroke: float, room: float) -> None:
    """Raise `ExperimentError` for a slosh mass that flew far out of the bus, both in m: less is warned of."""
    advice = "Check its stiffness and the thrust, or fly for a shorter time."
    _refuse(stroke, STROKE * room, "m", f"In a bus of {room:.4g} m the {what} reaches", advice)


def _refuse(value: float, limit: float, unit: str, what: str, advice: str = ADVICE) -> None:
    if not value <= limit:
        raise ExperimentError(
            f"{what} {value:.4g} {unit}; more than {limit:.4g} {unit} is not possible.",
            advice=advice,
            value=value,
            limit=limit,
        )
