"""Inertia that no body of the model has, as terms of the equations of motion: of any sign, and of rotors."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin

from smsid.effects.inertial_parameters import parameters_to_matrix, pinocchio_inertia
from smsid.errors import DescriptionError


def spatial_inertia(theta: np.ndarray) -> np.ndarray:
    """Return the spatial inertia (6, 6) (linear first) of parameters (m, mc, xx, xy, yy, xz, yz, zz)."""
    out, cross = np.zeros((6, 6)), pin.skew(theta[1:4])
    out[0, 0] = out[1, 1] = out[2, 2] = theta[0]
    out[:3, 3:], out[3:, :3], out[3:, 3:] = -cross, cross, parameters_to_matrix(theta)
    return out


class FrameMotion:
    """The motion of a joint's body along generalised coordinates; scratch space of its own, made when needed.

    The body's spatial velocity (linear, angular at the joint's origin, in the joint's axes) is ``J v``.
    """

    def __init__(self, model: pin.Model, joint: int) -> None:
        self.pin, self.joint = model, joint
        self.still = not model.gravity.linear.any()
        # a free-flyer root's velocity is the first six of v
        self.root = joint == 1 and model.joints[1].nv == 6 and model.jointPlacements[1].isIdentity()
        self._data: pin.Data | None = None
        self._jacobian = np.zeros((0, 0))

    def at(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return J (6, nv), the velocity (6,), and the acceleration less gravity (6,) where vdot is zero."""
        if self._data is None:  # joints may have been added since
            self._data = self.pin.createData()
            self._jacobian = np.eye(6, self.pin.nv)
        if self.root:
            drift = np.zeros(6)
            if not self.still:
                drift[:3] = -pin.Quaternion(q[3:7]).toRotationMatrix().T @ self.pin.gravity.linear
            return self._jacobian, v[:6], drift
        data: Any = self._data
        joint = self.joint
        pin.forwardKinematics(self.pin, data, q, v, np.zeros(self.pin.nv))
        jacobian = joint_jacobian(self.pin, data, q, joint)
        drift = np.array(data.a[joint].vector)
        drift[:3] -= data.oMi[joint].rotation.T @ self.pin.gravity.linear
        return jacobian, np.array(data.v[joint].vector), drift


def joint_jacobian(model: pin.Model, data: pin.Data, q: np.ndarray, joint: int) -> np.ndarray:
    """Return a joint's Jacobian (6, nv), in its own axes: also of a model with one degree of freedom.

    Pinocchio's bindings give matrices of one column as vectors.
    """
    return np.array(pin.computeJointJacobian(model, data, q, joint)).reshape(6, model.nv)


