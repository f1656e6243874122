"""The state derivative: forward dynamics, or hybrid dynamics where some motion is prescribed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from scipy.linalg import lapack

from smsid.inputs.inputs import Inputs, PrescribedMotion
from smsid.inputs.signals import is_held, sample
from smsid.kernel.arrays import Kernel
from smsid.model.spacecraft import SpacecraftModel, set_group_angles
from smsid.simulate._held_chart import HeldRun

BLOCK = 2048  # of mass matrices at a time


class Dynamics:
    """Right-hand side of (10)-(15) under given inputs.

    ``inputs`` are commands; ``applied`` is what the plant gets of them as a generalised force (nv,).
    """

    def __init__(self, model: SpacecraftModel, inputs: Inputs) -> None:
        inputs.check(model)
        self.model = model
        self.inputs = inputs
        driven = inputs.driven(model)
        self.applied = driven.applied(model)
        self.breakpoints = tuple(sorted({*driven.breakpoints, *model.breakpoints}))
        self.prescribed = PrescribedMotion.of(model, inputs)
        self._hybrid_needed = bool(self.prescribed)
        free, given = self.prescribed.free, self.prescribed.index
        self._free, self._given_free = np.ix_(free, free), np.ix_(given, free)
        self._above = np.triu(np.ones((model.nv, model.nv)), 1)

    def acceleration(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return vdot (nv,). q and v must already satisfy what is prescribed."""
        m = self.model
        tau = np.array(self.applied(t))
        if not self._hybrid_needed:
            m.add_passive_forces(t, q, v, tau)
            return pin.aba(m.pin, m.data, q, v, tau)
        m.add_passive_forces(t, q, v, tau, inertial=False)
        return self._hybrid(t, q, v, tau)[0]

    def accelerations(
        self, times: np.ndarray, q: np.ndarray, v: np.ndarray, applied: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return vdot (N, nv) and the generalised forces (N, nv) that enforce what is prescribed.

        For times (N,), q (N, nq), v (N, nv) and applied generalised forces (N, nv), all at once.
        """
        m = self.model
        tau = np.array(applied, dtype=float)
        for term in m.loads:
            for i in range(len(times)):
                term(float(times[i]), q[i], v[i], tau[i])
        tau[:, m.spring_v] -= m.stiffness * q[:, m.spring_q] + m.damping * v[:, m.spring_v]
        for term in m.forces:
            if term is m.inertial and self._hybrid_needed:
                continue
            for i in range(len(times)):
                term(float(times[i]), q[i], v[i], tau[i])
        a, reaction = np.empty_like(tau), np.zeros_like(tau)
        if self._hybrid_needed and m.inertial is not None:
            for i in range(len(times)):
                a[i], reaction[i] = self._hybrid(float(times[i]), q[i], v[i], tau[i])
        elif self._hybrid_needed:
            for first in range(0, len(times), BLOCK):
                own = slice(first, first + BLOCK)
                a[own], reaction[own] = self._hybrids(times[own], q[own], v[own], tau[own])
        else:
            aba, model, data = pin.aba, m.pin, m.data
            for i in range(len(times)):
                a[i] = aba(model, data, q[i], v[i], tau[i])
        return a, reaction

    def held_run(self, edges: Sequence[float]) -> HeldRun | None:
        """Return the compiled run from edge to edge [s], ``None`` where the plain way has to be taken."""
        if self._hybrid_needed or len(edges) < 3 or not is_held(self.applied):
            return None
        kernel = Kernel.of(self.model)
        if kernel is None:
            return None
        starts = np.asarray(edges)
        return HeldRun(kernel, starts, sample(self.applied, starts[:-1]), self.model.nq)

    def _hybrid(
        self, t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        m, free, given = self.model, self.prescribed.free, self.prescribed.index
        mass = pin.crba(m.pin, m.data, q)
        above = mass * self._above  # Pinocchio fills no more than the upper triangle
        mass = above + above.T + np.diag(mass.diagonal())
        bias = pin.nonLinearEffects(m.pin, m.data, q, v)
        if m.inertial is not None:
            more, extra = m.inertial.mass_and_bias(t, q, v)
            mass, bias = mass + more, bias + extra
        a = self.prescribed.acceleration(t, m.nv)
        rhs = tau - bias - mass[:, given] @ a[given]
        moved = mass[self._free]
        _, x, info = lapack.dposv(moved, rhs[free])
        if info != 0:
            x = np.linalg.solve(moved, rhs[free])
        if m.followers is not None:
            rows = m.followers.rows[~np.isin(m.followers.v, given)][:, free]
            held = np.linalg.solve(moved, rows.T)
            x -= held @ np.linalg.solve(rows @ held, rows @ x)
        a[free] = x
        reaction = np.zeros(m.nv)
        reaction[given] = mass[self._given_free] @ x - rhs[given]
        return a, reaction

    def _hybrids(
        self, times: np.ndarray, q: np.ndarray, v: np.ndarray, tau: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Do what `_hybrid` does at times (N,) at once, where inertia is that of the bodies alone."""
        m, free, given = self.model, self.prescribed.free, self.prescribed.index
        mass, rhs = np.empty((len(times), m.nv, m.nv)), tau.copy()
        a, reaction = np.zeros_like(tau), np.zeros_like(tau)
        for i in range(len(times)):
            mass[i] = pin.crba(m.pin, m.data, q[i])
            rhs[i] -= pin.nonLinearEffects(m.pin, m.data, q[i], v[i])
        mass = np.triu(mass) + np.swapaxes(mass * self._above, 1, 2)
        if self.prescribed.motion is not None:
            a[:, self.prescribed.joints] = sample(self.prescribed.motion.acceleration, times)
            rhs -= (mass[:, :, given] @ a[:, given, None])[..., 0]
        a[:, free] = np.linalg.solve(mass[:, free][:, :, free], rhs[:, free, None])[..., 0]
        reaction[:, given] = (mass[:, given][:, :, free] @ a[:, free, None])[..., 0] - rhs[:, given]
        return a, reaction

    def enforce(self, t: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return copies of q (nq,) and v (nv,) that follow what is prescribed at t."""
        p = self.prescribed
        if not self._hybrid_needed:
            return q, v
        v = v.copy()
        v[p.index] = p.velocity(t, self.model.nv)[p.index]
        if p.motion is not None:
            q = set_group_angles(self.model.arm_joints, q, p.motion.position(t))
        return q, v

    def enforce_all(self, times: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
        """Let q (N, nq) and v (N, nv) follow what is prescribed at times (N,) [s], in place."""
        p = self.prescribed
        v[:, p.index] = 0.0
        if p.motion is not None:
            v[:, p.joints] = sample(p.motion.velocity, times)
            q[:] = set_group_angles(self.model.arm_joints, q, sample(p.motion.position, times))
