"""What acts from outside: a constant force or torque, the gradient of gravity, gravity that leans."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from pydantic import Field, model_validator

from smsid.effects.assembly import Assembly
from smsid.effects.base import Effect, Starting, Vector3, physical, register
from smsid.effects.force_laws import ConstantForce, Depends, ForceLaw, InertialWrench
from smsid.errors import DescriptionError

TWISTED = np.zeros((9, 3))  # the vector of a matrix's antisymmetric part: yz - zy, zx - xz, xy - yx
TWISTED[[5, 6, 1], [0, 1, 2]], TWISTED[[7, 2, 3], [0, 1, 2]] = 1.0, -1.0


def _must_float(assembly: Assembly, what: str) -> None:
    if assembly.base == 0:
        raise DescriptionError(f"{what} does nothing to a welded bus.", advice="Remove the effect.")


@register
class ExternalWrench(Starting):
    """A constant force and torque on the bus: a leak, solar pressure, a residual dipole.

    The force acts at ``point`` of the bus; force and torque are constant in body or in inertial axes.
    """

    summary = "constant force and torque on the bus, fixed to the bus or in inertial axes"
    family = "external"
    aliases = ("sensor_bias", "gravity_gradient")
    strength = ("force", "torque")
    in_words = "something outside pushes or turns {place}: a {shape}"
    kind: Literal["external_wrench"] = "external_wrench"
    force: Vector3 = physical("N", default=(0.0, 0.0, 0.0), description="along the axes of `frame`")
    torque: Vector3 = physical("N m", default=(0.0, 0.0, 0.0), description="along the axes of `frame`")
    frame: Literal["body", "inertial"] = Field(default="body", description="axes: `body` or `inertial`")
    point: Vector3 = Field(default=(0.0, 0.0, 0.0), description="where the force acts, bus frame [m]")

    def attach(self, assembly: Assembly) -> None:
        """Add the wrench; raises `DescriptionError` on a welded bus."""
        _must_float(assembly, "An external wrench")
        force, torque, point = (np.asarray(x) for x in (self.force, self.torque, self.point))
        if not (force.any() or torque.any()):
            return
        if self.frame == "inertial":
            assembly.add_force(InertialWrench(force, torque, point))
        else:
            assembly.add_force(ConstantForce(range(6), np.r_[force, torque + np.cross(point, force)]))


@register
class GravityGradient(Effect):
    """Gravity that differs over the spacecraft, on a circular orbit about its system centre of mass.

    The inertial frame falls with the orbit. A mass at d from the centre of mass feels ``gradient (3 (d . r) r
    - d)`` per mass, with r the unit vector of the local vertical, which turns about ``normal`` at the
    orbital rate: ``gradient`` is the square of that rate (1.2e-6 1/s^2 in low Earth orbit). ``rate`` [rad/s]
    may be given instead. ``turn`` is a rotation vector by which nadir and normal are off, in inertial axes.
    The total force is zero; the torque on a rigid body is ``3 gradient r x I r``.

    Source: Hughes, Spacecraft Attitude Dynamics (1986), section 8.1; here on every body.
    """

    summary = "gravity gradient on every body, circular orbit"
    family = "external"
    aliases = ("external_wrench",)
    strength = ("gradient",)
    in_words = "the gravity gradient turns {place}"
    kind: Literal["gravity_gradient"] = "gravity_gradient"
    gradient: float = physical(
        "1/s^2", lower=0.0, description="square of the orbital rate; `rate` [rad/s] may be given instead"
    )
    nadir: Vector3 = Field(default=(0.0, 0.0, -1.0), description="direction of nadir at t = 0, inertial axes")
    normal: Vector3 = Field(default=(0.0, 1.0, 0.0), description="normal of the orbit, inertial axes")
    turn: Vector3 = physical(
        "rad", default=(0.0, 0.0, 0.0), description="rotation vector that the orbit is turned by"
    )

    @model_validator(mode="before")
    @classmethod
    def _rate_to_gradient(cls, data: Any) -> Any:
        if isinstance(data, Mapping) and "rate" in data and "gradient" not in data:
            rest = {k: v for k, v in data.items() if k != "rate"}
            return {**rest, "gradient": data["rate"] ** 2}
        return data

    @model_validator(mode="after")
    def _axes_make_an_orbit(self) -> GravityGradient:
        nadir, normal = np.asarray(self.nadir), np.asarray(self.normal)
        size = np.linalg.norm(nadir) * np.linalg.norm(normal)
        if size == 0.0 or abs(nadir @ normal) > 1e-6 * size:
            raise ValueError("`nadir` and `normal` must be perpendicular and not zero")
        return self

    @property
    def rate(self) -> float:
        """Orbital rate [rad/s]."""
        return float(np.sqrt(self.gradient))

    def vertical(self, t: float) -> np.ndarray:
        """Return the unit vector to nadir at a time [s], inertial axes (3,)."""
        down = np.asarray(self.nadir) / np.linalg.norm(self.nadir)
        ahead = np.cross(np.asarray(self.normal) / np.linalg.norm(self.normal), down)
        plain = np.cos(self.rate * t) * down + np.sin(self.rate * t) * ahead
        return pin.exp3(np.asarray(self.turn)) @ plain

    def attach(self, assembly: Assembly) -> None:
        """Add the forces on every body; raises `DescriptionError` on a welded bus."""
        _must_float(assembly, "A gravity gradient")
        if self.gradient == 0.0:
            return
        assembly.add_force(_Tide(assembly.model, self))


class _Tide(ForceLaw):
    """The force law of a gravity gradient.

    How it depends on the state is left out: a stiffness of a few times the gradient per inertia, which
    takes an orbit's hour to show.
    """

    law = "tide"

    def __init__(self, model: pin.Model, effect: GravityGradient) -> None:
        self.pin, self.gradient, self.rate = model, effect.gradient, effect.rate
        self.down, self.ahead = effect.vertical(0.0), effect.vertical(0.5 * np.pi / effect.rate)
        self.bodies: TidalBodies | None = None
        super().__init__((), (), self.gradient, self.rate, self.down, self.ahead)

    @property
    def depends(self) -> Depends:
        """Nothing."""
        return (), ()

    def __call__(self, t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
        """Add it to tau (nv,)."""
        if t < self.start:
            return
        if self.bodies is None:  # joints may have been added since
            self.bodies = TidalBodies(self.pin)
        vertical = np.cos(self.rate * t) * self.down + np.sin(self.rate * t) * self.ahead
        field = self.gradient * (3.0 * np.outer(vertical, vertical) - np.eye(3))
        tau += self.bodies.tide(q[None], field[None])[0, 0]


class TidalBodies:
    """Masses, centres and inertias of a model's bodies, and what a tide does to them."""

    def __init__(self, model: pin.Model) -> None:
        self.pin, self.data = model, model.createData()
        inertias = list(model.inertias)
        self.chosen = [j for j, i in enumerate(inertias) if j and (i.mass > 0.0 or i.inertia.any())]
        self.mass = np.array([inertias[j].mass for j in self.chosen])
        self.lever = np.array([inertias[j].lever for j in self.chosen])
        about = np.array([inertias[j].inertia for j in self.chosen])
        half = 0.5 * np.trace(about, axis1=1, axis2=2)
        self.second = half[:, None, None] * np.eye(3) - about  # int x x' dm about the centre of mass
        self.carried = np.zeros((len(self.chosen), model.nv))  # 1 where a degree of freedom moves a body
        for row, joint in enumerate(self.chosen):
            for j in model.supports[joint]:
                self.carried[row, model.idx_vs[j] : model.idx_vs[j] + model.nvs[j]] = float(j > 0)

    def tide(self, states: np.ndarray, fields: np.ndarray) -> np.ndarray:
        """Return the generalised forces (N, n, nv) of acceleration fields ``G (x - c)``, c the mass centre.

        ``states`` (N, nq) are places; ``fields`` (n, 3, 3) symmetric matrices G [1/s^2], inertial axes.
        """
        model, data, bodies = self.pin, self.data, len(self.chosen)
        jacobians = np.empty((len(states), 6, model.nv))  # columns about the inertial origin and axes
        turn, at = np.empty((len(states), bodies, 3, 3)), np.empty((len(states), bodies, 3))
        for k, q in enumerate(states):
            jacobians[k] = pin.computeJointJacobians(model, data, q)
            for i, j in enumerate(self.chosen):
                turn[k, i], at[k, i] = data.oMi[j].rotation, data.oMi[j].translation
        at += np.einsum("tbij,bj->tbi", turn, self.lever)
        away = at - (self.mass @ at / self.mass.sum())[:, None]
        # int x (x - c)' dm about the inertial origin
        lever = (
            turn @ self.second @ turn.swapaxes(2, 3)
            + (self.mass[:, None] * at)[..., None] * away[..., None, :]
        )
        force = self.mass[:, None] * (away[:, None] @ fields)  # (N, n, bodies, 3)
        moment = (lever[:, None] @ fields[:, None]).reshape(*force.shape[:3], 9) @ TWISTED
        wrench = np.concatenate([force, moment], axis=-1)
        return np.einsum("tnbk,tkv,bv->tnv", wrench, jacobians, self.carried, optimize=True)


