"""Putting a Pinocchio model together: mounted arms, wheels, and the joints that effects add."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import pinocchio as pin

from smsid._listing import did_you_mean
from smsid.effects.force_laws import Depends, ForceLaw
from smsid.effects.inertial_parameters import inertia_from_parameters, move_parameters, pinocchio_inertia
from smsid.errors import DescriptionError

if TYPE_CHECKING:
    from smsid.effects.appendage import Appendage
    from smsid.effects.base import Effect
    from smsid.effects.slosh import Slosh

CARRIED = 1e-3  # [kg] taken off the bus for a wheel's imbalance to have a mass


ForceTerm = Callable[[float, np.ndarray, np.ndarray, np.ndarray], None]
"""Nonlinear generalised force: called with (t, q, v, tau), adds to tau (nv,) in place.

tau holds the applied forces and what terms before it added."""

InertiaTerm = Callable[[float, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Inertia that no body of the model has: called with (t, q, v), returns what it adds to the mass matrix
(nv, nv) and to the nonlinear effects (nv,) (Coriolis, centrifugal, weight)."""


@dataclass(frozen=True)
class Twist:
    """A gear that gives at once: by ``angle(torque)`` [rad] under the torque handed on to the link.

    ``numbers`` are those of this law as `smsid.kernel.readings.bent` has it. The torque is the motor's less
    ``inertia`` [kg m^2] of the rotor times its acceleration. The rotor's rate is the joint's, or
    ``turning(q, v)`` says what it is: its derivative by v (nv,), and what its acceleration is where v stays.
    ``gear`` is the effect it is of, which tells two of them apart. An encoder that is not
    on the motor's side (``read``) sees by how much the link is left behind, and not the twist.
    """

    gear: Effect
    angle: Callable[[np.ndarray], np.ndarray] = field(compare=False)
    numbers: tuple[float, float, float, float] = field(compare=False)
    inertia: float
    turning: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, float]] | None = field(
        default=None, compare=False
    )
    read: bool = True


Term = TypeVar("Term", ForceTerm, InertiaTerm)


@dataclass(frozen=True)
class FurtherMode:
    """A mode that another effect adds to an appendage: its number, its joint, and how far that moves the
    stations (stations, 3) by its coordinate, appendage axes.
    """

    number: int
    joint: int
    moved: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class AppendageJoints:
    """Where an appendage's modes are: joints, and ``scale`` with delta = scale * joint coordinate.

    ``drawn`` (stations, modes, modes) [1/(kg m)] says how far bending draws the stations in along the
    appendage's x axis, ``-1/2 delta' drawn delta`` [m]; ``None``: not at all. ``more`` are modes that other
    effects add.
    """

    appendage: Appendage
    parent: int
    placement: pin.SE3  # root axes in the parent joint's frame
    joints: tuple[int, ...]
    scale: np.ndarray
    drawn: np.ndarray | None = None
    more: tuple[FurtherMode, ...] = ()

    @property
    def seen(self) -> tuple[int, ...]:
        """Joints that move the stations."""
        return (*self.joints, *(m.joint for m in self.more))

    def with_mode(self, number: int, joint: int, moved: tuple[tuple[float, ...], ...]) -> AppendageJoints:
        """Return it with one mode more, that another effect adds."""
        return replace(self, more=(*self.more, FurtherMode(number, joint, moved)))

    def moved(self, station: int) -> np.ndarray:
        """Return how far every joint that is seen moves a station, by its coordinate: (joints, 3), axes of
        the parent joint.
        """
        own = np.array([m.shape[station] for m in self.appendage.modal_data()]).reshape(-1, 3)
        further = np.array([m.moved[station] for m in self.more]).reshape(-1, 3)
        return np.vstack([own * self.scale[:, None], further]) @ self.placement.rotation.T


