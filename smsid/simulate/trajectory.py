"""The result of a simulation: states at any time, and how well momentum and energy were kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.integrate._ivp.base import DenseOutput

from smsid._short_repr import short_repr
from smsid._time_text import stamp_text
from smsid.errors import SimulationError
from smsid.inputs.inputs import Inputs
from smsid.inputs.signals import sample
from smsid.kernel.arrays import Kernel
from smsid.kernel.steps import conserved
from smsid.model.spacecraft import SpacecraftModel
from smsid.simulate._dynamics import Dynamics
from smsid.simulate._held_chart import HeldChart


@dataclass(frozen=True)
class Chart:
    """A stretch of the solution in one chart q = q_ref (+) xi: step times and a polynomial per step."""

    pin: pin.Model
    q_ref: np.ndarray
    times: np.ndarray
    pieces: Sequence[DenseOutput]
    last_step: float | None

    @property
    def steps(self) -> int:
        """Number of integration steps."""
        return len(self.pieces)

    @property
    def stop(self) -> float:
        """End of the stretch [s]."""
        return float(self.times[-1])

    def raw(self, times: np.ndarray) -> np.ndarray:
        """Return (xi, v) at times (N,) within the stretch: (N, 2 nv)."""
        index = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.pieces) - 1)
        out = np.empty((len(times), 2 * self.pin.nv))
        edges = np.flatnonzero(np.diff(index)) + 1
        for block in np.split(np.arange(len(times)), edges):
            if len(block):
                out[block] = self.pieces[int(index[block[0]])](times[block]).T
        return out

    def state(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Return q (nq,) and v (nv,) at one time."""
        q, v, _ = self.states(np.array([t]), np.empty((1, self.pin.nv)))
        return q[0], v[0]

    def states(self, times: np.ndarray, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray, None]:
        """Return q (N, nq) and v (N, nv) at times (N,) [s] within; accelerations are left to the dynamics."""
        raw = self.raw(times)
        q = np.empty((len(times), self.pin.nq))
        integrate, model, reference = pin.integrate, self.pin, self.q_ref
        for i, xi in enumerate(raw[:, : model.nv]):
            q[i] = integrate(model, reference, xi)
        return q, raw[:, model.nv :], None


@short_repr
@dataclass(frozen=True)
class States:
    """States at sample times: q (N, nq), v (N, nv), a = vdot (N, nv), applied tau and reaction (N, nv).

    ``tau`` is what the plant gets of the commands, as generalised forces; ``reaction`` what enforces
    prescribed motion.
    """

    time: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    tau: np.ndarray
    reaction: np.ndarray


@dataclass(frozen=True)
class Audit:
    """How well conserved quantities were kept over a simulation.

    ``momentum_drift``: largest change of (p, h) about the inertial origin not explained by external force
    and torque [N s, N m s], not a number on a welded base; ``momentum_scale``: sqrt(2 T M) at the largest
    kinetic energy T, which bounds the momenta of all moving parts added up without sign [N s];
    ``energy_drift``: largest change of energy not explained by the work of inputs, dampers and nonlinear
    effects [J]; ``energy_scale``: largest kinetic energy [J].
    """

    momentum_drift: float
    momentum_scale: float
    energy_drift: float
    energy_scale: float


