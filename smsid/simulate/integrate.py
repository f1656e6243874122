"""Adaptive integration on the configuration manifold, eighth order, with dense output.

Between re-centrings the state lives in a chart: q = q_ref (+) xi, and SciPy's DOP853 integrates (xi, v) with
``xi_dot = Jlog6(exp6(xi)) v`` for the free-flyer. Quaternions stay unit by construction.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.integrate import DOP853

from smsid.errors import SimulationError
from smsid.model.spacecraft import SpacecraftModel
from smsid.simulate.dynamics import Dynamics
from smsid.simulate.inputs import Inputs
from smsid.simulate.trajectory import Chart, Trajectory

logger = logging.getLogger(__name__)

RECENTRE_ANGLE = 1.0  # [rad] rotation of the chart beyond which it is re-centred; the log is regular up to pi


@dataclass(frozen=True)
class Tolerance:
    """Error control of the integrator: relative, and absolute in SI units."""

    relative: float = 1e-9
    absolute: float = 1e-11


def simulate(
    model: SpacecraftModel,
    inputs: Inputs,
    duration: float,
    *,
    q0: np.ndarray | None = None,
    v0: np.ndarray | None = None,
    start: float = 0.0,
    tolerance: Tolerance | None = None,
    max_step: float = np.inf,
    progress: Callable[[float], None] | None = None,
) -> Trajectory:
    """Simulate from q0 (nq,), v0 (nv,) (default: the description's home, at rest) for ``duration`` [s].

    Raises `SimulationError` when the state is no longer finite or the step size collapses.
    """
    tol = tolerance or Tolerance()
    dynamics = Dynamics(model, inputs)
    q = np.array(model.home if q0 is None else q0, dtype=float)
    v = np.zeros(model.nv) if v0 is None else np.array(v0, dtype=float)
    q, v = dynamics.enforce(start, q, v)
    stop = start + duration
    edges = [start, *(b for b in inputs.breakpoints if start < b < stop), stop]
    charts: list[Chart] = []
    step: float | None = None
    for t0, t1 in zip(edges[:-1], edges[1:], strict=True):
        while t0 < t1:
            chart = _run_chart(dynamics, q, v, t0, t1, step, tol, max_step, progress)
            charts.append(chart)
            step = chart.last_step
            t0 = chart.stop
            q, v = chart.state(t0)
        step = None
    return Trajectory(model=model, inputs=inputs, charts=tuple(charts), start=start, stop=stop)


def _run_chart(
    dynamics: Dynamics,
    q_ref: np.ndarray,
    v: np.ndarray,
    t0: float,
    t1: float,
    step: float | None,
    tol: Tolerance,
    max_step: float,
    progress: Callable[[float], None] | None,
) -> Chart:
    model = dynamics.model
    nv = model.nv
    before_end = np.nextafter(t1, t0)  # an input that jumps at t1 is taken from the left
    derivative = _derivative(dynamics, q_ref, before_end)
    y0 = np.concatenate([np.zeros(nv), v])
    first = None if step is None else min(step, t1 - t0)
    with np.errstate(over="ignore", invalid="ignore"):
        solver = DOP853(
            derivative, t0, y0, t1, rtol=tol.relative, atol=tol.absolute, first_step=first, max_step=max_step
        )
        times, pieces, last = [t0], [], step
        while solver.status == "running":
            message = solver.step()
            if solver.status == "failed" or not np.isfinite(solver.y).all():
                raise SimulationError(
                    f"The simulation failed at t = {solver.t:.6g} s: {message or 'the state is not finite'}.",
                    advice="Are the inputs bounded and the inertias right? A stiff effect may need smaller steps.",
                    time=solver.t,
                    state=solver.y,
                )
            times.append(solver.t)
            pieces.append(solver.dense_output())
            last = solver.step_size if solver.status == "running" else last
            if progress is not None:
                progress(solver.t)
            if model.free and np.abs(solver.y[3:6]).max() > RECENTRE_ANGLE:
                break
    return Chart(model.pin, q_ref, np.array(times), tuple(pieces), last)


def _derivative(dynamics: Dynamics, q_ref: np.ndarray, before_end: float):  # noqa: ANN202
    model, nv = dynamics.model, dynamics.model.nv
    pinmodel, free, prescribed = model.pin, model.free, bool(dynamics.prescribed)
    exp6, jlog6, integrate = pin.exp6, pin.Jlog6, pin.integrate

    def derivative(t: float, y: np.ndarray) -> np.ndarray:
        t = min(t, before_end)
        xi, v = y[:nv], y[nv:]
        q = integrate(pinmodel, q_ref, xi)
        if prescribed:
            q, v = dynamics.enforce(t, q, v)
        out = np.empty(2 * nv)
        out[:nv] = v
        if free:
            out[:6] = jlog6(exp6(xi[:6])) @ v[:6]
        out[nv:] = dynamics.acceleration(t, q, v)
        return out

    return derivative