@dataclass(frozen=True, eq=False)
class AttachedForce:
    """A force with the coordinates it depends on (``None``: all), which does not act before ``start`` [s]."""

    term: ForceTerm
    depends: Depends | None
    start: float

    def __call__(self, t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
        """Add it to tau (nv,)."""
        if t >= self.start:
            self.term(t, q, v, tau)


@dataclass
class Assembly:
    """A Pinocchio model under construction. Effects use its methods, never the model's own."""

    model: pin.Model
    base: int  # joint that carries the bus: 1 for a free-flyer, 0 when welded
    thrusters: tuple[str, ...] = ()  # single thrusters by name
    trusted: frozenset[str] = frozenset()  # joints whose bodies' inertia is taken as it is
    springs: list[tuple[int, int, float, float]] = field(default_factory=list)  # joint, axis, k, d
    forces: list[ForceTerm] = field(default_factory=list)
    loads: list[ForceTerm] = field(default_factory=list)  # called first: tau is the applied force alone
    inertias: list[InertiaTerm] = field(default_factory=list)
    owner: Effect | None = None  # effect that is being attached
    owned: list[tuple[str, ForceTerm | InertiaTerm]] = field(
        default_factory=list
    )  # loads, forces, inertias by effect
    breakpoints: list[float] = field(default_factory=list)  # times at which a force jumps [s]
    motors: dict[int, int] = field(default_factory=dict)  # joint: joint whose angle the encoder adds
    twists: dict[int, Twist] = field(default_factory=dict)  # joint: twist that its encoder adds at once
    slosh: dict[str, tuple[Slosh, int]] = field(default_factory=dict)  # tank and joint
    appendages: list[AppendageJoints] = field(default_factory=list)
    described: list[np.ndarray] = field(default_factory=list)  # bodies (10,) before any effect, with wheels

    def frame(self, name: str | None) -> tuple[int, pin.SE3]:
        """Return the joint that carries a frame (default: the bus) and the frame's placement on it.

        Raises `DescriptionError` if there is no such frame.
        """
        if name is None:
            return self.base, pin.SE3.Identity()
        frame = self.model.frames[find_frame(self.model, name)]
        return frame.parentJoint, frame.placement

    def joint_id(self, name: str) -> int:
        """Return the index of a joint; raises `DescriptionError` if there is none."""
        if not self.model.existJointName(name):
            known = list(self.model.names)[1:]
            raise DescriptionError(
                f"There is no joint '{name}'." + did_you_mean(name, known),
                advice=f"Joints of the model: {', '.join(known)}.",
                joint=name,
            )
        return self.model.getJointId(name)

    def joint(self, name: str) -> pin.JointModel:
        """Return a joint, with its places ``idx_q`` in q and ``idx_v`` in v; raises `DescriptionError`."""
        return self.model.joints[self.joint_id(name)]

    def add_joint(self, frame: str | None, joint: pin.JointModel, placement: pin.SE3, name: str) -> int:
        """Add a joint, and a frame of its name, at a placement in a named frame; returns its index.

        Raises `DescriptionError` if the name is taken, or there is no such frame.
        """
        parent, offset = self.frame(frame)
        if not self.model.existJointName(name):
            index = self.model.addJoint(parent, joint, offset * placement, name)
        elif self.model.existFrame(name, pin.FrameType.JOINT):
            raise DescriptionError(f"Two joints are named '{name}'.", advice="Rename the effect or wheel.")
        else:  # the model has room for it (`smsid.model._joint_order`)
            index = self.model.getJointId(name)
        self.model.addJointFrame(index)
        return index

    def add_inertia(self, joint: int, inertia: pin.Inertia) -> None:
        """Add a body's inertia, given in the joint's frame."""
        self.model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())

    def add_remainder(self, frame: str | None, theta: np.ndarray, placement: pin.SE3) -> None:
        """Add inertial parameters (10,) (see `pin.Inertia.toDynamicParameters`) that may be indefinite.

        They are given in axes at ``placement`` of the frame; what must be physical is the sum. On a welded
        bus they move nothing and are left out. Raises `DescriptionError` when the sum is not physical.
        """
        joint, offset = self.frame(frame)
        if joint == 0 or not theta.any():
            return
        total = self.model.inertias[joint].toDynamicParameters() + move_parameters(offset * placement, theta)
        name = self.model.names[joint]
        self.model.inertias[joint] = inertia_from_parameters(
            total, "bus" if joint == self.base else name, trusted=name in self.trusted
        )

    def scale_body(self, frame: str | None, factor: float) -> None:
        """Multiply the inertial parameters a body has as described, as of a wrong density.

        What other effects add to it (the root of a panel, a payload) stays what it is.
        """
        joint, _ = self.frame(frame)
        if joint and factor != 1.0:
            more = (factor - 1.0) * self.described[joint]
            total = self.model.inertias[joint].toDynamicParameters() + more
            self.model.inertias[joint] = pinocchio_inertia(total)

    def add_imbalance(self, wheel: int, theta: np.ndarray) -> None:
        """Add inertial parameters (10,) without mass, in the joint's frame, to what turns about a joint.

        The body needs mass to have a centre beside the axis. It gets some at the joint's origin, which stays
        where it is in the body that carries the joint: from there it is taken.
        """
        model, parent = self.model, self.model.parents[wheel]
        mass = np.r_[CARRIED, np.zeros(9)]
        total = model.inertias[wheel].toDynamicParameters() + theta + mass
        model.inertias[wheel] = pinocchio_inertia(total)
        if parent:
            rest = model.inertias[parent].toDynamicParameters()
            rest -= move_parameters(model.jointPlacements[wheel], mass)
            model.inertias[parent] = pinocchio_inertia(rest)

    def add_springs(self, joint: int, stiffness: Sequence[float], damping: Sequence[float]) -> None:
        """Add linear springs and dampers to a joint, one pair per degree of freedom [N/m | N m/rad, s
        times].

        They add to what the joint has already. Raises `DescriptionError` if the joint has fewer or more
        degrees of freedom.
        """
        freedom = self.model.joints[joint].nv
        if not len(stiffness) == len(damping) == freedom:
            raise DescriptionError(
                f"Joint '{self.model.names[joint]}' has {freedom} degrees of freedom, "
                f"{len(stiffness)} springs and {len(damping)} dampers were given for it.",
                advice="Give one of each per degree of freedom.",
            )
        for axis, (k, d) in enumerate(zip(stiffness, damping, strict=True)):
            self.springs.append((joint, axis, float(k), float(d)))

    def attach(self, effect: Effect) -> None:
        """Let an effect add what it adds; its forces act from its `Effect.onset` on."""
        self.owner = effect
        effect.attach(self)

    def add_force(self, term: ForceTerm, depends: Depends | None = None) -> None:
        """Add a nonlinear generalised force; one that says what it depends on is linearised faster.

        A `ForceLaw` does, and may be compiled.
        """
        self.forces.append(self._note_owner(self._attach_term(term, depends)))

    def add_load_force(self, term: ForceTerm, depends: Depends | None = None, *, first: bool = False) -> None:
        """Add a generalised force that depends on the applied ones: it finds these in tau.

        ``first`` puts it before others, as one that hands the applied forces on.
        """
        self.loads.insert(0 if first else len(self.loads), self._note_owner(self._attach_term(term, depends)))

    def add_inertia_term(self, term: InertiaTerm) -> None:
        """Add inertia that no body of the model can have: varying in time, or not of a rigid body."""
        self.inertias.append(self._note_owner(term))

    def _attach_term(self, term: ForceTerm, depends: Depends | None) -> ForceTerm:
        start = None if self.owner is None else self.owner.onset
        if isinstance(term, ForceLaw):
            term.start = term.start if start is None else start
            return term
        if start is None and depends is None:
            return term
        return AttachedForce(term, depends, -np.inf if start is None else start)

    def _note_owner(self, term: Term) -> Term:
        """Remember whose a term is, and the time at which it begins."""
        if self.owner is not None:
            self.owned.append((self.owner.name, term))
            self.breakpoints += [] if self.owner.onset is None else [self.owner.onset]
        return term

    def note_slosh(self, tank: Slosh, joint: int) -> None:
        """Remember which joint is a tank's slosh mass."""
        self.slosh[tank.name] = tank, joint

    def note_appendage(self, appendage: Appendage, joints: Sequence[int], scale: Sequence[float]) -> None:
        """Remember which joints are the modes of an appendage."""
        parent, offset = self.frame(appendage.frame)
        self.appendages.append(
            AppendageJoints(appendage, parent, offset * appendage.placement, tuple(joints), np.asarray(scale))
        )


def find_frame(model: pin.Model, name: str) -> int:
    """Return the index of a frame; where a link and a joint share the name, the link's.

    Raises `DescriptionError` if there is none.
    """
    found = [k for k, frame in enumerate(model.frames) if frame.name == name]
    if not found:
        known = [f.name for f in model.frames]
        raise DescriptionError(
            f"There is no frame '{name}'." + did_you_mean(name, known),
            advice=f"Frames of the model: {', '.join(known)}.",
            frame=name,
        )
    return next((k for k in found if model.frames[k].type == pin.FrameType.BODY), found[0])
