"""Fixed-step integration for closed loops: the controller is called at its own rate and held in between."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from smsid._short_repr import short_repr
from smsid._time_text import time_text
from smsid.errors import ExperimentError, SimulationError
from smsid.kernel.arrays import Kernel
from smsid.model.spacecraft import SpacecraftModel
from smsid.simulate.held_step import take_held_steps
from smsid.simulate.integrate import initial_state
from smsid.simulate.trajectory import Audit, closing_audit

Controller = Callable[[float, np.ndarray, np.ndarray], np.ndarray]
"""Called with (t, q (nq,), v (nv,)); returns the applied generalised forces tau (nv,)."""


@short_repr
@dataclass(frozen=True)
class ClosedLoop:
    """A motion under feedback at times (N + 1,) [s]: q (N + 1, nq), v (N + 1, nv), tau (N + 1, nv).

    ``tau[i]`` acts from ``time[i]`` to ``time[i + 1]``; the last row repeats the one before. ``audit`` tells
    how well momentum and energy were kept; None when it was not asked for.
    """

    time: np.ndarray
    q: np.ndarray
    v: np.ndarray
    tau: np.ndarray
    audit: Audit | None


def simulate_closed_loop(
    model: SpacecraftModel,
    controller: Controller,
    duration: float,
    *,
    dt: float,
    control_rate: float,
    q0: np.ndarray | None = None,
    v0: np.ndarray | None = None,
    delay: int = 0,
    audit: bool = True,
) -> ClosedLoop:
    """Simulate from q0 (nq,), v0 (nv,) (default: home, at rest) with steps of ``dt`` [s] under a controller.

    The controller is called at t = k / control_rate; what it returns acts, held, from ``delay`` samples
    later until the next; before the first, nothing acts. The control period and the duration must be whole
    numbers of steps, since a step across a jump of tau would lose the order of the method. ``audit`` costs
    half of the time.

    Raises `ExperimentError` when they are not or the controller returns another shape, `SimulationError`
    when the start is no state of the spacecraft or the state is no longer finite.
    """
    hold = whole_steps(1.0 / control_rate, dt, "The control period")
    steps = whole_steps(duration, dt, "The duration")
    if delay < 0:
        raise ExperimentError(f"A delay of {delay} samples is in the future.", advice="Give 0 or more.")
    nv = model.nv
    time = dt * np.arange(steps + 1)
    q, v = np.empty((steps + 1, model.nq)), np.full((steps + 1, nv), np.nan)
    tau, gained = np.zeros((steps + 1, nv)), np.zeros((steps + 1, 7))
    q[0], v[0] = initial_state(model, q0, v0)
    pending, kernel = [np.zeros(nv)] * delay, Kernel.of(model)
    with np.errstate(over="ignore", invalid="ignore"):
        for i in range(0, steps, hold):
            end = min(i + hold, steps)
            pending.append(_ask_controller(controller, time[i], q[i], v[i]))
            tau[i:end] = now = pending.pop(0)
            rows = slice(i, end + 1)
            take_held_steps(
                model, kernel, time[i], dt, q[rows], v[rows], now, gained[rows] if audit else None
            )
            check_finite(time[rows], q[rows], v[rows], now)
    tau[-1] = tau[-2]
    return ClosedLoop(time, q, v, tau, closing_audit(model, q, v, gained, kernel) if audit else None)


def check_finite(time: np.ndarray, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
    """Raise `SimulationError` where v (N, nv) is not finite, with the time (N,) [s], under held tau (nv,)."""
    finite = np.isfinite(v).all(axis=1)
    if not finite.all():
        lost = int(np.argmin(finite))
        raise SimulationError(
            f"The closed loop blew up at t = {time_text(time[lost])}.",
            advice="Is the controller stable at this rate and delay? Then try a smaller `dt`.",
            time=time[lost],
            q=q[lost - 1],
            v=v[lost - 1],
            tau=tau,
        )


def _ask_controller(controller: Controller, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    tau = np.array(controller(t, q.copy(), v.copy()), dtype=float)
    if tau.shape != v.shape:
        raise ExperimentError(
            f"The controller returned shape {tau.shape} at t = {time_text(t)}, the spacecraft takes "
            f"{v.shape}.",
            advice="Return generalised forces, one per degree of freedom.",
        )
    return tau


def whole_steps(length: float, dt: float, what: str) -> int:
    """Return how many steps of ``dt`` [s] a length [s] is; raises `ExperimentError` if no whole number."""
    count = round(length / dt) if dt > 0.0 and 0.0 < length < np.inf else 0
    if count < 1 or abs(count * dt - length) > 1e-9 * length:
        raise ExperimentError(
            f"{what}, {length:.9g} s, is not a whole number of steps of {dt:.9g} s.",
            advice=f"Take for instance dt = {length / max(count, 1):.9g} s.",
        )
    return count
