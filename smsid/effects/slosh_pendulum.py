"""Fuel slosh under thrust as a pendulum: its frequency goes with the root of the acceleration."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pinocchio as pin
from pydantic import Field, model_validator

from smsid.effects.assembly import Assembly
from smsid.effects.base import Effect, Vector3, physical, register
from smsid.effects.payload import point_parameters


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
    damping: float = physical("N m s/rad", lower=0.0, default=0.0, description="about the pivot")
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
