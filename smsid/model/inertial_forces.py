"""Inertia beyond the bodies of the model, as a generalised force that gives the same accelerations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from scipy.linalg import lapack

from smsid.effects.base import ForceTerm, InertiaTerm
from smsid.errors import SimulationError


class InertialForces:
    """A `ForceTerm`, to be called last: with it, the model moves as if it had the inertia of ``terms``.

    With M' and b' what the terms add to mass matrix M and nonlinear effects b, the accelerations solve
    ``(M + M') a = tau - b - b'``; the force ``-M' a - b'`` added to tau gives the model, which has M and b,
    the same a. This holds when no motion is prescribed; `mass_and_bias` is for where it is.
    """

    def __init__(self, model: pin.Model, terms: Sequence[InertiaTerm]) -> None:
        self.pin, self.terms = model, tuple(terms)
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
        _, a, info = lapack.dposv(mass + more, tau - bias - extra)
        if info != 0:
            raise SimulationError(
                f"At t = {t:.6g} s effects take more inertia away than there is.",
                advice="Look at effects that take mass away, and at how far appendages bend.",
                time=t,
            )
        tau -= more @ a + extra

    def using(self, model: pin.Model) -> InertialForces:
        """Return the same terms for a model like this one with other armature, as where it locks joints."""
        return InertialForces(model, self.terms)

    def mass_and_bias(self, t: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what the terms add to the mass matrix (nv, nv) and to the nonlinear effects (nv,)."""
        mass, bias = np.zeros((self.pin.nv, self.pin.nv)), np.zeros(self.pin.nv)
        for term in self.terms:
            m, b = term(t, q, v)
            mass += m
            bias += b
        return mass, bias

    def held(self, a: np.ndarray) -> ForceTerm:
        """Return the term that adds the force at accelerations a (nv,), whatever state it is called with."""

        def term(t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
            tau += self.force(t, q, v, a)

        return term

    def force(self, t: float, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return the force (nv,) at known accelerations a (nv,), as where motion is prescribed."""
        mass, bias = self.mass_and_bias(t, q, v)
        return -(mass @ a + bias)
