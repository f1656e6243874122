"""A spacecraft as the arrays that the compiled kernel takes, and whether it can be used.

The kernel knows rigid bodies in a tree of hinges and slides, springs and dampers on them, weight, and forces
that say which of its laws they follow. A model with others goes the plain way, over Pinocchio, as does
everything where numba is missing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
import pinocchio as pin

from smsid.kernel import columns as c
from smsid.kernel._forces import LAW, LAWS
from smsid.kernel.jit import available
from smsid.model.spacecraft import SpacecraftModel

KINDS = {
    "JointModelRevoluteUnaligned": c.HINGE,
    "JointModelPrismaticUnaligned": c.SLIDE,
    "JointModelRevoluteUnboundedUnaligned": c.ENDLESS,
    **{f"JointModelR{axis}": c.HINGE for axis in "XYZ"},
    **{f"JointModelP{axis}": c.SLIDE for axis in "XYZ"},
    **{f"JointModelRUB{axis}": c.ENDLESS for axis in "XYZ"},
}
SAME = 1e-14  # share by which the inertia of a balanced rotor may change as it turns


@runtime_checkable
class Force(Protocol):
    """A force that follows one of the `smsid.kernel._forces.LAWS`, with its ``numbers`` there, on the degrees
    of freedom ``rows`` of v, from ``start`` [s] on.
    """

    law: str
    rows: Sequence[int]
    start: float
    numbers: np.ndarray

    def by_load(self) -> float:
        """Return how much of it goes by the applied force."""
        ...


@runtime_checkable
class Beam(Protocol):
    """A beam that grows shorter as it bends: the joint that carries it and where, places of its modes in v
    with their scales (n,), and of N points along it masses, places x and stiffnesses (N,), shapes (N, n) and
    the matrices of how far they are drawn in and of its curvature (N, n, n).
    """

    parent: int
    placement: pin.SE3
    v: np.ndarray
    scale: np.ndarray
    mass: np.ndarray
    x: np.ndarray
    stiffness: np.ndarray
    shape: np.ndarray
    drawn: np.ndarray
    curved: np.ndarray


@runtime_checkable
class Growth(Protocol):
    """Inertial parameters of a ``joint``'s body, in its axes, that grow by ``growth`` (10,) a second from
    ``begun`` [s] on.
    """

    joint: int
    growth: np.ndarray
    begun: float


@runtime_checkable
class RotorTerm(Protocol):
    """A rotor of an ``inertia`` [kg m^2] seen at a ``joint`` whose place in v is ``link``, with the twist of
    its gear at ``gear`` in v or ``None``, a share ``carried`` round by the body before the joint; ``in_link``
    says whether the link counts it already.
    """

    joint: int
    link: int
    gear: int | None
    inertia: float
    carried: float
    in_link: bool


@dataclass(frozen=True)
class Kernel:
    """The arrays of a spacecraft: ``tree`` (n, 5), ``bodies`` (n, 28), ``root`` (26 + ...,), see the columns
    there.

    A rotation, position, axis and inertia are in the axes of the joint's parent, joint axes at rest; where
    nothing turns a body against the bus, in bus axes.
    """

    tree: np.ndarray
    bodies: np.ndarray
    root: np.ndarray

    @classmethod
    def of(cls, model: SpacecraftModel) -> Kernel | None:
        """Return the kernel of a model, or ``None`` where the plain way has to be taken."""
        return arrays_of(model, terms=(*model.loads, *model.forces)) if available() else None

    def moves_like(self, other: Kernel) -> bool:
        """Whether bodies and all that goes with their accelerations are the same in another, though springs,
        dampers and other forces may differ.
        """
        pairs = [
            (
                x.tree,
                x.bodies[:, : c.STIFFNESS],
                x.root[: c.FORCES],
                x.root[c.ROTORS],
                _tables_of_bodies(x.root),
            )
            for x in (self, other)
        ]
        return all(np.array_equal(*both) for both in zip(*pairs, strict=True))

    @property
    def arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The first arguments of what is compiled: tree (n, 5), bodies (n, 28), root (26 + ...,)."""
        return self.tree, self.bodies, self.root


