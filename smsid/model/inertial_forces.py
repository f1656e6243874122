"""Inertia beyond the model's bodies, and joints that follow others, as a force of the same effect."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from scipy.linalg import lapack

from smsid._time_text import time_text
from smsid.effects.assembly import InertiaTerm
from smsid.errors import SimulationError
from smsid.model.followers import Followers

PROBE = 1e-5  # half the step of a difference [rad, m, rad/s, m/s]


class InertialForces:
    """A `ForceTerm`, to be called last: the model moves as if it had the inertia of ``terms``, and its
    ``followers`` move with their leaders.

    With M' and b' what the terms add to mass matrix M and nonlinear effects b, the accelerations solve
    ``(M + M') a = tau - b - b'``; the force ``-M' a - b'`` added to tau gives the model, which has M and b,
    the same a. With rows C of followers, ``C a = 0`` and a force C' f between followers and leaders, which
    does no work, are part of the same solution. This holds when no motion is prescribed; `mass_and_bias` is
    for where it is.
    """

    def __init__(
        self, model: pin.Model, terms: Sequence[InertiaTerm], followers: Followers | None = None
    ) -> None:
        self.pin, self.terms, self.followers = model, tuple(terms), followers
        self._data: pin.Data | None = None

    def __call__(self, t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
        """Add the force to tau (nv,), which must hold all other forces.

        Raises `SimulationError` when the terms leave a motion without inertia.
        """
        if self._data is None:  # joints may have been added since
            self._data = self.pin.createData()
        mass = pin.crba(self.pin, self._data, q)  # its upper triangle
        bias = pin.nonLinearEffects(self.pin, self._data, q, v)
        more, extra = self.mass_and_bias(t, q, v)
        factor, a, info = lapack.dposv(mass + more, tau - bias - extra)
        if info == 0 and self.followers is not None:
            rows = self.followers.rows
            held = lapack.dpotrs(factor, rows.T)[0]
            force = np.linalg.solve(rows @ held, rows @ a)
            a -= held @ force
            tau -= rows.T @ force
        if info != 0:
            raise SimulationError(
                f"At t = {time_text(t)} effects take more inertia away than there is.",
                advice="Look at effects that take mass away, and at how far appendages bend.",
                time=t,
            )
        tau -= more @ a + extra

    def mass_and_bias(self, t: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what the terms add to the mass matrix (nv, nv) and to the nonlinear effects (nv,)."""
        mass, bias = np.zeros((self.pin.nv, self.pin.nv)), np.zeros(self.pin.nv)
        for term in self.terms:
            m, b = term(t, q, v)
            mass += m
            bias += b
        return mass, bias

    def derivatives(
        self, t: float, q: np.ndarray, v: np.ndarray, a: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the derivatives of the force at accelerations a (nv,) that stay, by the tangent of q and by
        v, each (nv, nv).

        Terms with ``derivatives`` of their own give them; of others, differences are taken over what they
        ``depend`` on: places and rates among the nv, all where they do not say or it is ``None``.
        """
        dq, dv = np.zeros((2, self.pin.nv, self.pin.nv))
        for term in self.terms:
            own = getattr(term, "derivatives", None)
            by_q, by_v = own(t, q, v, a) if own else self._differences(term, t, q, v, a)
            dq -= by_q
            dv -= by_v
        return dq, dv

    def _differences(
        self, term: InertiaTerm, t: float, q: np.ndarray, v: np.ndarray, a: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        nv = self.pin.nv
        on_q, on_v = getattr(term, "depends", None) or (range(nv), range(nv))

        def at(q: np.ndarray, v: np.ndarray) -> np.ndarray:
            mass, bias = term(t, q, v)
            return mass @ a + bias

        def moved(step: np.ndarray, by_rate: bool) -> np.ndarray:
            return at(q, v + step) if by_rate else at(pin.integrate(self.pin, q, step), v)

        dq, dv = np.zeros((2, nv, nv))
        step = np.zeros(nv)
        for by_rate, places, out in ((False, on_q, dq), (True, on_v, dv)):
            for j in places:
                step[j] = PROBE
                out[:, j] = (moved(step, by_rate) - moved(-step, by_rate)) / (2.0 * PROBE)
                step[j] = 0.0
        return dq, dv

    def force(self, t: float, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return the force (nv,) at known accelerations a (nv,), as where motion is prescribed."""
        mass, bias = self.mass_and_bias(t, q, v)
        return -(mass @ a + bias)
