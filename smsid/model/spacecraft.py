"""The spacecraft as one Pinocchio model, with names for what its joints are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
from scipy.linalg import lapack

from smsid._short_repr import short_repr
from smsid.description.schema import Description
from smsid.description.urdf_reading import Mimic
from smsid.effects.assembly import AppendageJoints, ForceTerm, InertiaTerm, Twist
from smsid.effects.slosh import Slosh
from smsid.model.followers import Followers
from smsid.model.inertial_forces import InertialForces


@short_repr
@dataclass(frozen=True)
class JointGroup:
    """Joints of one role: names and where they are in q and v. One degree of freedom each.

    Those ``endless`` (joints,) have the cosine of their angle in q, and the sine after it.
    """

    names: tuple[str, ...]
    joints: np.ndarray
    q: np.ndarray
    v: np.ndarray
    endless: np.ndarray

    @classmethod
    def of(cls, model: pin.Model, joints: Sequence[int]) -> JointGroup:
        """Return the group of these joint indices."""
        return cls(
            tuple(model.names[j] for j in joints),
            np.array(joints, dtype=int),
            np.array([model.joints[j].idx_q for j in joints], dtype=int),
            np.array([model.joints[j].idx_v for j in joints], dtype=int),
            np.array([model.joints[j].nq == 2 for j in joints], dtype=bool),
        )

    def __len__(self) -> int:
        return len(self.names)


@short_repr
@dataclass(frozen=True)
class SloshJoint:
    """A slosh mass: the tank it is of, its joint, where it is in q and v (3 each), and c_s (3,) [m].

    c_s is in the frame of the joint that carries it: the bus frame, unless the slosh sits on an arm's link.
    """

    tank: Slosh
    joint: int
    q: slice
    v: slice
    position: np.ndarray

    @classmethod
    def of(cls, model: pin.Model, tank: Slosh, joint: int) -> SloshJoint:
        """Return the slosh mass of a tank, on a joint of three coordinates."""
        q, v = (slice(i, i + 3) for i in (model.joints[joint].idx_q, model.joints[joint].idx_v))
        return cls(tank, joint, q, v, model.jointPlacements[joint].translation.copy())

    @property
    def name(self) -> str:
        """Name of the tank."""
        return self.tank.name


@dataclass(frozen=True)
class Source:
    """What was loaded for a model, before effects: for `smsid.model.rebuild`.

    ``wheeled`` is ``pin`` with the wheels of the description, whose joints are ``wheels``; ``losses`` are
    viscous and Coulomb friction by joint, ``mimics`` the joints that follow another, as the URDFs have them.
    """

    pin: pin.Model
    own_joints: tuple[str, ...]
    mounted: dict[str, tuple[str, ...]]
    wheeled: pin.Model | None = None
    wheels: tuple[str, ...] = ()
    losses: dict[str, tuple[float, float]] = field(default_factory=dict)
    mimics: dict[str, Mimic] = field(default_factory=dict)


@short_repr
@dataclass(frozen=True)
class SpacecraftModel:
    """A spacecraft ready to compute with.

    ``pin`` is the Pinocchio model; q = (p, quaternion xyzw, joints), v = (v_body, omega_body, joint rates) of
    the bus frame. Springs and dampers act on the degrees of freedom ``spring_v`` with ``stiffness`` and
    ``damping``; ``loads`` are forces that depend on the applied ones and come first, ``forces`` all other
    nonlinear ones, the last of them ``inertial`` if there is any, which also keeps ``followers`` with their
    leaders; at ``breakpoints`` [s] a force jumps.
    ``owned`` are the terms of ``loads``, ``forces`` and ``inertial``, each with the name of the effect it is
    of. What an encoder reads is `encoder_angles`. Not safe to share between threads: ``data`` is scratch
    space.
    """

    description: Description
    pin: pin.Model
    visual: pin.GeometryModel | None
    data: pin.Data
    free: bool
    arms: dict[str, JointGroup]
    arm_joints: JointGroup
    wheels: JointGroup
    slosh: tuple[SloshJoint, ...]
    appendages: tuple[AppendageJoints, ...]
    modes: JointGroup
    mode_scale: np.ndarray
    spring_q: np.ndarray
    spring_v: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    forces: tuple[ForceTerm, ...]
    home: np.ndarray
    thrust_point: np.ndarray
    loads: tuple[ForceTerm, ...] = ()
    inertial: InertialForces | None = None
    owned: tuple[tuple[str, ForceTerm | InertiaTerm], ...] = ()
    breakpoints: tuple[float, ...] = ()
    motors: tuple[tuple[int, int, int], ...] = ()  # index of the arm joint, q and v of what its encoder adds
    twists: tuple[tuple[int, int, Twist], ...] = ()  # index of the arm joint, its v, what its encoder adds
    source: Source | None = None
    followers: Followers | None = None

    @property
    def further_modes(self) -> JointGroup:
        """Modes that other effects add to appendages; ``modes`` are the appendages' own."""
        return JointGroup.of(self.pin, [m.joint for a in self.appendages for m in a.more])

    @property
    def nq(self) -> int:
        """Length of q."""
        return self.pin.nq

    @property
    def nv(self) -> int:
        """Length of v."""
        return self.pin.nv

    @property
    def mass(self) -> float:
        """Total mass M [kg], everything that moves included."""
        return float(sum(inertia.mass for inertia in self.pin.inertias))

    def passive_forces(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the generalised forces (nv,) of springs, dampers and nonlinear effects."""
        tau = np.zeros(self.nv)
        self.add_passive_forces(t, q, v, tau)
        return tau

    def add_passive_forces(
        self, t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray, *, inertial: bool = True
    ) -> None:
        """Add the forces of springs, dampers and nonlinear effects to tau (nv,), the applied forces.

        ``inertial=False`` leaves out `InertialForces`, which hold where no motion is prescribed.
        """
        for term in self.loads:
            term(t, q, v, tau)
        tau[self.spring_v] -= self.stiffness * q[self.spring_q] + self.damping * v[self.spring_v]
        for term in self.forces:
            if inertial or term is not self.inertial:
                term(t, q, v, tau)

    def acceleration(self, t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return vdot (nv,) under applied generalised forces tau (nv,), equations (10)-(15)."""
        total = tau.copy()
        self.add_passive_forces(t, q, v, total)
        return pin.aba(self.pin, self.data, q, v, total)

    def body_force(
        self, force: np.ndarray, torque: np.ndarray, point: np.ndarray | None = None
    ) -> np.ndarray:
        """Return the generalised force (nv,) of a force at a point of the bus and a torque, in body axes."""
        tau = np.zeros(self.nv)
        tau[0:3] = force
        tau[3:6] = torque + np.cross(self.thrust_point if point is None else point, force)
        return tau

    def momentum(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return (p, h) (6,): linear momentum (7) and angular momentum (8) about the inertial origin.

        In inertial axes [N s, N m s].
        """
        h = pin.computeCentroidalMomentum(self.pin, self.data, q, v)
        com = self.data.com[0]
        return np.concatenate([h.linear, h.angular + np.cross(com, h.linear)])

    def energy(self, q: np.ndarray, v: np.ndarray) -> float:
        """Return kinetic plus potential energy [J] at q (nq,), v (nv,).

        Of gravity and springs, not of nonlinear effects.
        """
        kinetic = pin.computeKineticEnergy(self.pin, self.data, q, v)
        gravity = pin.computePotentialEnergy(self.pin, self.data, q)
        return float(kinetic + gravity + 0.5 * self.stiffness @ q[self.spring_q] ** 2)

    def joint_angles(self, q: np.ndarray) -> np.ndarray:
        """Return the angles of the arm joints from q (..., nq): (..., joints) [rad]."""
        return group_angles(self.pin, self.arm_joints, q)

    def encoder_angles(self, q: np.ndarray) -> np.ndarray:
        """Return what encoders of the arm joints see of q (..., nq): (..., joints) [rad], motors' angles."""
        angles = self.joint_angles(q)
        for i, k, _ in self.motors:
            angles[..., i] += q[..., k]
        return angles

    def encoder_rates(self, v: np.ndarray) -> np.ndarray:
        """Return what encoders of the arm joints see of v (..., nv): (..., joints) [rad/s]."""
        rates = np.array(v[..., self.arm_joints.v])
        for i, _, k in self.motors:
            rates[..., i] += v[..., k]
        return rates

    def encoder_twist(
        self,
        times: np.ndarray,
        q: np.ndarray,
        v: np.ndarray,
        tau: np.ndarray,
        a: np.ndarray,
        held: np.ndarray | None = None,
        inverse: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return what encoders of the arm joints see of a gear that gives at once: (N, joints) [rad].

        At states q (N, nq), v (N, nv) at ``times`` (N,) [s], under applied forces ``tau`` (N, nv), with
        accelerations ``a`` (N, nv); ``held`` are coordinates that do not move, ``inverse`` (N, nv, nv) is
        M^-1 where that is known. A rotor that gets ahead by phi leaves all else behind, as no force from
        outside does it: by ``M^-1 r I phi``, where r is the derivative of its rate by v.
        """
        ahead, behind = np.zeros((len(q), len(self.arm_joints))), np.zeros((len(q), self.nv))
        for i, k, twist in self.twists:
            along, drift = np.zeros((len(q), self.nv)), 0.0
            along[:, k] = 1.0
            if twist.turning is not None:
                turning = [twist.turning(*state) for state in zip(q, v, strict=True)]
                along, drift = np.array([x for x, _ in turning]), np.array([x for _, x in turning])
            angle = twist.angle(tau[:, k] - twist.inertia * (np.einsum("nk,nk->n", along, a) + drift))
            ahead[:, i] = angle if twist.read else 0.0
            behind += (twist.inertia * angle)[:, None] * along
        if not behind.any():
            return ahead
        if inverse is None:
            inverse = np.array([self._inverse_mass(*state, held) for state in zip(times, q, v, strict=True)])
        return ahead - np.matmul(inverse[:, self.arm_joints.v], behind[:, :, None])[:, :, 0]

    def _inverse_mass(self, t: float, q: np.ndarray, v: np.ndarray, held: np.ndarray | None) -> np.ndarray:
        """Return M^-1 (nv, nv) at a state; rows and columns of what is ``held`` are zero."""
        mass = pin.crba(self.pin, self.data, q)  # its upper triangle
        if self.inertial is not None:
            mass = mass + self.inertial.mass_and_bias(t, q, v)[0]
        free = np.ones(self.nv) if held is None else np.bincount(held, minlength=self.nv) == 0
        free = np.outer(free, free)
        return free * lapack.dposv(np.where(free, mass, np.eye(self.nv)), np.eye(self.nv))[1]

    @property
    def joint_limits(self) -> JointLimits:
        """Limits of the arm joints."""
        return JointLimits.of(self.pin, self.arm_joints)

    def set_joint_angles(self, q: np.ndarray, angles: np.ndarray) -> np.ndarray:
        """Return copies (..., nq) of q (nq,) with the arm joints at angles (..., joints)."""
        return set_group_angles(self.arm_joints, q, angles)


def group_angles(model: pin.Model, group: JointGroup, q: np.ndarray) -> np.ndarray:
    """Return the angles of a group of joints, also those stored as (cos, sin)."""
    q = np.asarray(q)
    out = np.empty((*q.shape[:-1], len(group)))
    for i, (j, k) in enumerate(zip(group.joints, group.q, strict=True)):
        out[..., i] = q[..., k] if model.joints[int(j)].nq == 1 else np.arctan2(q[..., k + 1], q[..., k])
    return out


def set_group_angles(group: JointGroup, q: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return copies (..., nq) of q (nq,), or one for each, with a group's joints at angles (..., joints)."""
    angles = np.asarray(angles, dtype=float)
    out = np.empty((*angles.shape[:-1], q.shape[-1]))
    out[...] = q
    if not group.endless.any():
        out[..., group.q] = angles
        return out
    plain, turned = ~group.endless, angles[..., group.endless]
    out[..., group.q[plain]] = angles[..., plain]
    out[..., group.q[group.endless]], out[..., group.q[group.endless] + 1] = np.cos(turned), np.sin(turned)
    return out


@dataclass(frozen=True)
class JointLimits:
    """Limits of joints, each (joints,): angle [rad | m], rate and torque; infinite where none is stated."""

    lower: np.ndarray
    upper: np.ndarray
    rate: np.ndarray
    effort: np.ndarray

    @classmethod
    def of(cls, model: pin.Model, group: JointGroup) -> JointLimits:
        """Return what the URDF states; equal limits of the angle, and zero, state nothing."""
        lower, upper = model.lowerPositionLimit[group.q], model.upperPositionLimit[group.q]
        ends = np.array([model.joints[j].nq == 1 for j in group.joints.tolist()], dtype=bool)
        ends &= np.isfinite(lower) & np.isfinite(upper) & (lower < upper)
        rate, effort = (
            np.where((x > 0.0) & (x < 1e20), x, np.inf)
            for x in (model.velocityLimit[group.v], model.effortLimit[group.v])
        )
        return cls(np.where(ends, lower, -np.inf), np.where(ends, upper, np.inf), rate, effort)


SLACK = 1e-9  # [rad | m]


@dataclass(frozen=True)
class OutsideLimits:
    """A joint beyond its limits: its number in the group, name, value and limits [rad | m]."""

    index: int
    name: str
    value: float
    lower: float
    upper: float

    @property
    def middle(self) -> float:
        """The middle of the limits."""
        return (self.lower + self.upper) / 2

    def __str__(self) -> str:
        return f"home {self.value:.4g} is outside {self.lower:.4g} .. {self.upper:.4g}"


def outside_limits(model: pin.Model, group: JointGroup, angles: np.ndarray) -> tuple[OutsideLimits, ...]:
    """Return the joints of a group whose angles (joints,) are beyond their limits; joints without limits and
    those with equal ones are left out.
    """
    limits = JointLimits.of(model, group)
    outside = (angles < limits.lower - SLACK) | (angles > limits.upper + SLACK)
    return tuple(
        OutsideLimits(i, group.names[i], float(angles[i]), float(limits.lower[i]), float(limits.upper[i]))
        for i in np.flatnonzero(outside).tolist()
    )


def motion_columns(model: pin.Model, joint: int) -> np.ndarray:
    """Return what a joint's coordinates move its body by (6, nv), linear parts first, in the joint's axes."""
    own, data = model.joints[joint], model.joints[joint].createData()
    own.calc(data, pin.neutral(model))
    return np.asarray(data.S).reshape(6, -1)
