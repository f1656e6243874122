"""One step under held generalised forces: fourth-order Runge-Kutta, or as many as its error asks for.

Every step runs in its own chart q = q_n (+) xi (Munthe-Kaas), so the stages are combined in the tangent
space and quaternions stay unit.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pinocchio as pin

from smsid.kernel.arrays import Kernel
from smsid.kernel.columns import TIME
from smsid.kernel.steps import DOUBT, LOST, SMALL, WITHIN, held_steps
from smsid.model.spacecraft import SpacecraftModel
from smsid.simulate._stiff_steps import Stiffness
from smsid.simulate.integrate import Tolerance, run_chart
from smsid.simulate.trajectory import external_rates

TOLERANCE = Tolerance(relative=1e-7, absolute=1e-9)


def take_held_steps(
    model: SpacecraftModel,
    kernel: Kernel | None,
    t: float,
    h: float,
    q: np.ndarray,
    v: np.ndarray,
    tau: np.ndarray,
    gained: np.ndarray | None = None,
) -> None:
    """Fill q (N + 1, nq), v (N + 1, nv) from their first rows, N steps of ``h`` [s] under held tau (nv,).

    ``gained`` (N + 1, 7) is filled from its first row with what momentum and energy should have gained. The
    kernel takes the steps it can, `held_step` all others. It ends before a state that is not finite, which is
    in the row it came to; those after are what they were.

    Raises `SimulationError` when no step holds the tolerance.
    """
    i, count = 0, len(q) - 1
    kept = np.empty((0, 7)) if gained is None else gained
    while i < count:
        if kernel is not None:
            kernel.root[TIME] = t + i * h
            i += held_steps(*kernel.arrays, q[i:], v[i:], tau, h, count - i, kept[i:])
            if i == count:
                return
        audit = gained is not None
        q[i + 1], v[i + 1], gain = held_step(model, t + i * h, h, q[i], v[i], tau, audit)
        if gained is not None:
            gained[i + 1] = gained[i] + gain
        i += 1
        if not np.isfinite(v[i]).all():
            return


def held_step(
    model: SpacecraftModel,
    t: float,
    h: float,
    q: np.ndarray,
    v: np.ndarray,
    tau: np.ndarray,
    audit: bool = False,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return q (nq,), v (nv,) a step of ``h`` [s] later under held generalised forces tau (nv,), and a gain.

    The gain (7,) is by how much momentum and energy should have changed, zeros without ``audit``. Where
    friction on light links, a stiff gear or a fast mode is too much for one step, as its stages say, the
    adaptive method takes over, implicit where that is shorter (`smsid.simulate`).

    Raises `SimulationError` when no step holds the tolerance.
    """
    m, free, integrate, half = model.pin, model.free, pin.integrate, 0.5 * h

    def rate(xi: np.ndarray, speed: np.ndarray) -> np.ndarray:
        if not free:
            return speed
        out = speed.copy()
        np.dot(pin.Jlog6(pin.exp6(xi[:6])), speed[:6], out=out[:6])
        return out

    begin, end = t + WITHIN * h, t + (1.0 - WITHIN) * h
    a1 = model.acceleration(begin, q, v, tau)
    v2, xi2 = v + half * a1, half * v
    q2 = integrate(m, q, xi2)
    x2, a2 = rate(xi2, v2), model.acceleration(t + half, q2, v2, tau)
    v3, xi3 = v + half * a2, half * x2
    q3 = integrate(m, q, xi3)
    x3, a3 = rate(xi3, v3), model.acceleration(t + half, q3, v3, tau)
    v4, xi4 = v + h * a3, h * x3
    q4 = integrate(m, q, xi4)
    x4, a4 = rate(xi4, v4), model.acceleration(end, q4, v4, tau)
    gained = h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
    # against the midpoint rule with the inner stages, and what these differ by: one may vanish by chance
    errors = h / 6.0 * (a1 - a2 - a3 + a4), h / 3.0 * (a2 - a3)
    worst = max(float(e @ e) for e in errors)
    doubtful = worst > max(DOUBT**2 * float(gained @ gained), SMALL**2)
    # what spins as fast as that is not stiff but lost
    if doubtful and not (free and h * float(np.linalg.norm(v[3:6])) > LOST):
        return _adaptive(model, t, h, q, v, tau, audit)
    reached = integrate(m, q, h / 6.0 * (v + 2.0 * (x2 + x3) + x4)), v + gained
    if not audit:
        return *reached, np.zeros(7)
    stages = ((begin, q, v), (t + half, q2, v2), (t + half, q3, v3), (end, q4, v4))
    r1, r2, r3, r4 = (external_rates(model, *stage, tau) for stage in stages)
    return *reached, h / 6.0 * (r1 + 2.0 * (r2 + r3) + r4)


def _adaptive(
    model: SpacecraftModel, t: float, h: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray, audit: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    nv, gain, end = model.nv, np.zeros(7), t + h
    held, step, stiffness = _HeldDynamics(model, tau), None, Stiffness()
    while t < end:
        chart, y = run_chart(held, q, v, t, end, step, TOLERANCE, np.inf, stiffness, None)
        step, t = chart.last_step, chart.stop

        def rates(at: float, y: np.ndarray, start: np.ndarray = q) -> np.ndarray:
            return external_rates(model, at, pin.integrate(model.pin, start, y[:nv]), y[nv:], tau)

        for piece, (t0, t1) in zip(chart.pieces if audit else (), pairwise(chart.times), strict=audit):
            middle = 0.5 * (t0 + t1)  # Simpson's rule
            first, last = (rates(at, piece(at)) for at in (t0, t1))
            gain += (t1 - t0) / 6.0 * (first + 4.0 * rates(middle, piece(middle)) + last)
        q, v = pin.integrate(model.pin, q, y[:nv]), y[nv:]
    return q, v, gain


@dataclass(frozen=True)
class _HeldDynamics:
    """Forward dynamics under held generalised forces tau (nv,)."""

    model: SpacecraftModel
    tau: np.ndarray

    def acceleration(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return self.model.acceleration(t, q, v, self.tau)
