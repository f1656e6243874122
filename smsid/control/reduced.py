"""Reduced joint-space dynamics (40)-(42) of a free-floating spacecraft.

The controller's model: slosh and appendages frozen. Let v = (v_l, r) with v_l the linear velocity of the
base and r the rest. No force acts in free floating, so the rows of v_l give its derivative and drop out:

    (M_rr - M_rl M_ll^-1 M_lr) r_dot + (b_r - M_rl M_ll^-1 b_l) = tau_r,

whatever the velocity of the system's centre of mass (the bias of this form does not depend on it), so neither
position nor linear velocity of the base need be measured. The wheels' accelerations are eliminated the same
way: with u = (omega, arm rates) as what is left,

    H_b u_dot + b_b = [torque of the wheels on the base, arm torques].

The wheels' speeds stay in b_b through the momentum they store; they are measured, or follow from the
conserved angular momentum. Attitude coordinates give (40): H = S^T H_b S, J_c^T = S^T, S = blkdiag(E, I).
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin
from scipy.linalg import lapack

from smsid.control._wheels import WheelLayout
from smsid.errors import ControlError
from smsid.model.spacecraft import JointGroup, SpacecraftModel, set_group_angles


@dataclass(frozen=True)
class BodyTerms:
    """H_b u_dot + b_b = input @ (wheel motor torques, joint torques), u = (omega body axes, joint rates).

    ``inertia`` (3 + n, 3 + n), ``bias`` (3 + n,), ``input`` (3 + n, w + n).
    """

    inertia: np.ndarray
    bias: np.ndarray
    input: np.ndarray


class ReducedDynamics:
    """The controller's model of a free-floating spacecraft: base attitude and the joints of all its arms.

    Joints that are no arm's and no wheel's (slosh, bending, what the URDF leaves free) are frozen where
    the home configuration has them. Not safe to share between threads.
    """

    def __init__(self, model: SpacecraftModel) -> None:
        """Reduce a spacecraft; raises `ControlError` for a welded base or a singular wheel layout."""
        if not model.free:
            raise ControlError(
                f"'{model.description.name}' is welded to the ground; the reduced dynamics are those of a "
                "free-floating spacecraft.",
                advice='Describe it with root = "free".',
            )
        self.layout = WheelLayout.of(model)
        kept = {1, *model.arm_joints.joints.tolist(), *model.wheels.joints.tolist()}
        frozen = [j for j in range(1, model.pin.njoints) if j not in kept]
        self.pin = pin.buildReducedModel(model.pin, frozen, model.home) if frozen else model.pin.copy()
        self.pin.gravity.linear = np.zeros(3)
        self.data = self.pin.createData()
        self.arm = _group_in(self.pin, model.arm_joints)
        self.wheels = _group_in(self.pin, model.wheels)
        self.mass = float(sum(inertia.mass for inertia in self.pin.inertias))
        self._q = pin.neutral(self.pin)
        self._v = np.zeros(self.pin.nv)
        self._plain = all(self.pin.joints[int(j)].nq == 1 for j in self.arm.joints)
        n = len(self.arm)
        self.left = np.array([*(self.wheels.v - 3), *range(3), *(self.arm.v - 3)])
        self._left_rows = self.left[:, None]
        self._input = np.hstack([np.zeros((3 + n, len(self.wheels))), np.eye(3 + n)[:, 3:]])
        self._to_wheels = -self.layout.inverse

    @property
    def size(self) -> int:
        """Number of coordinates, 3 + n."""
        return 3 + len(self.arm)

    @property
    def bodies(self) -> dict[str, pin.Inertia]:
        """Inertias of the bodies, by the joints of ``pin`` from the base on."""
        return dict(zip(list(self.pin.names)[1:], list(self.pin.inertias)[1:], strict=True))

    def with_inertias(self, inertias: list[pin.Inertia]) -> ReducedDynamics:
        """Return a copy whose bodies have other inertias, one per joint of ``pin`` from the base on.

        Raises `ControlError` for another number of them.
        """
        if len(inertias) != self.pin.njoints - 1:
            raise ControlError(
                f"{len(inertias)} inertias were given for {self.pin.njoints - 1} bodies: "
                f"{', '.join(self.bodies)}."
            )
        other = copy.copy(self)
        other.pin = self.pin.copy()
        for joint, inertia in enumerate(inertias, start=1):
            other.pin.inertias[joint] = inertia
        other.data = other.pin.createData()
        other.mass = float(sum(inertia.mass for inertia in other.pin.inertias))
        other._q, other._v = self._q.copy(), self._v.copy()
        return other

    def body_terms(
        self, omega: np.ndarray, angles: np.ndarray, rates: np.ndarray, wheel_rates: np.ndarray | None = None
    ) -> BodyTerms:
        """Return the dynamics in body velocities.

        Args:
            omega: (3,) angular rate of the base, body axes [rad/s].
            angles, rates: (n,) arm joints [rad, rad/s].
            wheel_rates: (w,) relative to the base [rad/s]; by default those of zero total momentum.

        Raises:
            ControlError: shapes that do not fit.
        """
        self._check(omega, angles, rates, wheel_rates)
        w = len(self.wheels)
        q, v = self.configuration(angles), self.velocity(omega, rates, 0.0)
        mass = pin.crba(self.pin, self.data, q)
        coupling = mass[:3, 3:]
        schur = (mass[3:, 3:] - coupling.T @ coupling / self.mass)[self._left_rows, self.left]
        if wheel_rates is None:
            spin = -schur[w : w + 3, w:] @ np.concatenate([omega, rates])
            wheel_rates = np.linalg.pinv(schur[w : w + 3, :w]) @ spin
        v[self.wheels.v] = wheel_rates
        force = pin.nonLinearEffects(self.pin, self.data, q, v)
        bias = (force[3:] - coupling.T @ force[:3] / self.mass)[self.left]
        given = np.empty((w, self.size + 1))
        given[:, :-1], given[:, -1] = schur[:w, w:], bias[:w]
        _, _, spun, info = lapack.dgesv(schur[:w, :w], given)
        if info != 0:
            raise ControlError("The wheels' inertia matrix is singular.", advice="Check their spin inertia.")
        rest = schur[w:, :w]
        enters = self._input.copy()
        enters[:, :w] = -spun[:, :-1].T
        return BodyTerms(schur[w:, w:] - rest @ spun[:, :-1], bias[w:] - rest @ spun[:, -1], enters)

    def base_input(self, terms: BodyTerms) -> np.ndarray:
        """Return (3 + n, 3 + n): from Q_c (42), wheel torque on the base and joint torques, to body forces.

        The identity for balanced wheels: what motors put on the base is what the layout's axes say.
        """
        w = len(self.wheels)
        found = np.empty((self.size, self.size))
        found[:, :3], found[:, 3:] = terms.input[:, :w] @ self._to_wheels, terms.input[:, w:]
        return found

    def torques(self, terms: BodyTerms, acceleration: np.ndarray) -> np.ndarray:
        """Return Q_c (3 + n,) that gives u the derivative ``acceleration`` (3 + n,): J_c^-T (H qdd + c).

        Raises `ControlError` when the wheels do not act on the base.
        """
        needed = terms.inertia @ acceleration + terms.bias
        _, _, solution, info = lapack.dgesv(self.base_input(terms), needed)
        if info != 0:
            raise ControlError("The wheels do not act on the base.", advice="Check their axes and inertia.")
        return solution

    def configuration(self, angles: np.ndarray) -> np.ndarray:
        """Return q of ``pin`` with the arm joints at ``angles`` (n,) [rad]; overwritten by the next call."""
        if self._plain:
            self._q[self.arm.q] = angles
            return self._q
        return set_group_angles(self.arm, self._q, angles)

    def velocity(self, omega: np.ndarray, rates: np.ndarray, wheel_rates: np.ndarray | float) -> np.ndarray:
        """Return v of ``pin`` (nv,), linear velocity left out; overwritten by the next call.

        ``omega`` (3,) body axes, joint ``rates`` (n,), ``wheel_rates`` (w,) or one for all, [rad/s].
        """
        v = self._v
        v[3:6], v[self.arm.v], v[self.wheels.v] = omega, rates, wheel_rates
        return v

    def _check(
        self, omega: np.ndarray, angles: np.ndarray, rates: np.ndarray, wheel_rates: np.ndarray | None
    ) -> None:
        n, w = len(self.arm), len(self.wheels)
        given = {"omega": (omega, (3,)), "angles": (angles, (n,)), "rates": (rates, (n,))}
        if wheel_rates is not None:
            given["wheel_rates"] = (wheel_rates, (w,))
        for name, (value, shape) in given.items():
            if np.shape(value) != shape:
                raise ControlError(
                    f"`{name}` has shape {np.shape(value)}, the spacecraft needs {shape}.",
                    advice=f"It has {n} arm joints ({', '.join(self.arm.names)}) and {w} wheels.",
                )


def _group_in(model: pin.Model, group: JointGroup) -> JointGroup:
    return JointGroup.of(model, [model.getJointId(name) for name in group.names])


Draw = Literal["uniform", "signs", "common"]


def perturb_bodies(
    dynamics: ReducedDynamics, level: float, rng: np.random.Generator, draw: Draw = "uniform"
) -> ReducedDynamics:
    """Return the dynamics with every body's mass, centre of mass and inertia off by up to ``level``.

    Per body one factor on the mass, one on the lever to the centre of mass, one on the inertia about it: each
    body stays one that can exist. ``uniform`` draws each factor within 1 +- level, ``signs`` takes one of the
    two ends, ``common`` one uniform factor for all masses and inertias. The wheels are known (section V). The
    same generator state gives the same pattern at any level.

    Raises `ControlError` for a level outside [0, 1) or an unknown way to draw.
    """
    if not 0.0 <= level < 1.0:
        raise ControlError(f"An uncertainty of {level} is not in [0, 1).", advice="Give 0.05 for 5 %.")
    wheels = set(dynamics.wheels.joints.tolist())
    inertias = []
    bodies = dynamics.pin.njoints - 1
    if draw == "uniform":
        pattern = rng.uniform(-1.0, 1.0, (bodies, 3))
    elif draw == "signs":
        pattern = rng.choice([-1.0, 1.0], (bodies, 3))
    elif draw == "common":
        pattern = np.tile([1.0, 0.0, 1.0], (bodies, 1)) * rng.uniform(-1.0, 1.0)
    else:
        raise ControlError(f"There is no way to draw '{draw}'.", advice="Use uniform, signs or common.")
    for k in range(bodies):
        body = dynamics.pin.inertias[k + 1]
        mass, lever, inertia = 1.0 + level * pattern[k]
        changed = pin.Inertia(mass * body.mass, lever * body.lever, inertia * body.inertia)
        inertias.append(body.copy() if k + 1 in wheels else changed)
    return dynamics.with_inertias(inertias)
