"""What acts from outside: a constant force or torque, the gradient of gravity."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
import pinocchio as pin
from pydantic import Field, model_validator

from smsid.effects.base import Effect, Starting, Vector3, physical, register
from smsid.errors import DescriptionError

if TYPE_CHECKING:
    from smsid.model.assembly import Assembly


def _must_float(assembly: Assembly, what: str) -> None:
    if assembly.base == 0:
        raise DescriptionError(f"{what} does nothing to a welded bus.", advice="Remove the effect.")


@register
class ExternalWrench(Starting):
    """A constant force and torque on the bus: a leak, solar pressure, a residual dipole.

    The force acts at ``point`` of the bus; force and torque are constant in body or in inertial axes.
    """

    summary: ClassVar[str] = "constant force and torque on the bus, fixed to the bus or in inertial axes"
    family: ClassVar[str] = "external"
    aliases: ClassVar[tuple[str, ...]] = ("sensor_bias", "gravity_gradient")
    strength: ClassVar[tuple[str, ...]] = ("force", "torque")
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
        active, turning = self.active, self.frame == "inertial"

        def term(t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
            if not active(t):
                return
            f, n = force, torque
            if turning:
                to_body = pin.Quaternion(q[3:7]).toRotationMatrix().T
                f, n = to_body @ f, to_body @ n
            tau[:3] += f
            tau[3:6] += n + pin.skew(point) @ f

        assembly.add_force(term, self.onset)


@register
class GravityGradient(Effect):
    """Gravity that differs over the spacecraft, on a circular orbit about its system centre of mass.

    The inertial frame falls with the orbit. A mass at d from the centre of mass feels ``gradient (3 (d . r) r
    - d)`` per mass, with r the unit vector of the local vertical, which turns about ``normal`` at the orbital
    rate: ``gradient`` is the square of that rate (1.2e-6 1/s^2 in low Earth orbit). ``rate`` [rad/s] may be
    given instead. The total force is zero; the torque on a rigid body is ``3 gradient r x I r``.

    Source: Hughes, Spacecraft Attitude Dynamics (1986), section 8.1; here on every body.
    """

    summary: ClassVar[str] = "gravity gradient on every body, circular orbit"
    family: ClassVar[str] = "external"
    aliases: ClassVar[tuple[str, ...]] = ("external_wrench",)
    strength: ClassVar[tuple[str, ...]] = ("gradient",)
    kind: Literal["gravity_gradient"] = "gravity_gradient"
    gradient: float = physical(
        "1/s^2", lower=0.0, description="square of the orbital rate; `rate` [rad/s] may be given instead"
    )
    nadir: Vector3 = Field(default=(0.0, 0.0, -1.0), description="direction of nadir at t = 0, inertial axes")
    normal: Vector3 = Field(default=(0.0, 1.0, 0.0), description="normal of the orbit, inertial axes")

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

    def attach(self, assembly: Assembly) -> None:
        """Add the forces on every body; raises `DescriptionError` on a welded bus."""
        _must_float(assembly, "A gravity gradient")
        if self.gradient == 0.0:
            return
        model, gradient, rate = assembly.model, self.gradient, self.rate
        down = np.asarray(self.nadir) / np.linalg.norm(self.nadir)
        ahead = np.cross(np.asarray(self.normal) / np.linalg.norm(self.normal), down)
        bodies: list[_Bodies] = []

        def term(t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
            if not bodies:  # joints may have been added since
                bodies.append(_Bodies(model))
            vertical = np.cos(rate * t) * down + np.sin(rate * t) * ahead
            tau += bodies[0].tide(q, gradient, vertical)

        assembly.add_force(term)


class _Bodies:
    """Masses, centres and inertias of a model's bodies, and what a tide does to them."""

    def __init__(self, model: pin.Model) -> None:
        self.pin, self.data = model, model.createData()
        inertias = list(model.inertias)
        self.chosen = [j for j, i in enumerate(inertias) if j and (i.mass > 0.0 or i.inertia.any())]
        self.mass = np.array([inertias[j].mass for j in self.chosen])
        self.lever = np.array([inertias[j].lever for j in self.chosen])
        self.inertia = np.array([inertias[j].inertia for j in self.chosen])
        self.carried = np.zeros((len(self.chosen), model.nv))  # 1 where a degree of freedom moves a body
        for row, joint in enumerate(self.chosen):
            for j in model.supports[joint]:
                self.carried[row, model.idx_vs[j] : model.idx_vs[j] + model.nvs[j]] = float(j > 0)

    def tide(self, q: np.ndarray, gradient: float, vertical: np.ndarray) -> np.ndarray:
        """Return the generalised force (nv,) of ``gradient`` [1/s^2] along ``vertical`` (3,), inertial."""
        model, data = self.pin, self.data
        jacobians = pin.computeJointJacobians(model, data, q)  # columns about the inertial origin and axes
        places = [data.oMi[j] for j in self.chosen]
        turn = np.array([p.rotation for p in places])
        at = np.array([p.translation for p in places]) + np.einsum("bij,bj->bi", turn, self.lever)
        away = at - self.mass @ at / self.mass.sum()
        force = gradient * self.mass[:, None] * (3.0 * np.outer(away @ vertical, vertical) - away)
        down = np.einsum("bji,j->bi", turn, vertical)
        turning = np.einsum("bij,bj->bi", self.inertia, down)
        moment = 3.0 * gradient * np.einsum("bij,bj->bi", turn, _cross(down, turning)) + _cross(at, force)
        return np.sum((np.hstack([force, moment]) @ jacobians) * self.carried, axis=0)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return a x b row by row; np.cross takes ten times as long."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)