class ConstantInertia:
    """The `InertiaTerm` of a mass matrix that stays as it is; ``fill`` adds it to one of any size."""

    depends = ((), ())

    def __init__(self, fill: Callable[[np.ndarray], None]) -> None:
        self.fill = fill

    def __call__(self, t: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what it adds to mass matrix (nv, nv) and nonlinear effects (nv,)."""
        mass = np.zeros((v.size, v.size))
        self.fill(mass)
        return mass, np.zeros(v.size)


class ExtraInertia:
    """The `InertiaTerm` of inertial parameters (10,) at a joint's body, functions of time.

    ``None`` is nothing; the mass is else not zero, and may be negative. With spatial inertia I, velocity V
    and acceleration A of the body: ``J' (I A + V x* I V)``.
    """

    of_a_body = True  # what is solved with bodies may take it as part of that of its ``joint``

    def __init__(
        self, model: pin.Model, joint: int, parameters: Callable[[float], np.ndarray | None]
    ) -> None:
        self.motion, self.joint, self.parameters = FrameMotion(model, joint), joint, parameters
        self._alone: tuple[pin.Model, pin.Data] | None = None

    def __call__(self, t: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what it adds to mass matrix (nv, nv) and nonlinear effects (nv,)."""
        theta = self.parameters(t)
        if theta is None:
            return np.zeros((len(v), len(v))), np.zeros(len(v))
        inertia = spatial_inertia(theta)
        jacobian, velocity, drift = self.motion.at(q, v)
        momentum = inertia @ velocity
        linear, omega = pin.skew(velocity[:3]), pin.skew(velocity[3:])  # np.cross takes ten times as long
        gyroscopic = np.concatenate([omega @ momentum[:3], omega @ momentum[3:] + linear @ momentum[:3]])
        return jacobian.T @ inertia @ jacobian, jacobian.T @ (inertia @ drift + gyroscopic)

    def derivatives(
        self, t: float, q: np.ndarray, v: np.ndarray, a: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the derivatives of M' a + b' by the tangent of q and by v, each (nv, nv).

        They are Pinocchio's, of a model that has this inertia alone.
        """
        theta = self.parameters(t)
        if theta is None:
            return np.zeros((len(v), len(v))), np.zeros((len(v), len(v)))
        if self._alone is None:
            alone = self.motion.pin.copy()
            for j in range(alone.njoints):
                alone.inertias[j] = pin.Inertia.Zero()
            alone.armature[:] = 0.0
            self._alone = alone, alone.createData()
        model, data = self._alone
        sign = -1.0 if theta[0] < 0.0 else 1.0  # a body of Pinocchio's has a positive mass
        model.inertias[self.joint] = pinocchio_inertia(sign * theta)
        pin.computeRNEADerivatives(model, data, q, v, a)
        return sign * data.dtau_dq, sign * data.dtau_dv


class GrowingInertia(ExtraInertia):
    """Inertial parameters at a joint's body that grow by ``growth`` (10,) a second from ``begun`` [s] on."""

    def __init__(self, model: pin.Model, joint: int, growth: np.ndarray, begun: float) -> None:
        self.growth, self.begun = growth, begun
        super().__init__(model, joint, lambda t: growth * (t - begun) if t > begun else None)


def turns(model: pin.Model, joint: int) -> bool:
    """Whether a joint of one coordinate turns, and does not slide."""
    own, data = model.joints[joint], model.joints[joint].createData()
    own.calc(data, pin.neutral(model))
    return not np.any(data.S[:3])


class Rotor:
    """The `InertiaTerm` of a rotor of spin inertia I about a joint's axis n, with the twist phi of its gear.

    Its rate is ``w = s + phid``, with ``s = qd + c n . omega`` where omega is the rate of the carrying link,
    and its kinetic energy ``1/2 I w^2``. Where the link counts it already, ``1/2 I s^2`` is taken off. Of
    ``1/2 I phid^2`` the armature of the twist takes care. From Lagrange's equations: ``I wd`` on all that w
    goes with, and the torque ``c I w omega x n`` on the carrying link.
    """

    def __init__(
        self, model: pin.Model, joint: int, inertia: float, carried: float, *, gear: int | None, in_link: bool
    ) -> None:
        self.motion, self.link = FrameMotion(model, joint), model.joints[joint].idx_v
        self.joint, self.inertia, self.carried, self.gear = joint, inertia, carried, gear
        self.in_link = in_link
        self.depends = None if carried else ((), ())
        if carried and not turns(model, joint):
            raise DescriptionError(
                f"A rotor is carried round by the link before joint '{model.names[joint]}', which slides.",
                advice="Leave out `carried`, or give it 0.",
            )

    def __call__(self, t: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what it adds to mass matrix (nv, nv) and nonlinear effects (nv,)."""
        own, along, counted = np.zeros(len(v)), np.zeros(len(v)), 0.0 if self.in_link else 1.0
        if self.gear is not None:
            own[self.gear] = 1.0
        along[self.link], drift, across = 1.0, 0.0, np.zeros(len(v))
        if self.carried:
            along, drift = self.turning(q, v)
            jacobian, velocity, _ = self.motion.at(q, v)
            across = jacobian[3:].T @ np.cross(velocity[3:], jacobian[3:, self.link])
        mass = counted * np.outer(along, along) + np.outer(own, along) + np.outer(along, own)
        spin = float((counted * along + own) @ v)
        bias = drift * (counted * along + own) + self.carried * spin * across
        return self.inertia * mass, self.inertia * bias

    def turning(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, float]:
        """Return the derivative of s by v (nv,), and sd [rad/s^2] where vd is zero."""
        jacobian, _, drift = self.motion.at(q, v)
        axis = jacobian[3:, self.link]
        along = self.carried * (axis @ jacobian[3:])
        along[self.link] = 1.0
        return along, self.carried * float(axis @ drift[3:])
