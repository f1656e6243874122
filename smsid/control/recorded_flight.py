"""An experiment flown under a saved controller and recorded: commands in it answer to what its sensors read.

The wheels hold the attitude and the joints follow the experiment's motion, or keep their angles, by (43) or
(46); thrust and torques on the bus act as the experiment has them, held from call to call as a flight
computer does. Effects on actuators act on what the controller asks for. What the controller reads are the
samples of the recording, noise included, so torques and errors of sensors depend on each other as in a real
flight.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from smsid.control._sensed import SensedState
from smsid.control.closed_loop import Actuators, TrackingRun, tracking_of
from smsid.control.controller_file import SavedController
from smsid.control.trajectory import Motion, Reference, check_joints
from smsid.experiments.fly import FlownExperiment, check_plausible, check_sensors, clock_lead, record_motion
from smsid.experiments.schema import Experiment
from smsid.inputs.inputs import Inputs, JointMotion
from smsid.inputs.signals import Fourier, Sampled
from smsid.kernel.arrays import Kernel
from smsid.model.spacecraft import SpacecraftModel
from smsid.sensing.observe import NoiseStreams
from smsid.simulate import simulate
from smsid.simulate.fixed_step import check_finite
from smsid.simulate.held_step import take_held_steps

LONGEST_STEP = 0.01  # [s], what carries slosh and bending at the accuracy of a closed loop
SAME_TIME = 1e-9  # [s], of two edges


@dataclass(frozen=True)
class ControlledFlight:
    """A flight and its recording, with the errors of the true state at the controller's calls."""

    flight: FlownExperiment
    tracking: TrackingRun


