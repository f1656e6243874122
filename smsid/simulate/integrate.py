"""Adaptive integration on the configuration manifold, eighth order, with dense output.

Between re-centrings the state lives in a chart: q = q_ref (+) xi, and the method of Dormand and Prince 8(5,3)
integrates (xi, v) with ``xi_dot = Jlog6(exp6(xi)) v`` for the free-flyer. Quaternions stay unit by
construction. The method is SciPy's DOP853, its coefficients are used; it is stepped here because SciPy's own
loop takes as long as a right-hand side of ten microseconds. The polynomial of a step is made when it is first
asked for. Where stability bounds its steps, implicit ones take over (`smsid.simulate._stiff_steps`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pinocchio as pin
from scipy.integrate import DOP853, DenseOutput

from smsid.errors import SimulationError
from smsid.inputs.inputs import Inputs
from smsid.kernel.short import SHORT, STEP_ANGLE
from smsid.model.spacecraft import SpacecraftModel
from smsid.simulate._dynamics import Dynamics
from smsid.simulate._held_chart import HeldChart
from smsid.simulate._short_step import short_steps
from smsid.simulate._stiff_steps import Stiffness, StiffSteps, integration_error
from smsid.simulate.trajectory import Chart, Trajectory

RECENTRE_ANGLE = 1.0  # [rad] rotation of the chart beyond which it is re-centred; the log is regular up to pi
STAGES = 12
STAGE_ROWS = tuple(np.ascontiguousarray(DOP853.A[s, :s]) for s in range(1, STAGES))
STAGE_TIMES = tuple(float(c) for c in DOP853.C[1:STAGES])
ERRORS = np.ascontiguousarray(np.vstack([DOP853.E5, DOP853.E3])[:, :STAGES])
SAFETY, SHRINK, GROW = 0.75, 0.2, 10.0  # of the step size; 0.75 rejects less than the usual 0.9


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

    ``max_step`` bounds the step size [s]; ``progress`` is called with the time after every step. What the
    inputs prescribe overrides q0 and v0. Raises `ExperimentError` for inputs that do not fit the spacecraft,
    and `SimulationError` for a start that is no state of it, when the state is no longer finite, or when the
    step size collapses.
    """
    tol = tolerance or Tolerance()
    dynamics = Dynamics(model, inputs)
    q, v = initial_state(model, q0, v0)
    if not 0.0 < duration < np.inf:
        raise SimulationError(f"Cannot simulate for {duration} s.", advice="Give a positive duration.")
    q, v = dynamics.enforce(start, q, v)
    stop = start + duration
    edges = [start, *(b for b in dynamics.breakpoints if start < b < stop), stop]
    charts: list[Chart | HeldChart] = []
    enforce = dynamics.enforce if dynamics.prescribed else None
    step: float | None = None
    stiffness = Stiffness()
    run = dynamics.held_run(edges)
    k = 0
    while k < len(edges) - 1:
        if run is not None and step is not None:
            chart, step = run.advance(k, q, v, min(step, max_step), tol.relative, tol.absolute)
            if chart is not None:
                charts.append(chart)
                q, v, k = chart.q[-1], chart.v[-1], k + len(chart.tau)
                if progress is not None:
                    progress(edges[k])
                continue
        t0, t1 = edges[k], edges[k + 1]
        while t0 < t1:
            chart, y = run_chart(dynamics, q, v, t0, t1, step, tol, max_step, stiffness, progress, enforce)
            charts.append(chart)
            step = chart.last_step
            t0 = chart.stop
            q, v = pin.integrate(model.pin, q, y[: model.nv]), y[model.nv :]
        k += 1
    return Trajectory(model=model, inputs=inputs, charts=tuple(charts), start=start, stop=stop)


