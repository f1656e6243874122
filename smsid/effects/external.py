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
        scratch: list[pin.Data] = []

        def term(t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
            if not scratch:  # joints may have been added since
                scratch.append(model.createData())
            data = scratch[0]
            vertical = np.cos(rate * t) * down + np.sin(rate * t) * ahead
            pin.computeJointJacobians(model, data, q)
            com = pin.centerOfMass(model, data, q)
            for j in range(1, model.njoints):
                body, place = model.inertias[j], data.oMi[j]
                if body.mass == 0.0 and not body.inertia.any():
                    continue
                r = place.rotation.T @ vertical
                d = place.rotation.T @ (place.translation + place.rotation @ body.lever - com)
                force = gradient * body.mass * (3.0 * (d @ r) * r - d)
                moment = 3.0 * gradient * (pin.skew(r) @ (body.inertia @ r)) + pin.skew(body.lever) @ force
                jacobian = pin.getJointJacobian(model, data, j, pin.ReferenceFrame.LOCAL)
                tau += jacobian.T @ np.concatenate([force, moment])

        assembly.add_force(term)
