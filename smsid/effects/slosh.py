"""Fuel slosh as a spring-mounted point mass, equations (1), (2), (12), or under thrust as a pendulum."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pinocchio as pin
from pydantic import Field, model_validator

from smsid.effects.assembly import Assembly
from smsid.effects.base import Effect, Starting, Vector3, physical, register
from smsid.effects.force_laws import CentralForce
from smsid.effects.payload import point_parameters
from smsid.errors import DescriptionError


@register
class Slosh(Effect):
    """A point mass on springs and dampers along the axes of the frame it is mounted in.

    ``position`` is its equilibrium c_s in ``frame`` (default: the bus frame) [m].
    """

    nominal = True
    family = "slosh"
    by_batch = True
    aliases = ("body_error",)
    strength = ()
    summary = "fuel slosh: a spring-mounted point mass with three degrees of freedom"
    changes = {
        "mass": ("more propellant sloshes in it", "less propellant sloshes in it"),
        "stiffness": ("its propellant is held more stiffly", "its propellant is held less stiffly"),
        "damping": ("its slosh is damped more", "its slosh is damped less"),
    }
    in_words = "the fuel in {place} moves otherwise than described: {shape}"
    kind: Literal["slosh"] = "slosh"
    frame: str | None = Field(default=None, description="frame it is in; the bus frame when not given")
    position: Vector3 = Field(description="equilibrium c_s of the mass in `frame` [m]")
    offset: Vector3 | None = physical(
        "m", default=None, description="of the equilibrium from `position`, where that is uncertain"
    )
    mass: float = physical(
        "kg", lower=0.0, gt=0.0, description="m_s, beside the mass of the body that carries it"
    )
    stiffness: Vector3 = physical("N/m", lower=0.0, description="of the springs along the axes of `frame`")
    damping: Vector3 = physical(
        "N s/m", lower=0.0, may_vanish=True, description="of the dampers along the axes of `frame`"
    )
    mass_in_bus: bool = Field(
        default=False, description="whether the body that carries it counts the mass already; it is taken out"
    )

    @property
    def equilibrium(self) -> np.ndarray:
        """c_s (3,) in `frame` [m]."""
        return np.asarray(self.position) + (0.0 if self.offset is None else np.asarray(self.offset))

    def propellant_at(self) -> tuple[str | None, np.ndarray]:
        """Return the frame and c_s (3,) in it [m]."""
        return self.frame, self.equilibrium

    def attach(self, assembly: Assembly) -> None:
        """Add a translation joint carrying the point mass, with its springs and dampers."""
        placement = pin.SE3(np.eye(3), self.equilibrium)
        joint = assembly.add_joint(self.frame, pin.JointModelTranslation(), placement, self.name)
        assembly.add_inertia(joint, pin.Inertia(self.mass, np.zeros(3), np.zeros((3, 3))))
        assembly.add_springs(joint, self.stiffness, self.damping)
        assembly.note_slosh(self, joint)
        if self.mass_in_bus:
            assembly.add_remainder(self.frame, point_parameters(-self.mass, np.zeros(3)), placement)


class TankEffect(Starting):
    """An effect on the slosh mass of a tank that stands before it."""

    family = "slosh"
    tank: str = Field(description="name of the `slosh` effect, which stands before this one")

    def part_of(self) -> str:
        """Return the tank."""
        return self.tank

    def coordinates(self, assembly: Assembly) -> tuple[range, range]:
        """Return where the slosh mass is in q and in v; raises `DescriptionError` without the tank."""
        if self.tank not in assembly.slosh:
            raise DescriptionError(
                f"There is no tank '{self.tank}' before this effect.",
                advice=f"Tanks so far: {', '.join(assembly.slosh) or 'none'}.",
                tank=self.tank,
            )
        joint = assembly.model.joints[assembly.slosh[self.tank][1]]
        return range(joint.idx_q, joint.idx_q + 3), range(joint.idx_v, joint.idx_v + 3)


@register
class SloshNonlinearity(TankEffect):
    """What a tank's slosh does at large amplitude: force ``-cubic |r|^2 r - quadratic_damping |r'| r'``.

    r is the displacement of the slosh mass from c_s. ``cubic`` is positive for a spring that hardens. With
    ``law = "per_axis"`` each axis of the tank's frame has the force by itself, ``-cubic x^3`` along x.
    """

    summary = "spring and damping of a slosh mass that depend on amplitude"
    aliases = ("slosh",)
    strength = ("cubic", "quadratic_damping")
    # a spring sets a frequency: likely within an octave of what it is, and nowhere else
    strong = {"cubic": tuple(np.geomspace(30.0, 3e4, 11)), "quadratic_damping": (30.0, 300.0)}
    in_words = "the fuel in {place} moves non-linearly: {shape}"
    kind: Literal["slosh_nonlinearity"] = "slosh_nonlinearity"
    law: Literal["radial", "per_axis"] = Field(
        default="radial", description="by the distance from c_s, or every axis by itself"
    )
    cubic: float = physical("N/m^3", default=0.0, description="of the spring; negative when it softens")
    quadratic_damping: float = physical(
        "N s^2/m^2", lower=0.0, may_vanish=True, default=0.0, description="of the damper"
    )

    def attach(self, assembly: Assembly) -> None:
        """Add the force on the slosh mass; raises `DescriptionError` without the tank."""
        place, rate = self.coordinates(assembly)
        if self.cubic or self.quadratic_damping:
            sizes = {"cubic": self.cubic, "quadratic": self.quadratic_damping}
            assembly.add_force(CentralForce(rate, place, apart=self.law == "per_axis", **sizes))


@register
class SloshWall(TankEffect):
    """The wall of a tank: beyond ``gap`` from c_s the slosh mass is pushed back, ``-stiffness (|r| - gap)``
    along r, its displacement.

    Source: Abramson, NASA SP-106 (1966), chapter 3, on motion that the walls limit; the contact as a spring.
    """

    summary = "wall of a tank, which limits how far its slosh mass moves"
    aliases = ("slosh_nonlinearity", "slosh")
    strength = ("stiffness",)
    in_words = "the fuel in {place} reaches the wall of its tank"
    kind: Literal["slosh_wall"] = "slosh_wall"
    gap: float = physical("m", lower=0.0, default=0.1, description="room about c_s before the wall")
    stiffness: float = physical("N/m", lower=0.0, default=0.0, description="of the contact")

    def attach(self, assembly: Assembly) -> None:
        """Add the force on the slosh mass; raises `DescriptionError` without the tank."""
        place, rate = self.coordinates(assembly)
        if self.stiffness:
            assembly.add_force(CentralForce(rate, place, gap=self.gap, stiffness=self.stiffness))


@register
class SloshPendulum(Effect):
    """A point mass on a rod without mass, free to swing about ``pivot`` in all directions.

    At rest it hangs from the pivot against ``direction``, along which thrust accelerates the spacecraft by
    a: small swings then have the frequency ``sqrt(a / length)`` where the spacecraft is heavy, large ones
    that of a pendulum. Without thrust only ``stiffness`` (of surface tension or a membrane) brings it back.
    Its two angles are about axes across, springs and dampers linear in them: swings stay well below 90
    degrees. Sources: Abramson, NASA SP-106
    (1966), chapter 6; Dodge, The New Dynamic Behavior of Liquids in Moving Containers (2000), chapter 3.
    """

    nominal = True
    family = "slosh"
    aliases = ("slosh", "body_error")
    summary = "fuel slosh under thrust: a pendulum, as stiff as the acceleration makes it"
    changes = {
        "mass": ("more propellant sloshes in it", "less propellant sloshes in it"),
        "length": ("its slosh is slower under thrust", "its slosh is faster under thrust"),
        "stiffness": ("its propellant is held more stiffly", "its propellant is held less stiffly"),
        "damping": ("its slosh is damped more", "its slosh is damped less"),
    }
    in_words = "the fuel in {place} swings otherwise than described: {shape}"
    kind: Literal["slosh_pendulum"] = "slosh_pendulum"
    frame: str | None = Field(default=None, description="frame it is in; the bus frame when not given")
    pivot: Vector3 = Field(description="point about which it swings, in `frame` [m]")
    direction: Vector3 = Field(
        default=(0.0, 0.0, 1.0),
        description="from the mass at rest to the pivot, along the thrust; in `frame`",
    )
    mass: float = physical("kg", lower=0.0, gt=0.0, description="that sloshes, beside that of the body")
    length: float = physical("m", lower=0.0, gt=0.0, description="from the pivot to the mass")
    damping: float = physical(
        "N m s/rad", lower=0.0, may_vanish=True, default=0.0, description="about the pivot"
    )
    stiffness: float = physical(
        "N m/rad", lower=0.0, default=0.0, description="about the pivot, without thrust"
    )
    mass_in_bus: bool = Field(
        default=False,
        description="whether the body that carries it counts the mass already: it is taken out at its rest",
    )

    @model_validator(mode="after")
    def _points_somewhere(self) -> SloshPendulum:
        if not any(self.direction):
            raise ValueError("`direction` must not be zero")
        return self

    @property
    def equilibrium(self) -> np.ndarray:
        """Where the mass rests under thrust (3,), in `frame` [m]."""
        return np.asarray(self.pivot) - self.length * self._axes()[:, 2]

    def _axes(self) -> np.ndarray:
        """Return two axes across and the direction (3, 3), as columns, right-handed."""
        along = np.asarray(self.direction) / np.linalg.norm(self.direction)
        first = np.eye(3)[np.argmin(np.abs(along))]
        first = first - along * (along @ first)
        first /= np.linalg.norm(first)
        return np.column_stack([first, np.cross(along, first), along])

    def propellant_at(self) -> tuple[str | None, np.ndarray]:
        """Return the frame and where the mass rests (3,) in it [m]."""
        return self.frame, self.equilibrium

    def attach(self, assembly: Assembly) -> None:
        """Add two hinges that cross in the pivot, and the mass on its rod."""
        placement = pin.SE3(self._axes(), np.asarray(self.pivot))
        hinge = f"{self.name}.hinge"
        outer = assembly.add_joint(self.frame, pin.JointModelRX(), placement, hinge)
        inner = assembly.add_joint(hinge, pin.JointModelRY(), pin.SE3.Identity(), self.name)
        at = np.array([0.0, 0.0, -self.length])
        assembly.add_inertia(inner, pin.Inertia(self.mass, at, np.zeros((3, 3))))
        for joint in (outer, inner):
            assembly.add_springs(joint, (self.stiffness,), (self.damping,))
        if self.mass_in_bus:
            rest = pin.SE3(np.eye(3), self.equilibrium)
            assembly.add_remainder(self.frame, point_parameters(-self.mass, np.zeros(3)), rest)