def arrays_of(
    model: SpacecraftModel,
    bodies: pin.Model | None = None,
    terms: Sequence[object] = (),
    *,
    balanced: bool = True,
) -> Kernel | None:
    """Return the arrays of a model, ``None`` for joints, springs or ``terms`` that the kernel does not know.

    ``bodies`` stand for the model's own; of nonlinear terms it knows `Force`, `Beam`, `Growth` and
    `RotorTerm`. ``balanced=False``: as `tree_of`.
    """
    growing = [x for x in terms if isinstance(x, Growth)]
    found = tree_of(bodies or model.pin, model.free, balanced=balanced and not growing)
    start = 6 if model.free else 0
    if found is None or np.any(model.spring_v < start):
        return None
    found.bodies[model.spring_v - start, c.STIFFNESS] = model.stiffness
    found.bodies[model.spring_v - start, c.DAMPING] = model.damping
    forces = [x for x in terms if isinstance(x, Force)]
    beams = [x for x in terms if isinstance(x, Beam)]
    rotors = [x for x in terms if isinstance(x, RotorTerm)]
    loaded = [x.rows[0] for x in forces if x.by_load()]
    known = len(forces) + len(beams) + len(growing) + len(rotors)
    if known < len(terms) or len(set(loaded)) < len(loaded):  # they see each other's
        return None
    tables = [_force_table(x) for x in forces]
    tables += [_growth_table(found, bodies or model.pin, model.free, x) for x in growing]
    tables += [_beam_table(found, bodies or model.pin, start, x) for x in beams]
    tables += [_rotor_table(found, start, x) for x in rotors]
    root = np.concatenate([found.root, *tables])
    root[c.FORCES], root[c.BEAMS], root[c.ROTORS] = len(forces) + len(growing), len(beams), len(rotors)
    return replace(found, root=root)


def _tables_of_bodies(root: np.ndarray) -> np.ndarray:
    """Return the tables of a root that go with inertia: of tides, growth, beams and rotors."""
    kept, at = [], c.FIRST
    for _ in range(int(root[c.FORCES])):
        table = root[at : at + int(root[at])]
        at += len(table)
        if LAWS[int(table[LAW])] in ("tide", "growth"):
            kept.append(table)
    return np.concatenate([*kept, root[at:]])


def _force_table(force: Force) -> np.ndarray:
    """Return a force as `smsid.kernel._forces` has it."""
    table = np.r_[LAWS.index(force.law), force.start, len(force.rows), force.rows, force.numbers]
    return np.r_[len(table) + 1.0, table]


def _growth_table(own: Kernel, m: pin.Model, free: bool, term: Growth) -> np.ndarray:
    """Return inertia that grows as `smsid.kernel._forces` has it."""
    row = row_of(m, free, term.joint)
    growth = term.growth if row < 0 else in_axes_of_table(own, row, term.growth)
    table = np.r_[LAWS.index("growth"), term.begun, 0, row, 0.0, growth]
    return np.r_[len(table) + 1.0, table]


def row_of(m: pin.Model, free: bool, joint: int) -> int:
    """Return the row of a joint's body, -1 for the bus: of several degrees of freedom the last carries it."""
    return -1 if free and joint == 1 else int(m.idx_vs[joint] + m.nvs[joint] - 1 - (6 if free else 0))


def in_axes_of_table(own: Kernel, row: int, theta: np.ndarray) -> np.ndarray:
    """Return inertial parameters (10,) of the body of a row in the axes that the tables have them in."""
    if own.tree[row, c.TURNING] > 0:
        return theta
    turn = own.bodies[row, c.ROTATION : c.ROTATION + 9].reshape(3, 3)
    xx, xy, yy, xz, yz, zz = theta[4:]
    about = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
    return np.r_[theta[0], turn @ theta[1:4], about[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]]


def _beam_table(own: Kernel, m: pin.Model, start: int, beam: Beam) -> np.ndarray:
    """Return a beam as `smsid.kernel._beams` has it."""
    row = int(m.idx_vs[beam.parent] + m.nvs[beam.parent] - 1 - start) if beam.parent else -1
    still = row >= 0 and not own.tree[row, c.TURNING]  # what it carries is in bus axes then
    turn = own.bodies[row, c.ROTATION : c.ROTATION + 9].reshape(3, 3) if still else np.eye(3)
    place = beam.placement
    placed = np.r_[(turn @ place.rotation).ravel(), turn @ place.translation]
    numbers = [placed, beam.v - start, beam.scale, beam.mass, beam.x, beam.stiffness]
    numbers += [beam.shape, beam.drawn, beam.curved]
    own.tree[beam.v[1:] - start, c.COUPLED] = beam.v[:-1] - start
    table = np.concatenate([np.ravel(x) for x in numbers])
    return np.r_[len(table) + 4.0, max(row, -1.0), len(beam.v), len(beam.x), table]


def _rotor_table(own: Kernel, start: int, rotor: RotorTerm) -> np.ndarray:
    """Return a rotor as `smsid.kernel._rotors` has it; what a body and an armature have of it, they get."""
    row, twist = rotor.link - start, -1 if rotor.gear is None else rotor.gear - start
    parent, counted = own.tree[row, c.PARENT], 0.0 if rotor.in_link else 1.0
    own.bodies[row, c.ARMATURE] += counted * rotor.inertia
    if twist >= 0:  # it comes after the joint, at no place of its own
        own.tree[twist, c.PARENT], own.tree[twist, c.COUPLED] = parent, row
    turn = own.bodies[row, c.ROTATION : c.ROTATION + 9].reshape(3, 3)
    x, y, z = (
        turn @ own.bodies[row, c.AXIS : c.AXIS + 3]
        if own.tree[row, c.TURNING]
        else own.bodies[row, c.AXIS : c.AXIS + 3]
    )
    about = counted * rotor.carried**2 * rotor.inertia * np.array([x * x, x * y, y * y, x * z, y * z, z * z])
    if parent >= 0:
        own.bodies[parent, c.INERTIA : c.INERTIA + 6] += about
    elif own.root[c.FREE]:
        own.root[4:10] += about
    return np.array([6.0, row, twist, rotor.inertia, rotor.carried, counted])