@dataclass(frozen=True)
class JointPath(Motion):
    """A motion of the joints along signals, until ``duration`` [s]."""

    along: JointMotion
    duration: float

    @property
    def size(self) -> int:
        """Number of joints."""
        return self.along.position.size

    def at(self, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return angle, rate and acceleration (n,) at t [s]."""
        return self.along.position(t), self.along.velocity(t), self.along.acceleration(t)


class AskedTorques:
    """A signal whose values are written as the flight goes: ``table`` (N, size), held for ``period`` [s]."""

    def __init__(self, table: np.ndarray, period: float, matrix: np.ndarray | None = None) -> None:
        """Read ``table``, mapped by ``matrix`` (m, size)."""
        self.table, self.period = table, period
        self.matrix = np.eye(table.shape[1]) if matrix is None else matrix

    @property
    def size(self) -> int:
        """Number of components."""
        return len(self.matrix)

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """The calls [s]."""
        return tuple((self.period * np.arange(len(self.table))).tolist())

    def __call__(self, t: float) -> np.ndarray:
        """Value at t; zero before the first call."""
        k = min(math.floor(t / self.period), len(self.table) - 1)
        return self.matrix @ self.table[k] if k >= 0 else np.zeros(self.size)

    def mapped(self, matrix: np.ndarray) -> AskedTorques:
        """Return ``matrix @ self``, matrix (m, size), of what is still to be written."""
        return AskedTorques(self.table, self.period, matrix @ self.matrix)


def fly_controlled(
    model: SpacecraftModel,
    saved: SavedController,
    experiment: Experiment,
    rng: np.random.Generator,
    *,
    path: Motion | None = None,
    role: str = "estimation",
    progress: Callable[[float], None] | None = None,
) -> ControlledFlight:
    """Fly an experiment under a controller at its rate, and record it with the description's sensors.

    Wheel and joint torques of the experiment, and what it holds or locks, are left out: they are the
    controller's. ``path`` is followed by the joints instead of its motion. ``progress`` is called with the
    time [s] of every call.

    Raises:
        ControlError: a controller of another spacecraft, a quantity it needs that no sensor measures, or a
            motion beyond the joints' limits.
        ExperimentError: as `smsid.experiments.fly`.
        SimulationError: the loop blew up.
    """
    check_sensors(model)
    check_plausible(model, experiment)
    own = {"wheel_torque": None, "joint_torque": None}
    held = {"hold_attitude": False, "lock_joints": False, "lock_wheels": False}
    plan = experiment.model_copy(update={"name": f"{experiment.name}_controlled", **own, **held})
    period = 1.0 / saved.rate
    calls = math.ceil((plan.duration + clock_lead(model)) * saved.rate - 1e-6)
    times = np.arange(calls + 1) / saved.rate  # as clocks of sensors are made: equal times are the same

    path = _joint_path(model, plan) if path is None else path
    check_joints(path, model)
    controller = saved.controller(model, Reference(path), period)
    actuators = Actuators(model, period)
    # a generator gives `record_motion` the same errors once more
    streams = NoiseStreams(copy.deepcopy(rng))
    sensed = SensedState(model, model.description.effective_sensors(), times[-1], saved.rate, streams)
    wheels, joints = model.wheels.v, model.arm_joints.v
    driven = {"wheel_torque": wheels, **({"joint_torque": joints} if len(joints) else {})}
    asked = {name: np.zeros((calls, len(index))) for name, index in driven.items()}
    outside: dict[str, Any] = {
        name: Sampled.from_samples(times, np.array([signal(t) for t in times]), degree=0)
        for name in ("force", "torque", "thruster")
        if (signal := getattr(plan.inputs(), name)) is not None
    }
    own_signals: dict[str, Any] = {name: AskedTorques(table, period) for name, table in asked.items()}
    applied = Inputs(**outside, **own_signals).driven(model).applied(model)
    edges = np.unique(np.round(np.array([*times, *applied.breakpoints]) / SAME_TIME)) * SAME_TIME

    q0, v0 = model.set_joint_angles(model.home, path.at(0.0)[0]), np.zeros(model.nv)
    v0[joints] = path.at(0.0)[1]
    q, v = np.empty((calls + 1, model.nq)), np.empty((calls + 1, model.nv))
    q[0], v[0] = q0, v0
    kernel = Kernel.of(model)
    for k, t in enumerate(times[:-1]):
        found = actuators(controller.command(t, sensed(t, q[k], v[k])).torques, v[k][wheels])
        for name, index in driven.items():
            asked[name][k] = found[index]
        inner = edges[(edges > t + SAME_TIME) & (edges < times[k + 1] - SAME_TIME)]
        q[k + 1], v[k + 1] = q[k], v[k]
        for a, b in pairwise([t, *inner, times[k + 1]]):
            count = math.ceil((b - a) / LONGEST_STEP - 1e-9)
            qs, vs = np.empty((count + 1, model.nq)), np.full((count + 1, model.nv), np.nan)
            qs[0], vs[0] = q[k + 1], v[k + 1]
            tau = applied(0.5 * (a + b))
            take_held_steps(model, kernel, a, (b - a) / count, qs, vs, tau)
            check_finite(np.linspace(a, b, count + 1), qs, vs, tau)
            q[k + 1], v[k + 1] = qs[-1], vs[-1]
        if progress is not None:
            progress(times[k + 1])

    commanded: dict[str, Any] = {
        name: Sampled.from_samples(times[:-1], table, degree=0) for name, table in asked.items()
    }
    trajectory = simulate(model, Inputs(**outside, **commanded), times[-1], q0=q0, v0=v0)
    note = {"controller": {"description": saved.description, "rate": saved.rate}}
    flight = record_motion(trajectory, plan, rng, role=role, provenance=note)
    tau = np.zeros((calls + 1, model.nv))
    for name, index in driven.items():
        tau[:-1, index] = asked[name]
    tau[-1] = tau[-2]
    return ControlledFlight(flight, tracking_of(model, controller, times, q, v, tau, actuators))


def _joint_path(model: SpacecraftModel, plan: Experiment) -> JointPath:
    """Return what the joints follow: the plan's motion, else the angles at its start."""
    if plan.joint_motion is not None:
        return JointPath(JointMotion.of(plan.joint_motion.signal()), plan.duration)
    angles = model.joint_angles(plan.start(model))
    still = np.zeros((len(angles), 1))
    return JointPath(JointMotion.of(Fourier(1.0, still, still, angles)), plan.duration)
