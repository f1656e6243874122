"""Joint friction: viscous, smoothed Coulomb, Stribeck, and Coulomb that depends on load or angle."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import Field

from smsid.effects.base import Starting, physical, register

if TYPE_CHECKING:
    from smsid.model.assembly import Assembly


@register
class JointFriction(Starting):
    """Friction torque on one joint of an arm or wheel, against its rate qd.

    ``-viscous qd - (coulomb + stribeck exp(-|qd/stribeck_rate|^stribeck_exponent) + load |tau|
    + position_cos cos q + position_sin sin q) tanh(qd / smoothing)``, with tau the torque that drives the
    joint (where its motion is prescribed, nothing drives it, and the load takes no part).

    Source: Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083, whose Stribeck curve has
    the exponent of Bo and Pavelescu, Wear 82 (1982) 277: 2 is Gauss's curve, 1 Tustin's; load-dependent
    harmonic drives: Taghirad and Belanger, J. Dyn. Syst. Meas. Control 120 (1998) 311.
    """

    summary: ClassVar[str] = (
        "friction of one joint: viscous, Coulomb, Stribeck, by load and by angle; "
        "the Coulomb torque as `tanh(rate / smoothing)`"
    )
    family: ClassVar[str] = "friction"
    aliases: ClassVar[tuple[str, ...]] = ("actuator_delay", "torque_gain", "torque_offset")
    strength: ClassVar[tuple[str, ...]] = (
        "viscous",
        "coulomb",
        "stribeck",
        "load",
        "position_cos",
        "position_sin",
    )
    changes: ClassVar[Mapping[str, tuple[str, str]]] = {
        "viscous": ("its drag has grown", "its drag has fallen"),
        "coulomb": ("its friction has grown", "its friction has fallen"),
    }
    kind: Literal["joint_friction"] = "joint_friction"
    joint: str = Field(
        description="joint of the model: `joint2`, or `left/joint2` of a mounted arm, or a wheel"
    )
    viscous: float = physical("N m s/rad", lower=0.0, default=0.0, description="torque per rate")
    coulomb: float = physical("N m", lower=0.0, default=0.0, description="torque at speed")
    stribeck: float = physical(
        "N m", lower=0.0, default=0.0, description="torque beyond `coulomb` on breaking loose"
    )
    stribeck_rate: float = physical(
        "rad/s",
        lower=1e-6,
        default=0.05,
        description="rate at which `stribeck` has fallen to 37 %",
    )
    stribeck_exponent: float = physical(
        "1",
        lower=0.5,
        upper=4.0,
        default=2.0,
        description="how sharply `stribeck` falls about that rate: 2 is a Gaussian, 1 an exponential",
    )
    load: float = physical(
        "1", lower=0.0, default=0.0, description="Coulomb torque per torque that drives the joint"
    )
    position_cos: float = physical(
        "N m", default=0.0, description="Coulomb torque that goes with the cosine of the joint's angle"
    )
    position_sin: float = physical("N m", default=0.0, description="the same, with the sine")
    smoothing: float = Field(
        default=0.005, gt=0.0, description="rate at which the Coulomb torque reaches 76 % [rad/s]"
    )

    def driven_joints(self) -> tuple[str, ...]:
        """Return the joint whose motor torque it has to do with."""
        return (self.joint,)

    def attach(self, assembly: Assembly) -> None:
        """Add the friction torque; a viscous part that is always there is a linear damper."""
        number = assembly.joint_id(self.joint)
        joint = assembly.model.joints[number]
        index, place, turns = joint.idx_v, joint.idx_q, joint.nq == 1
        viscous = self.viscous
        if self.start is None and viscous:
            assembly.add_springs(number, (0.0,), (viscous,))
            viscous = 0.0
        coulomb, stribeck, rate = self.coulomb, self.stribeck, self.stribeck_rate
        exponent = self.stribeck_exponent
        cos, sin, load, smoothing, active = (
            self.position_cos,
            self.position_sin,
            self.load,
            self.smoothing,
            self.active,
        )

        def force(t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
            if not active(t):
                return
            qd = v[index]
            size = coulomb
            if stribeck:
                size += stribeck * np.exp(-(abs(qd / rate) ** exponent))
            if cos or sin:
                c, s = (np.cos(q[place]), np.sin(q[place])) if turns else (q[place], q[place + 1])
                size += cos * c + sin * s
            tau[index] -= viscous * qd + size * np.tanh(qd / smoothing)

        def by_load(t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
            if active(t):
                tau[index] -= load * abs(tau[index]) * np.tanh(v[index] / smoothing)

        if viscous or coulomb or stribeck or cos or sin:
            assembly.add_force(force, self.onset, ((index,) if cos or sin else (), (index,)))
        if load:
            assembly.add_load_force(by_load, self.onset, ((), (index,)))