def tree_of(m: pin.Model, free: bool, *, balanced: bool = True) -> Kernel | None:
    """Return the arrays of a Pinocchio model, whose first joint is a free-flyer or not, without springs.

    A rotor that is balanced need not be turned; ``balanced=False`` turns all, whatever their inertia is.
    """
    first = 2 if free else 1
    root = np.zeros(c.FIRST)
    root[c.GRAVITY : c.GRAVITY + 3] = m.gravity.linear
    root[c.FREE] = float(free)
    if free:
        root[:10] = m.inertias[1].toDynamicParameters()
    rows: list[np.ndarray] = []
    tree: list[list[int]] = []
    last: dict[int, int] = {0: -1, 1: -1} if free else {0: -1}  # row of a joint's body
    parents = {int(p) for p in list(m.parents)[first:]}
    for j in range(first, m.njoints):
        joint = m.joints[j]
        steps = _single(joint)
        if steps is None:
            return None
        above = last[m.parents[j]]
        for k, (kind, axis) in enumerate(steps):
            row = np.zeros(c.COLUMNS)
            placement = m.jointPlacements[j] if k == 0 else pin.SE3.Identity()
            theta = m.inertias[j].toDynamicParameters() if k == len(steps) - 1 else np.zeros(10)
            row[c.ROTATION : c.ROTATION + 9] = placement.rotation.ravel()
            row[c.POSITION : c.POSITION + 3] = placement.translation
            row[c.AXIS : c.AXIS + 3] = axis
            row[c.MASS : c.MASS + 10] = theta
            row[c.ARMATURE] = m.armature[joint.idx_v + k]
            still = balanced and j not in parents and _is_balanced(axis, theta)
            turns = kind != c.SLIDE and not still
            turning = turns or (above >= 0 and tree[above][c.TURNING] > 0)
            tree.append([above, kind, joint.idx_q + k, int(turning), above])
            rows.append(row)
            above = len(rows) - 1
        last[j] = above
    table = np.array(rows).reshape(-1, c.COLUMNS)
    links = np.array(tree, dtype=np.int64).reshape(-1, 5)
    _to_bus_axes(links, table)
    return Kernel(links, table, root)


def _single(joint: pin.JointModel) -> list[tuple[int, np.ndarray]] | None:
    """Return the kinds and axes (3,) of joints of one degree of freedom that make up a joint."""
    name = joint.shortname()
    if name == "JointModelTranslation":
        return [(c.SLIDE, axis) for axis in np.eye(3)]
    if name not in KINDS:
        return None
    data = joint.createData()
    joint.calc(data, np.r_[1.0, 0.0] if joint.nq == 2 else np.zeros(1))
    motion = np.asarray(data.S).reshape(6)
    return [(KINDS[name], motion[:3] if KINDS[name] == c.SLIDE else motion[3:])]


def _is_balanced(axis: np.ndarray, theta: np.ndarray) -> bool:
    """Return whether inertial parameters (10,) stay what they are when the body turns about its axis."""
    turned = pin.AngleAxis(1.0, axis).toRotationMatrix()
    xx, xy, yy, xz, yz, zz = theta[4:]
    about = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    gap = max(np.abs(turned @ about @ turned.T - about).max(), np.abs(turned @ theta[1:4] - theta[1:4]).max())
    return bool(gap <= SAME * np.abs(theta).max())


def _to_bus_axes(tree: np.ndarray, table: np.ndarray) -> None:
    """Put into bus axes what does not turn against the bus, and where its children are."""
    turns = [np.eye(3)] * len(tree)
    for i, (parent, _, _, turning, _) in enumerate(tree):
        if parent >= 0 and tree[parent, c.TURNING]:
            continue
        outer = turns[parent] if parent >= 0 else np.eye(3)
        row = table[i]
        turn = outer @ row[c.ROTATION : c.ROTATION + 9].reshape(3, 3)
        row[c.ROTATION : c.ROTATION + 9] = turn.ravel()
        row[c.POSITION : c.POSITION + 3] = outer @ row[c.POSITION : c.POSITION + 3]
        turns[i] = turn
        if not turning:
            row[c.AXIS : c.AXIS + 3] = turn @ row[c.AXIS : c.AXIS + 3]
            xx, xy, yy, xz, yz, zz = row[c.INERTIA : c.INERTIA + 6]
            about = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
            row[c.MOMENT : c.MOMENT + 3] = turn @ row[c.MOMENT : c.MOMENT + 3]
            row[c.INERTIA : c.INERTIA + 6] = about[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
