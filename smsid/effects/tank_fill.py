"""A tank that thrust empties: what is left, what of it sloshes, and how stiffly."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np
import pinocchio as pin
from pydantic import Field, model_validator

from smsid.effects.assembly import Assembly
from smsid.effects.base import physical, register
from smsid.effects.payload import point_parameters
from smsid.effects.slosh import TankEffect
from smsid.effects.spatial import ExtraInertia
from smsid.errors import DescriptionError

if TYPE_CHECKING:
    from smsid.inputs.inputs import Inputs
    from smsid.model.spacecraft import SpacecraftModel

FIRST_ROOT = 1.841  # of the derivative of Bessel's J1: the first lateral mode in a cylinder
PROBE = 1e-2  # [N s] over which derivatives are taken
METER = 1e-6  # [kg m^2] of what turns by 1 rad/s for every N s of thrust; it turns nothing else


@register
class TankFill(TankEffect):
    """Thrust uses ``consumption`` of propellant per impulse, ``1 / (g0 Isp)``; slosh goes with the fill.

    The tank's parameters, and the body's mass, are those at the start. There it is filled by ``fill`` with
    ``propellant``; what of it does not slosh moves with the body that carries the tank, at c_s, and is
    counted in that body's mass. In an upright ``"cylinder"`` the slosh mass goes with ``tanh x``, stiffness
    with ``tanh^2 x``, x = 1.841 times height over radius of the liquid; a ``"table"`` gives both by
    the fill, in any unit. Damping keeps its ratio. What leaves takes its momentum along, as of `mass_loss`.
    Of single thrusters every one uses what it gives; of a net force, thrusters along the bus's axes are
    thought of. Sources: Abramson, NASA SP-106 (1966), chapter 6; Dodge, The New Dynamic Behavior of Liquids
    in Moving Containers (2000), chapter 3.
    """

    summary = "a tank that thrust empties, with slosh mass and stiffness by its fill"
    aliases = ("mass_loss", "slosh")
    strength = ("consumption",)
    geometry = ("propellant",)
    may_begin = False
    in_words = "thrust empties {place}"
    kind: Literal["tank_fill"] = "tank_fill"
    propellant: float = physical(
        "kg", lower=0.0, gt=0.0, description="in the tank at the start, slosh mass and all"
    )
    consumption: float = physical(
        "s/m", lower=0.0, may_vanish=True, description="mass used per impulse, kg per N s"
    )
    fill: float = Field(default=1.0, gt=0.0, le=1.0, description="of the tank at the start")
    law: Literal["cylinder", "table"] = Field(default="cylinder", description="how slosh goes with the fill")
    height: float = Field(default=2.0, gt=0.0, description="of a full cylinder, in radii")
    fills: tuple[float, ...] = Field(default=(), description="of a table, rising")
    masses: tuple[float, ...] = Field(default=(), description="slosh mass at `fills`, in any unit")
    stiffnesses: tuple[float, ...] = Field(default=(), description="stiffness at `fills`, in any unit")

    @model_validator(mode="after")
    def _table_is_whole(self) -> TankFill:
        if self.start is not None:
            raise ValueError("thrust always uses propellant: leave out `start`")
        n = len(self.fills)
        if self.law == "table" and not (n > 1 and n == len(self.masses) == len(self.stiffnesses)):
            raise ValueError("a table takes `fills`, `masses` and `stiffnesses` of one length, two at least")
        if any(b <= a for a, b in zip(self.fills, self.fills[1:], strict=False)):
            raise ValueError("`fills` must rise")
        if any(x <= 0.0 for x in (*self.masses, *self.stiffnesses)):
            raise ValueError("`masses` and `stiffnesses` must be positive")
        return self

    def lasting_joints(self) -> tuple[str, ...]:
        """Return the joint whose rate is the impulse used [N s]."""
        return (f"{self.name}.used",)

    def shares(self, impulse: float) -> tuple[float, float, float]:
        """Return mass used [kg], and slosh mass and stiffness over those at the start, after so many N s."""
        used = self.consumption * max(impulse, 0.0)
        if used >= self.propellant:
            return self.propellant, 0.0, 0.0
        now = self.fill * (1.0 - used / self.propellant)
        if self.law == "cylinder":
            ratio = float(
                np.tanh(FIRST_ROOT * self.height * now) / np.tanh(FIRST_ROOT * self.height * self.fill)
            )
            return used, ratio, ratio**2
        mass, stiffness = (
            float(np.interp(now, self.fills, x) / np.interp(self.fill, self.fills, x))
            for x in (self.masses, self.stiffnesses)
        )
        return used, mass, stiffness

    def drive(self, inputs: Inputs, model: SpacecraftModel) -> Inputs:
        """Let the meter turn with what single thrusters give."""
        if inputs.thrusts is None:
            return inputs
        turned = model.pin.joints[model.pin.getJointId(*self.lasting_joints())].idx_v
        matrix = np.zeros((model.nv, inputs.thrusts.size))
        full = np.array([t.full() for t in model.description.thruster])
        matrix[turned] = METER * (full / np.linalg.norm(full, axis=1)[:, None]).ravel()
        own = inputs.thrusts.mapped(matrix)
        return replace(inputs, further=(*inputs.further, own))

    def attach(self, assembly: Assembly) -> None:
        """Add the meter of impulse, what is no longer there, and springs that go with the fill.

        Raises `DescriptionError` without the tank, or where more sloshes than there is.
        """
        place, rate = self.coordinates(assembly)
        tank, joint = assembly.slosh[self.tank]
        if tank.mass > self.propellant * (1.0 + 1e-9):
            raise DescriptionError(
                f"More sloshes in '{self.tank}' than there is: {tank.mass:.4g} of {self.propellant:.4g} kg.",
                advice="`propellant` is all of it, at the start.",
            )
        meter = assembly.add_joint("universe", pin.JointModelRX(), pin.SE3.Identity(), *self.lasting_joints())
        assembly.add_inertia(meter, pin.Inertia(0.0, np.zeros(3), METER * np.eye(3)))
        turned = assembly.model.joints[meter].idx_v
        carrier, placement = assembly.frame(tank.frame)
        seat = placement.act(tank.equilibrium)
        k, c = np.array(tank.stiffness), np.array(tank.damping)

        def left(t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
            _, mass, stiffness = self.shares(float(v[turned]))
            tau[rate] -= (stiffness - 1.0) * k * q[place] + (np.sqrt(mass * stiffness) - 1.0) * c * v[rate]

        def net(t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
            tau[turned] += METER * np.abs(tau[:3]).sum()

        assembly.add_force(left, (range(rate.start, rate.stop), (*range(rate.start, rate.stop), turned)))
        if assembly.base and not assembly.thrusters:
            assembly.add_load_force(net, ((), ()), first=True)
        for body, at, sloshes in ((joint, np.zeros(3), True), (carrier, seat, False)):
            if body:
                assembly.add_inertia_term(
                    _SpentPropellant(self, assembly.model, body, at, turned, tank.mass, sloshes)
                )


class _SpentPropellant:
    """What is no longer there: of the slosh mass, or of the rest, which moves with the body."""

    def __init__(
        self,
        fill: TankFill,
        model: pin.Model,
        body: int,
        at: np.ndarray,
        meter: int,
        mass: float,
        sloshes: bool,
    ) -> None:
        self._inertia = ExtraInertia(model, body, lambda _: self._theta)
        self._fill, self._at, self._meter, self._mass, self._sloshes = fill, at, meter, mass, sloshes
        self._theta: np.ndarray | None = None

    def _weigh(self, impulse: float) -> None:
        used, share, _ = self._fill.shares(impulse)
        gone = self._mass * (1.0 - share)
        gone = gone if self._sloshes else used - gone
        self._theta = point_parameters(-gone, self._at) if abs(gone) > 1e-12 else None

    def __call__(self, t: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what it adds to mass matrix (nv, nv) and nonlinear effects (nv,)."""
        self._weigh(float(v[self._meter]))
        return self._inertia(t, q, v)

    def derivatives(
        self, t: float, q: np.ndarray, v: np.ndarray, a: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the derivatives of M' a + b' by the tangent of q and by v, each (nv, nv)."""
        further = v.copy()
        further[self._meter] += PROBE
        (m1, b1), (m0, b0) = self(t, q, further), self(t, q, v)
        by_q, by_v = self._inertia.derivatives(t, q, v, a)
        by_v[:, self._meter] += ((m1 - m0) @ a + b1 - b0) / PROBE
        return by_q, by_v