def initial_state(
    model: SpacecraftModel, q0: np.ndarray | None, v0: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return copies of q0 (nq,) and v0 (nv,), by default the description's home at rest.

    Joints that follow another are put where it puts them. Raises `SimulationError` for another shape, a
    number that is not finite, or coordinates off the configuration manifold (a quaternion whose
    norm is not one to 1e-6).
    """
    q = np.array(model.home if q0 is None else q0, dtype=float)
    v = np.zeros(model.nv) if v0 is None else np.array(v0, dtype=float)
    for name, x, size in (("q0", q, model.nq), ("v0", v, model.nv)):
        if x.shape != (size,) or not np.isfinite(x).all():
            raise SimulationError(
                f"{name} must be {size} finite numbers; it has shape {x.shape}.",
                advice="See SpacecraftModel for the order of q and v.",
                given=x,
            )
    normal = pin.normalize(model.pin, q)
    if np.abs(normal - q).max(initial=0.0) > 1e-6:
        raise SimulationError(
            "q0 is off the configuration manifold: a quaternion or (cos, sin) pair has not norm one.",
            advice="Normalise it, for instance with pinocchio.normalize.",
            given=q,
        )
    if model.followers is not None:
        return model.followers.place_followers(model.pin, normal), model.followers.driven(v)
    return normal, v


class RightHandSide(Protocol):
    """What is integrated."""

    @property
    def model(self) -> SpacecraftModel:
        """The spacecraft."""
        ...

    def acceleration(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return vdot (nv,)."""
        ...


def run_chart(
    dynamics: RightHandSide,
    q_ref: np.ndarray,
    v: np.ndarray,
    t0: float,
    t1: float,
    step: float | None,
    tol: Tolerance,
    max_step: float,
    stiffness: Stiffness,
    progress: Callable[[float], None] | None,
    enforce: Enforce | None = None,
) -> tuple[Chart, np.ndarray]:
    """Integrate from q_ref (nq,), v (nv,) until t1 [s] or until the chart has turned too far.

    Returns the stretch and (xi, v) at its end (2 nv,). Raises `SimulationError` where it cannot go on.
    """
    nv, free = dynamics.model.nv, dynamics.model.free
    before_end = float(np.nextafter(t1, t0))  # an input that jumps at t1 is taken from the left
    derivative = ChartDerivative(dynamics.model, dynamics.acceleration, q_ref, before_end, enforce)
    t, y = t0, np.concatenate([np.zeros(nv), v])
    with np.errstate(over="ignore", invalid="ignore"):
        rate = derivative(t, y, np.empty(2 * nv))
        step = _first_step(derivative, t, y, rate, tol) if step is None else step
        times, pieces = [t0], []
        stiffness.anew()
        implicit: StiffSteps | None = None
        while t < t1:
            # the error estimate does not see a chart turned beyond pi when the motion is a plain spin
            turning = float(np.sqrt(y[nv + 3 : nv + 6] @ y[nv + 3 : nv + 6])) if free else 0.0
            longest = min(max_step, STEP_ANGLE / turning) if turning > 0.0 else max_step
            if implicit is None:
                step, found = min(step, longest), None
                if t1 - t < SHORT * step:
                    found = short_steps(derivative, t, y, rate, t1, tol.relative, tol.absolute)
                if found is None:
                    piece, step = _step(derivative, t, y, rate, t1, step, tol)
                    found = [piece]
                    if stiffness.seen(piece.stretch):
                        implicit = StiffSteps(
                            derivative, piece.t, piece.y, t1, step, tol.relative, tol.absolute
                        )
            else:
                found = [implicit.step(longest)]
            t, y, rate = found[-1].t, found[-1].y, found[-1].end_rate
            times.extend(piece.t for piece in found)
            pieces.extend(found)
            if progress is not None:
                progress(t)
            if free and np.abs(y[3:6]).max() > RECENTRE_ANGLE:
                break
    return Chart(dynamics.model.pin, q_ref, np.array(times), tuple(pieces), step), y


class _Piece(DenseOutput):
    """One accepted step and, once asked for, its seventh-order polynomial."""

    def __init__(
        self, derivative: ChartDerivative, t_old: float, t: float, y_old: np.ndarray, y: np.ndarray
    ) -> None:
        super().__init__(t_old, t)
        self.h, self.y_old, self.y = t - t_old, y_old, y
        self.derivative = derivative
        self.stages = np.empty((STAGES + 4, len(y)))  # rates at the stages, the end and three points more
        self.stretch = 0.0  # estimate of the step times the largest eigenvalue
        self._polynomial: np.ndarray | None = None

    @property
    def end_rate(self) -> np.ndarray:
        """Rate of the state at the end (n,)."""
        return self.stages[STAGES]

    def _call_impl(self, t: np.ndarray) -> np.ndarray:
        if self._polynomial is None:
            self._polynomial = self._fit()
        x = np.asarray((t - self.t_old) / self.h)
        y = np.zeros((*x.shape, len(self.y_old)))
        for i, f in enumerate(self._polynomial[::-1]):
            y += f
            y *= (x if i % 2 == 0 else 1.0 - x)[..., None]
        y += self.y_old
        return y.T

    def _fit(self) -> np.ndarray:
        k, h = self.stages, self.h
        for s, (a, c) in enumerate(zip(DOP853.A_EXTRA, DOP853.C_EXTRA, strict=True), start=STAGES + 1):
            self.derivative(self.t_old + c * h, self.y_old + h * (a[:s] @ k[:s]), k[s])
        change = self.y - self.y_old
        first = [change, h * k[0] - change, 2.0 * change - h * (k[STAGES] + k[0])]
        return np.vstack([*first, h * (DOP853.D @ k)])


def _step(
    derivative: ChartDerivative,
    t: float,
    y: np.ndarray,
    rate: np.ndarray,
    t_end: float,
    h: float,
    tol: Tolerance,
) -> tuple[_Piece, float]:
    """Take a step of at most ``h`` [s] that holds the tolerance; return it and the step size to try next."""
    size, rejected, error = np.abs(y), False, 0.0
    smallest = 10.0 * (np.nextafter(t, np.inf) - t)
    piece = _Piece(derivative, t, t, y, y)
    k = piece.stages
    k[0] = rate
    known = [k[:s] for s in range(STAGES + 1)]
    while True:
        if not h >= smallest:
            raise integration_error(
                t, y, "the step size collapsed" if np.isfinite(error) else "the state is not finite"
            )
        new = t_end if t + h >= t_end else t + h
        taken = new - t
        for s, (a, c) in enumerate(zip(STAGE_ROWS, STAGE_TIMES, strict=True), start=1):
            at = np.dot(a, known[s])
            at *= taken
            at += y
            derivative(t + c * taken, at, k[s])
        y_new = np.dot(DOP853.B, known[STAGES])
        y_new *= taken
        y_new += y
        error = _error(known[STAGES], np.maximum(size, np.abs(y_new)), taken, tol)
        if error < 1.0:
            factor = min(1.0 if rejected else GROW, SAFETY * max(error, 1e-12) ** -0.125)
            piece.t, piece.t_max, piece.h, piece.y = new, new, taken, y_new
            derivative(new, y_new, k[STAGES])
            if not np.isfinite(k[STAGES]).all():
                raise integration_error(new, y_new, "the state is not finite")
            apart = float(np.linalg.norm(y_new - at))
            if apart > 0.0:
                piece.stretch = taken * float(np.linalg.norm(k[STAGES] - k[STAGES - 1])) / apart
            # a step that the end cut short says nothing against the size that was planned
            return piece, max(h, taken * factor) if taken < h else taken * factor
        h = taken * (max(SHRINK, SAFETY * error**-0.125) if np.isfinite(error) else SHRINK)
        rejected = True


def _error(k: np.ndarray, size: np.ndarray, h: float, tol: Tolerance) -> float:
    """Return the error of a step in units of the tolerance: Hairer's mean of two estimates, 5th and 3rd."""
    estimates = np.dot(ERRORS, k)
    size *= tol.relative
    size += tol.absolute
    estimates /= size
    fifth, third = float(estimates[0] @ estimates[0]), float(estimates[1] @ estimates[1])
    if fifth == 0.0 and third == 0.0:
        return 0.0
    return h * fifth / float(np.sqrt((fifth + 0.01 * third) * len(size)))


def _first_step(
    derivative: ChartDerivative, t: float, y: np.ndarray, rate: np.ndarray, tol: Tolerance
) -> float:
    """Return a first step size [s] from the state, its rate and an explicit Euler step (Hairer, II.4)."""
    scale = np.sqrt(len(y)) * (tol.absolute + np.abs(y) * tol.relative)
    state, slope = float(np.linalg.norm(y / scale)), float(np.linalg.norm(rate / scale))
    h = 1e-6 if min(state, slope) < 1e-5 else 0.01 * state / slope
    ahead = derivative(t + h, y + h * rate, np.empty_like(y))
    curve = float(np.linalg.norm((ahead - rate) / scale)) / h
    steepest = max(slope, curve)
    return float(min(100.0 * h, (0.01 / steepest) ** 0.125 if steepest > 1e-15 else max(1e-6, 1e-3 * h)))


Enforce = Callable[[float, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


class ChartDerivative:
    """Right-hand side in the chart q = q_ref (+) xi: the rate of y = (xi, v) for vdot = acceleration(t, q,
    v).

    Called with t, y (2 nv,) and ``out`` (2 nv,) to write into. Times beyond ``latest`` are taken as
    ``latest``; ``enforce`` first puts q and v on what is prescribed.
    """

    def __init__(
        self,
        model: SpacecraftModel,
        acceleration: Callable[[float, np.ndarray, np.ndarray], np.ndarray],
        q_ref: np.ndarray,
        latest: float = np.inf,
        enforce: Enforce | None = None,
    ) -> None:
        self.pin, self.nv, self.free = model.pin, model.nv, model.free
        self.acceleration, self.q_ref, self.latest, self.enforce = acceleration, q_ref, latest, enforce

    def __call__(self, t: float, y: np.ndarray, out: np.ndarray) -> np.ndarray:
        """Write the rate of y at t into ``out`` and return it."""
        nv = self.nv
        if t > self.latest:
            t = self.latest
        xi, v = y[:nv], y[nv:]
        q = pin.integrate(self.pin, self.q_ref, xi)
        if self.enforce is not None:
            q, v = self.enforce(t, q, v)
        out[:nv] = v
        if self.free:
            np.dot(pin.Jlog6(pin.exp6(xi[:6])), v[:6], out=out[:6])
        out[nv:] = self.acceleration(t, q, v)
        return out