@short_repr
@dataclass(frozen=True)
class Trajectory:
    """A simulated motion with dense output."""

    model: SpacecraftModel
    inputs: Inputs
    charts: tuple[Chart | HeldChart, ...]
    start: float
    stop: float

    @property
    def steps(self) -> int:
        """Number of accepted integration steps."""
        return sum(c.steps for c in self.charts)

    def states(self, times: np.ndarray) -> States:
        """Return the states at times (N,) [s]; at a jump of an input, accelerations are the right limit.

        Raises `SimulationError` outside the simulated time.
        """
        times = np.asarray(times, dtype=float)
        slack = 1e-9 * max(1.0, abs(self.stop))
        if len(times) and (times.min() < self.start - slack or times.max() > self.stop + slack):
            raise SimulationError(
                f"Asked for {stamp_text(times.min())} to {stamp_text(times.max())} s, "
                f"simulated {stamp_text(self.start)} to {stamp_text(self.stop)} s.",
                advice="Simulate longer, or sample within.",
            )
        times = np.clip(times, self.start, self.stop)
        model, dynamics = self.model, Dynamics(self.model, self.inputs)
        q, v = np.empty((len(times), model.nq)), np.empty((len(times), model.nv))
        starts = np.array([c.times[0] for c in self.charts])
        index = np.clip(np.searchsorted(starts, times, side="right") - 1, 0, None)
        tau = sample(dynamics.applied, times)
        a, reaction = np.empty_like(v), np.zeros_like(v)
        missing = np.ones(len(times), dtype=bool)
        for k in np.unique(index):
            chosen = np.flatnonzero(index == k)
            q[chosen], v[chosen], known = self.charts[k].states(times[chosen], tau[chosen])
            if known is not None:
                a[chosen], missing[chosen] = known, False
        dynamics.enforce_all(times, q, v)
        a[missing], reaction[missing] = dynamics.accelerations(
            times[missing], q[missing], v[missing], tau[missing]
        )
        return States(times, q, v, a, tau, reaction)

    def audit(self) -> Audit:
        """Return drift of momentum and energy, by Gauss quadrature of wrench and power over every step."""
        model = self.model
        nodes, weights = np.polynomial.legendre.leggauss(6)
        edges = np.concatenate([c.times[:-1] for c in self.charts] + [np.array([self.stop])])
        half = np.diff(edges) / 2
        inner = (edges[:-1] + half)[:, None] + half[:, None] * nodes
        mid = self.states(inner.ravel())
        rates = np.array(
            [
                external_rates(model, float(t), q, v, tau, reaction, a)
                for t, q, v, tau, reaction, a in zip(
                    mid.time, mid.q, mid.v, mid.tau, mid.reaction, mid.a, strict=True
                )
            ]
        )
        gained = np.einsum("snk,n,s->sk", rates.reshape(len(half), len(nodes), 7), weights, half)
        gained = np.vstack([np.zeros(7), np.cumsum(gained, axis=0)])
        ends = self.states(edges)
        return closing_audit(model, ends.q, ends.v, gained)


def closing_audit(
    model: SpacecraftModel, q: np.ndarray, v: np.ndarray, gained: np.ndarray, kernel: Kernel | None = None
) -> Audit:
    """Return what momentum and energy lack at states q (N, nq), v (N, nv).

    ``gained`` (N, 7) is what they should have gained since the first, the integral of `external_rates`.
    """
    kept = np.empty((len(q), 8))
    if kernel is not None:
        conserved(*kernel.arrays, q, v, kept)
    else:
        for row, a, b in zip(kept, q, v, strict=True):
            row[:6], row[6] = model.momentum(a, b), model.energy(a, b)
            row[7] = pin.computeKineticEnergy(model.pin, model.data, a, b)
    error = kept[:, :7] - kept[0, :7] - gained
    kinetic = kept[:, 7].max()
    return Audit(
        momentum_drift=float(np.abs(error[:, :6]).max()) if model.free else float("nan"),
        momentum_scale=float(np.sqrt(2 * kinetic * model.mass)),
        energy_drift=float(np.abs(error[:, 6]).max()),
        energy_scale=float(kinetic),
    )


def external_rates(
    model: SpacecraftModel,
    t: float,
    q: np.ndarray,
    v: np.ndarray,
    tau: np.ndarray,
    reaction: np.ndarray | None = None,
    a: np.ndarray | None = None,
) -> np.ndarray:
    """Return the rates of (p, h) about the inertial origin and of the energy (7,) [N, N m, W].

    ``tau`` (nv,) are the applied generalised forces, ``reaction`` those that enforce prescribed motion (then
    accelerations ``a`` are needed); springs count as stored energy, dampers and nonlinear effects as power.
    """
    passive = tau.copy()
    model.add_passive_forces(t, q, v, passive, inertial=a is None)
    passive -= tau
    if model.inertial is not None and a is not None:
        passive += model.inertial.force(t, q, v, a)
    if reaction is not None:
        tau = tau + reaction
    passive[model.spring_v] += model.stiffness * q[model.spring_q]
    power = v @ (tau + passive)
    wrench = np.zeros(6)
    if model.free:
        rotation = pin.Quaternion(q[3:7]).toRotationMatrix()
        external = tau + passive
        weight = model.mass * model.pin.gravity.linear
        force = rotation @ external[0:3] + weight
        com = pin.centerOfMass(model.pin, model.data, q)
        moment = rotation @ external[3:6] + np.cross(q[0:3], rotation @ external[0:3]) + np.cross(com, weight)
        wrench = np.concatenate([force, moment])
    return np.concatenate([wrench, [power]])
