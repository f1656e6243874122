"""A motor's rotor that turns with the link that carries it, as well as with the joint it drives."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from smsid.effects.spatial import Motion
from smsid.errors import DescriptionError

SLIDING = ("JointModelP", "JointModelH")
"""How Pinocchio's joints of one coordinate are called that slide, or screw."""


def turns(model: pin.Model, joint: int) -> bool:
    """Whether a joint of one coordinate turns, and does not slide."""
    return not model.joints[joint].shortname().startswith(SLIDING)


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
        self.motion, self.link = Motion(model, joint), model.joints[joint].idx_v
        self.inertia, self.carried, self.gear, self.in_link = inertia, carried, gear, in_link
        if not turns(model, joint):
            raise DescriptionError(
                f"A rotor is carried round by the link before joint '{model.names[joint]}', which slides.",
                advice="Leave out `carried`, or give it 0.",
            )

    def __call__(self, t: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what it adds to mass matrix (nv, nv) and nonlinear effects (nv,)."""
        along, drift = self.turning(q, v)
        own = np.zeros(len(v))
        if self.gear is not None:
            own[self.gear] = 1.0
        counted = 0.0 if self.in_link else 1.0
        mass = counted * np.outer(along, along) + np.outer(own, along) + np.outer(along, own)
        spin = float((counted * along + own) @ v)
        jacobian, velocity, _ = self.motion.at(q, v)
        across = jacobian[3:].T @ np.cross(velocity[3:], jacobian[3:, self.link])
        bias = drift * (counted * along + own) + self.carried * spin * across
        return self.inertia * mass, self.inertia * bias

    def turning(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, float]:
        """Return the derivative of s by v (nv,), and sd [rad/s^2] where vd is zero."""
        jacobian, _, drift = self.motion.at(q, v)
        axis = jacobian[3:, self.link]
        along = self.carried * (axis @ jacobian[3:])
        along[self.link] = 1.0
        return along, self.carried * float(axis @ drift[3:])
