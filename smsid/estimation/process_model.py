"""The model as a filter needs it: accelerations under mean inputs, one step ahead, and linearised."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from smsid.effects.inertial_parameters import pinocchio_inertia
from smsid.inputs.inputs import Inputs
from smsid.inputs.signals import Signal
from smsid.kernel.arrays import Kernel, arrays_of
from smsid.kernel.covariance import LONGEST, MOST
from smsid.kernel.jit import available
from smsid.model.inertial_forces import InertialForces
from smsid.model.regressor import dynamic_parameters
from smsid.model.spacecraft import SpacecraftModel

LOCK_INERTIA = 1e9  # [kg m^2] rotor inertia of a joint that is held still
DIFFERENCE_STEP = 1e-6  # step of the differences of nonlinear forces


@dataclass(frozen=True)
class LinearDynamics:
    """Accelerations a (nv,) and their derivatives by q (tangent), v and generalised force (nv, nv)."""

    a: np.ndarray
    by_q: np.ndarray
    by_v: np.ndarray
    by_tau: np.ndarray


def inverse_inertias(model: SpacecraftModel, locked: np.ndarray) -> np.ndarray:
    """Return what a force of one moves its own coordinate by (nv,) [1/kg, 1/(kg m^2)], at home."""
    at_rest = np.zeros(model.nv)
    return ProcessModel(model, locked).linear(0.0, model.home, at_rest, at_rest).by_tau.diagonal().copy()


class ProcessModel:
    """Forward dynamics of a spacecraft, some joints perhaps locked. Not to be shared between threads."""

    def __init__(self, model: SpacecraftModel, locked: np.ndarray) -> None:
        self.model = model
        self.pin = model.pin.copy()
        self.pin.armature[locked] += LOCK_INERTIA
        self._growing: list[tuple[Any, np.ndarray]] = []
        if model.inertial is not None:  # it is to solve with what is held still
            terms = model.inertial.terms
            bodies: list[Any] = [x for x in terms if getattr(x, "of_a_body", False)]  # faster as part of it
            self._growing = [(x, dynamic_parameters(self.pin.inertias[x.joint])) for x in bodies]
            rest = [x for x in terms if x not in bodies]
            bound = bool(rest) or model.followers is not None
            held = InertialForces(self.pin, rest, model.followers) if bound else None
            forces = model.forces[:-1] if held is None else (*model.forces[:-1], held)
            self.model = replace(model, forces=forces, inertial=held)
        self.data = self.pin.createData()
        self.locked = locked
        self.nv, self.free = model.nv, model.free
        self._driven: tuple[Inputs, Signal] | None = None
        plain = self.model.forces if self.model.inertial is None else self.model.forces[:-1]
        self._forces = (*model.loads, *plain)
        known = [getattr(f, "depends", None) for f in self._forces]
        every = range(model.nv)
        self._moved = every if None in known else sorted({int(j) for d in known if d for j in d[0]})
        self._faster = every if None in known else sorted({int(j) for d in known if d for j in d[1]})
        self._one = np.eye(2 * model.nv)
        self._upper = np.triu_indices(model.nv, 1)
        self._stiffness, self._damping = np.zeros((2, model.nv))
        self._stiffness[model.spring_v], self._damping[model.spring_v] = model.stiffness, model.damping

    def applied(self, inputs: Inputs) -> Signal:
        """Return the applied generalised forces (nv,) of what is commanded; those of the last inputs stay."""
        if self._driven is None or self._driven[0] is not inputs:
            self._driven = inputs, inputs.driven(self.model).applied(self.model)
        return self._driven[1]

    def kernel(self, *, balanced: bool = True) -> Kernel | None:
        """Return the arrays that compiled code takes, as `smsid.kernel.arrays.arrays_of`, or ``None``."""
        own = self.model
        if not available() or own.followers is not None:
            return None
        inertial = () if own.inertial is None else own.inertial.terms
        terms = (*self._forces, *inertial, *(x for x, _ in self._growing))
        return arrays_of(own, self.pin, terms, balanced=balanced)

    def acceleration(self, t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return vdot (nv,) under applied generalised forces tau (nv,)."""
        total = tau.copy()
        if self._growing:
            self._grow(t)
        self.model.add_passive_forces(t, q, v, total)
        return pin.aba(self.pin, self.data, q, v, total)

    def _grow(self, t: float) -> None:
        """Give bodies whose inertia changes in time what they have now."""
        for term, begun in self._growing:
            more = term.parameters(t)
            theta = begun if more is None else begun + more
            self.pin.inertias[term.joint] = pinocchio_inertia(theta)

    def linear(self, t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> LinearDynamics:
        """Return accelerations at q (nq,), v (nv,) under tau (nv,), with their derivatives."""
        m = self.model
        if self._growing:
            self._grow(t)
        total = tau.copy()
        m.add_passive_forces(t, q, v, total)
        pin.computeABADerivatives(self.pin, self.data, q, v, total)
        inverse = np.array(self.data.Minv)
        rows, columns = self._upper
        inverse[columns, rows] = inverse[rows, columns]
        by_q = self.data.ddq_dq - inverse * self._stiffness
        by_v = self.data.ddq_dv - inverse * self._damping
        a = np.array(self.data.ddq)
        if self._forces:
            dq, dv = self._differences(t, q, v, tau)
            by_q += inverse @ dq
            by_v += inverse @ dv
        if m.inertial is not None:
            # (M + M') da = dtau - d(M a + b) - d(M' a + b'), the last two at a held
            more, _ = m.inertial.mass_and_bias(t, q, v)
            dq, dv = m.inertial.derivatives(t, q, v, a)
            whole = np.eye(self.nv) + inverse @ more
            by_q, by_v = (
                np.linalg.solve(whole, by_q + inverse @ dq),
                np.linalg.solve(whole, by_v + inverse @ dv),
            )
            inverse = np.linalg.solve(whole, inverse)
        if m.followers is not None:  # C da = 0: a force between followers and leaders sees to it
            rows = m.followers.rows
            held = np.linalg.solve(rows @ inverse @ rows.T, rows @ inverse).T
            by_q, by_v = by_q - held @ (rows @ by_q), by_v - held @ (rows @ by_v)
            inverse = inverse - held @ (rows @ inverse)
        return LinearDynamics(a, by_q, by_v, inverse)

    def moving(self, t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> LinearDynamics:
        """Return accelerations at q (nq,), v (nv,) under tau (nv,); their derivatives are left zero."""
        nothing = np.zeros((self.nv, self.nv))
        return LinearDynamics(self.acceleration(t, q, v, tau), nothing, nothing, nothing)

    def _differences(
        self, t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:

        def forces(q: np.ndarray, v: np.ndarray) -> np.ndarray:
            out = tau.copy()
            for term in self._forces:
                term(t, q, v, out)
            return out

        rest = forces(q, v)
        dq, dv = np.zeros((2, self.nv, self.nv))
        step = np.zeros(self.nv)
        for j in self._faster:
            step[j] = DIFFERENCE_STEP
            dv[:, j] = forces(q, v + step) - rest
            step[j] = 0.0
        for j in self._moved:
            step[j] = DIFFERENCE_STEP
            dq[:, j] = forces(pin.integrate(self.pin, q, step), v) - rest
            step[j] = 0.0
        return dq / DIFFERENCE_STEP, dv / DIFFERENCE_STEP

    def step(
        self,
        t: float,
        h: float,
        q: np.ndarray,
        v: np.ndarray,
        tau: np.ndarray,
        rise: np.ndarray | float = 0.0,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return q (nq,), v (nv,) a step h [s] later: Runge and Kutta.

        Generalised forces (nv,) go from ``tau - rise`` to ``tau + rise``, straight.
        """
        half = 0.5 * h
        x1, a1 = v, self.acceleration(t, q, v, tau - rise)
        v2 = v + half * a1
        xi = half * x1
        x2, a2 = self._rate(xi, v2), self.acceleration(t + half, self._at(q, xi), v2, tau)
        v3 = v + half * a2
        xi = half * x2
        x3, a3 = self._rate(xi, v3), self.acceleration(t + half, self._at(q, xi), v3, tau)
        v4 = v + h * a3
        xi = h * x3
        x4, a4 = self._rate(xi, v4), self.acceleration(t + h, self._at(q, xi), v4, tau + rise)
        return self._at(q, h / 6.0 * (x1 + 2.0 * (x2 + x3) + x4)), v + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)

    def _at(self, q: np.ndarray, xi: np.ndarray) -> np.ndarray:
        return pin.integrate(self.pin, q, xi)

    def _rate(self, xi: np.ndarray, v: np.ndarray) -> np.ndarray:
        if not self.free:
            return v
        out = v.copy()
        out[:6] = pin.Jlog6(pin.exp6(xi[:6])) @ v[:6]
        return out

    def transition(self, h: float, v: np.ndarray, linear: LinearDynamics) -> tuple[np.ndarray, np.ndarray]:
        """Return F (2 nv, 2 nv) and Psi with delta(t + h) = F delta(t) + Psi forcing, forcing held.

        delta = (tangent of q, v); F = exp(A h) and Psi = int_0^h exp(A s) ds, to fourth order over a step
        that is short enough, and squared, as `smsid.kernel.covariance.transition` does.
        """
        n = self.nv
        one = self._one
        a = np.zeros((2 * n, 2 * n))
        a[:n, n:] = one[:n, :n]
        if self.free:
            a[:6, :6] = -pin.Motion(v[:6]).action
        a[n:, :n], a[n:, n:] = linear.by_q, linear.by_v
        springs, dampers = (np.abs(x.diagonal()).sum() for x in (linear.by_q, linear.by_v))
        steps = h * (np.sqrt(springs) + dampers) / LONGEST
        squared = int(np.ceil(np.log2(min(steps, 2.0**MOST)))) if steps > 1.0 else 0
        h = h / 2.0**squared
        psi = one + (h / 4.0) * a
        psi = one + (h / 3.0) * (a @ psi)
        psi = h * (one + (h / 2.0) * (a @ psi))
        f = one + a @ psi
        for _ in range(squared):
            f, psi = f @ f, psi + f @ psi
        return f, psi
