"""Flights under the model-based controller in compiled code, without Python from sample to sample."""

from __future__ import annotations

from dataclasses import dataclass
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np

from smsid.control._attitude import SMALLEST_COSINE
from smsid.control._sensed import SensedState
from smsid.control._statespace import StateSpace
from smsid.control.pd import MeasuredState, ModelBasedController
from smsid.kernel.arrays import Kernel, tree_of
from smsid.kernel.columns import TIME
from smsid.kernel.flight import COMMAND, FLOWN, Craft, Law, Path, Senses, fly
from smsid.model.spacecraft import SpacecraftModel
from smsid.simulate.fixed_step import ClosedLoop, check_finite, whole_steps
from smsid.simulate.held_step import take_held_steps
from smsid.simulate.integrate import initial_state

if TYPE_CHECKING:
    from smsid.control.closed_loop import Actuators

PLAIN = Lock()  # models and controllers have scratch space, which threads must not share


@dataclass(frozen=True)
class CompiledFlight:
    """What a flight needs: the spacecraft, the controller and what its sensors do, as arrays."""

    model: SpacecraftModel
    kernel: Kernel
    controller: ModelBasedController
    actuators: Actuators
    law: Law
    craft: Craft
    senses: Senses
    time: np.ndarray
    hold: int
    dt: float

    @classmethod
    def of(
        cls,
        model: SpacecraftModel,
        controller: ModelBasedController,
        actuators: Actuators,
        sensed: SensedState | None,
        duration: float,
        rate: float,
        dt: float,
    ) -> CompiledFlight | None:
        """Return the flight in steps of ``dt`` [s], ``None`` where the plain way has to be taken.

        That is for forces that the kernel does not know, Euler angles, rounded attitudes and unmeasured
        wheels. Raises `ExperimentError` when periods are not whole numbers of steps.
        """
        kernel, d = Kernel.of(model), controller.dynamics
        inside = tree_of(d.pin, True)
        if kernel is None or inside is None or controller.coordinates != "quaternion":
            return None
        hold = whole_steps(1.0 / rate, dt, "The control period")
        count, rest = divmod(whole_steps(duration, dt, "The duration"), hold)
        if rest:  # the last period is cut short
            return None
        time = dt * np.arange(0, count * hold + 1, hold)
        n, w = len(model.arm_joints), len(model.wheels)
        senses = _perfect(count, 12 + 2 * n + w) if sensed is None else sensed.table(time[:-1])
        if senses is None:
            return None
        f = controller.filter or StateSpace.zero_system(d.size, 2 * d.size)
        k, wanted = controller.gains, controller.reference.sampled(time[:-1])
        parts = k.proportional, k.derivative, f.a, f.b, f.c, f.d
        kp, kd, a, b, c, through = map(np.ascontiguousarray, parts)
        rows = d.arm.v - 6, d.wheels.v - 6
        law = Law(*inside.arrays, *rows, kp, kd, a, b, c, through, wanted, SMALLEST_COSINE)
        layout = actuators.layout
        craft = Craft(
            model.arm_joints.v - 6,
            model.wheels.v - 6,
            np.ascontiguousarray(layout.inverse),
            layout.max_torque,
            layout.max_rate,
            actuators.effort,
            layout.inertia,
        )
        return cls(model, kernel, controller, actuators, law, craft, senses, time, hold, dt)

    def run(self, q0: np.ndarray, delay: int) -> ClosedLoop:
        """Fly from rest at q0 (nq,), commands ``delay`` samples late; the states are those at the samples.

        Raises `ControlError` where the attitude error nears half a turn, `SimulationError` when the loop
        blows up.
        """
        model, wheels, n = self.model, len(self.model.wheels), len(self.model.arm_joints)
        hold, count = self.hold, len(self.time) - 1
        path = Path(
            np.empty((count * hold + 1, model.nq)),
            np.full((count * hold + 1, model.nv), np.nan),
            np.empty(self.senses.errors.shape),
            np.empty(self.senses.errors.shape),
            np.zeros((count, model.nv)),
            np.zeros(len(self.law.a)),
            np.zeros(2 * wheels + n, dtype=np.int64),
        )
        path.q[0], path.v[0] = initial_state(model, q0, None)
        fixed = *self.kernel.arrays, self.law, self.craft, self.senses, self.dt, hold, delay
        at, given = 0, False
        while True:
            self.kernel.root[TIME] = self.time[at]
            at, why = fly(*fixed, path, at, given)
            if why == FLOWN:
                break
            given = why == COMMAND
            with PLAIN:
                if given:
                    self._command(path, at)
                else:
                    self._step(path, at, delay)
                    at += 1
        self.actuators.add_hits(path.hits)
        acted = np.vstack([np.zeros((delay, model.nv)), path.asked])[:count]
        return ClosedLoop(self.time, path.q[::hold], path.v[::hold], np.vstack([acted, acted[-1:]]), None)

    def _command(self, path: Path, at: int) -> None:
        n, seen = len(self.model.arm_joints), path.seen[at]
        ends = np.cumsum([9, 3, n, n])
        turn, omega, angles, rates, wheels = np.split(seen, ends)
        self.controller.state = path.state.copy()
        measured = MeasuredState(turn.reshape(3, 3), omega, angles, rates, wheels)
        torques = self.controller.command(self.time[at], measured).torques
        path.asked[at] = self.actuators(torques, path.v[at * self.hold, self.model.wheels.v])
        path.state[:] = self.controller.state

    def _step(self, path: Path, at: int, delay: int) -> None:
        hold, dt = self.hold, self.dt
        tau = path.asked[at - delay] if at >= delay else np.zeros(self.model.nv)
        rows = slice(at * hold, (at + 1) * hold + 1)
        with np.errstate(over="ignore", invalid="ignore"):
            take_held_steps(self.model, self.kernel, self.time[at], dt, path.q[rows], path.v[rows], tau)
        check_finite(self.time[at] + dt * np.arange(hold + 1), path.q[rows], path.v[rows], tau)


def _perfect(count: int, width: int) -> Senses:
    errors = np.zeros((count, width))
    errors[:, :9] = np.eye(3).ravel()
    source = np.repeat(np.arange(count)[:, None], 5, axis=1)
    return Senses(errors, source, np.eye(width), np.full(width, np.inf), np.zeros(width))
