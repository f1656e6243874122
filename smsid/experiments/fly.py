"""Flying an experiment in simulation: motion, what the sensors saw, and which limits were passed."""

from __future__ import annotations

import platform
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from smsid._short_repr import short_repr
from smsid._version import __version__
from smsid.errors import ExperimentError
from smsid.experiments.plausibility import check_plausible, check_stroke
from smsid.experiments.scaling import bus_size
from smsid.experiments.schema import Experiment
from smsid.model.spacecraft import SpacecraftModel, group_angles
from smsid.recording import Recording
from smsid.sensing import observe
from smsid.simulate import Tolerance, Trajectory, simulate, truth_of
from smsid.simulate.trajectory import States


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
class Flight:
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
) -> Flight:
    """Simulate an experiment and record it with the description's sensors.

    Raises `ExperimentError` when the experiment does not fit the spacecraft, asks for what is not possible or
    drives a slosh mass far out of the bus, or the description has no sensors.
    """
    sensors = model.description.effective_sensors()
    if not sensors:
        raise ExperimentError(
            f"'{model.description.name}' has no sensors, so nothing would be recorded.",
            advice="Add [[sensor]] tables to the description.",
        )
    _check_sensors(model)
    check_plausible(model, experiment)
    inputs = experiment.inputs()
    # a clock that is ahead reports what happens after the end
    lead = max([0.0, *(-s.error(q).lag for s in sensors for q in s.quantities)])
    how = {"q0": experiment.start(model), "tolerance": tolerance, "progress": progress}
    trajectory = simulate(model, inputs, experiment.duration + lead, **how)
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
        },
    )
    times = np.linspace(
        trajectory.start, trajectory.start + experiment.duration, max(200, int(20 * experiment.duration)) + 1
    )
    states = trajectory.states(times)
    for use in _strokes(model, states):
        if use.limit is not None:
            check_stroke(use.quantity, use.value, use.limit)
    return Flight(trajectory, recording, limit_use(model, states, inputs.hold_attitude))


def _check_sensors(model: SpacecraftModel) -> None:
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
    d = model.description
    found: list[LimitUse] = []
    for i, name in enumerate(model.wheels.names):
        wheel = d.wheel[i]
        k = model.wheels.v[i]
        torque = np.abs(s.tau[:, k] + s.reaction[:, k]).max()
        found.append(LimitUse(f"torque of {name}", float(torque), wheel.max_torque, "N m"))
        found.append(LimitUse(f"rate of {name}", float(np.abs(s.v[:, k]).max()), wheel.max_rate, "rad/s"))
    angles = group_angles(model.pin, model.arm_joints, s.q)
    for i, name in enumerate(model.arm_joints.names):
        k, kq = model.arm_joints.v[i], model.arm_joints.q[i]
        torque = np.abs(s.tau[:, k] + s.reaction[:, k]).max()
        found.append(LimitUse(f"torque of {name}", float(torque), _limit(model.pin.effortLimit[k]), "N m"))
        found.append(
            LimitUse(
                f"rate of {name}", float(np.abs(s.v[:, k]).max()), _limit(model.pin.velocityLimit[k]), "rad/s"
            )
        )
        low, high = model.pin.lowerPositionLimit[kq], model.pin.upperPositionLimit[kq]
        if np.isfinite([low, high]).all() and model.pin.joints[int(model.arm_joints.joints[i])].nq == 1:
            centre, half = (low + high) / 2, (high - low) / 2
            reach = np.abs(angles[:, i] - centre).max()
            found.append(LimitUse(f"angle of {name} from its middle", float(reach), float(half), "rad"))
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
    return float(value) if np.isfinite(value) and 0.0 < value < 1e20 else None