@register
class BaseTilt(Effect):
    """Gravity of the description, leaning by small angles: a floor, or a mount, that is not level.

    With g the described gravity and e1, e2 of `horizontal_axes`, gravity is
    ``|g| (cos(a) g/|g| + sin(a)/a (x e1 + y e2))``, ``a = hypot(x, y)``. It concerns a welded base.
    """

    summary = "the base of a welded arm is not level: gravity leans in its axes"
    family = "external"
    aliases = ("body_error", "torque_offset")
    not_estimated = dict.fromkeys(
        ("x", "y"), "equations of a welded arm's torques tell it (--method ml); motion takes it as described"
    )
    on_readings = True
    in_words = "the base under {place} is not level"
    kind: Literal["base_tilt"] = "base_tilt"
    x: float = physical(
        "rad", lower=-1.6, upper=1.6, default=0.0, description="by which gravity leans to the base's x axis"
    )
    y: float = physical("rad", lower=-1.6, upper=1.6, default=0.0, description="the same, to its y axis")

    def attach(self, assembly: Assembly) -> None:
        """Turn the model's gravity."""
        gravity = assembly.model.gravity
        gravity.linear = tilted_gravity(gravity.linear, self.x, self.y)


def tilt_of(effects: Iterable[Effect]) -> BaseTilt | None:
    """Return the base that is not level among effects, if there is one.

    Raises:
        DescriptionError: there are two.
    """
    found = [e for e in effects if isinstance(e, BaseTilt)]
    if len(found) > 1:
        raise DescriptionError("The base has two tilts.", advice="Keep one effect of the kind 'base_tilt'.")
    return found[0] if found else None


def horizontal_axes(gravity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return two unit vectors (3,) that are level: the base's x and y axes if z is vertical.

    Else the first is that axis which gravity is least along, made level, and both are perpendicular.
    """
    down = np.asarray(gravity) / np.linalg.norm(gravity)
    first = np.eye(3)[int(np.argmin(np.abs(down)))]
    first = first - down * (down @ first)
    first = first / np.linalg.norm(first)
    return first, np.cross(-down, first)


def tilted_gravity(gravity: np.ndarray, x: float, y: float) -> np.ndarray:
    """Return gravity (3,) [m/s^2] leaning by small angles x and y [rad]; zero stays zero."""
    size, angle = float(np.linalg.norm(gravity)), float(np.hypot(x, y))
    if size == 0.0:
        return np.array(gravity)
    first, second = horizontal_axes(gravity)
    aside = np.sinc(angle / np.pi) * (x * first + y * second)
    return size * (np.cos(angle) * np.asarray(gravity) / size + aside)
