"""Inertial-parameter regressors of the whole spacecraft, from Pinocchio.

Parameters theta stack (m, mcx, mcy, mcz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz) of every body in its joint's frame,
about the joint's origin: (10 bodies,), ordered as the joints of the Pinocchio model.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from smsid.model.spacecraft import SpacecraftModel

INERTIAL_NAMES = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
_torque_regressor = pin.computeJointTorqueRegressor
INERTIAL_UNITS = ("kg", "kg m", "kg m", "kg m", *("kg m^2",) * 6)


class Regressor:
    """Momentum and torque regressors of one model. Holds scratch space: not for sharing between threads.

    ``bodies`` names the moving bodies, ``names`` their inertial parameters ``<body>.<m|mx|...|Izz>``, in the
    order of the ``columns``; ``units`` theirs.
    """

    def __init__(self, model: SpacecraftModel) -> None:
        self.model = model
        self._pin = model.pin
        self._data = model.pin.createData()
        self._weightless = model.pin.copy()
        self._weightless.gravity = pin.Motion.Zero()
        self._weightless_data = self._weightless.createData()
        self._rest = np.zeros(model.nv)
        self.bodies = body_names(model.pin)
        self.names = tuple(f"{body}.{p}" for body in self.bodies for p in INERTIAL_NAMES)
        self.units = INERTIAL_UNITS * len(self.bodies)
        self.columns = len(self.names)

    @property
    def parameters(self) -> np.ndarray:
        """The description's inertial parameters theta (10 bodies,)."""
        return np.concatenate([dynamic_parameters(i) for i in list(self._pin.inertias)[1:]])

    def momentum(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return Y with Y theta = (p, h): momentum about the bus origin in bus axes, (N, 6, 10 bodies).

        For q (N, nq), v (N, nv). Uses that the torque regressor without gravity at zero rate and acceleration
        v is M(q) v, whose first six rows are the momentum of a free-flyer [N s, N m s].
        """
        return self.generalised_momentum(q, v, 6)

    def generalised_momentum(self, q: np.ndarray, v: np.ndarray, rows: int | None = None) -> np.ndarray:
        """Return Y with Y theta = M(q) v: (N, nv, 10 bodies), or its first ``rows``."""
        q, v = np.atleast_2d(q), np.atleast_2d(v)
        model, data, rest, build = self._weightless, self._weightless_data, self._rest, _torque_regressor
        out = np.empty((len(q), rows or self.model.nv, self.columns))
        shape = self.model.nv, self.columns
        for into, q_i, v_i in zip(out, q, v, strict=True):
            whole = np.reshape(build(model, data, q_i, rest, v_i), shape)  # one row comes as a vector
            into[:] = whole[:rows]
        return out

    def torque(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return Y with Y theta = M(q) a + nonlinear terms: generalised forces (N, nv, 10 bodies)."""
        q, v, a = np.atleast_2d(q), np.atleast_2d(v), np.atleast_2d(a)
        model, data, build = self._pin, self._data, _torque_regressor
        out = np.empty((len(q), self.model.nv, self.columns))
        for into, q_i, v_i, a_i in zip(out, q, v, a, strict=True):
            into[:] = build(model, data, q_i, v_i, a_i)
        return out


def body_names(model: pin.Model) -> tuple[str, ...]:
    """Return a readable name for every joint's body: the link in the joint's frame, else the joint."""
    names = list(model.names)[1:]
    for frame in model.frames:
        j = frame.parentJoint
        if frame.type == pin.FrameType.BODY and j > 0 and frame.placement.isIdentity(1e-12):
            first = names[j - 1] == model.names[j]
            names[j - 1] = frame.name if first else names[j - 1]
    return tuple(names)


def dynamic_parameters(inertia: pin.Inertia) -> np.ndarray:
    """Return the ten parameters (10,) of a `pin.Inertia`: m, m c, I about the origin [kg, kg m, kg m^2]."""
    return np.asarray(inertia.toDynamicParameters())
