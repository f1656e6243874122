"""Torques at a joint by laws that `joint_friction` does not have: drag, one-sided friction, a cable."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import Field

from smsid.effects.base import Starting, physical, register
from smsid.errors import DescriptionError

if TYPE_CHECKING:
    from smsid.model.assembly import Assembly

JOINT = "joint of the model: `joint2`, or `left/joint2` of a mounted arm, or a wheel"


@register
class JointDrag(Starting):
    """Torque ``-quadratic qd |qd| - cubic qd^3`` on one joint of an arm or wheel, against its rate qd.

    What stirs oil or air goes with the square of the rate (White, *Viscous Fluid Flow*, 2006).
    """

    summary: ClassVar[str] = "drag of one joint that grows with the square or the cube of its rate"
    family: ClassVar[str] = "friction"
    aliases: ClassVar[tuple[str, ...]] = ("joint_friction",)
    strength: ClassVar[tuple[str, ...]] = ("quadratic", "cubic")
    kind: Literal["joint_drag"] = "joint_drag"
    joint: str = Field(description=JOINT)
    quadratic: float = physical(
        "N m s^2/rad^2", lower=0.0, default=0.0, description="torque by the rate's square"
    )
    cubic: float = physical("N m s^3/rad^3", lower=0.0, default=0.0, description="torque by its cube")

    def driven_joints(self) -> tuple[str, ...]:
        """Return the joint whose motor torque it has to do with."""
        return (self.joint,)

    def attach(self, assembly: Assembly) -> None:
        """Add the drag."""
        index = assembly.model.joints[assembly.joint_id(self.joint)].idx_v
        quadratic, cubic, active = self.quadratic, self.cubic, self.active

        def force(t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
            if active(t):
                qd = v[index]
                tau[index] -= (quadratic + cubic * abs(qd)) * abs(qd) * qd

        if quadratic or cubic:
            assembly.add_force(force, self.onset, ((), (index,)))


@register
class FrictionAsymmetry(Starting):
    """Friction of one joint that differs by direction: what it is forwards beyond its mean.

    ``-viscous |qd| - coulomb |tanh(qd / smoothing)|``, so that as much is missing backwards; the means are a
    `joint_friction`. Source: Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083.
    """

    summary: ClassVar[str] = "friction of one joint that differs by direction: forwards, less the mean"
    family: ClassVar[str] = "friction"
    aliases: ClassVar[tuple[str, ...]] = ("joint_friction", "torque_offset")
    strength: ClassVar[tuple[str, ...]] = ("viscous", "coulomb")
    kind: Literal["friction_asymmetry"] = "friction_asymmetry"
    joint: str = Field(description=JOINT)
    viscous: float = physical("N m s/rad", default=0.0, description="torque per rate forwards, less the mean")
    coulomb: float = physical("N m", default=0.0, description="torque at speed forwards, less the mean")
    smoothing: float = Field(
        default=0.005, gt=0.0, description="rate at which the Coulomb torque reaches 76 % [rad/s]"
    )

    def driven_joints(self) -> tuple[str, ...]:
        """Return the joint whose motor torque it has to do with."""
        return (self.joint,)

    def attach(self, assembly: Assembly) -> None:
        """Add the difference."""
        index = assembly.model.joints[assembly.joint_id(self.joint)].idx_v
        viscous, coulomb, smoothing, active = self.viscous, self.coulomb, self.smoothing, self.active

        def force(t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
            if active(t):
                size = abs(v[index])
                tau[index] -= viscous * size + coulomb * np.tanh(size / smoothing)

        if viscous or coulomb:
            assembly.add_force(force, self.onset, ((), (index,)))


@register
class JointCable(Starting):
    """A cable across a joint of an arm: a spring with an angle of rest, ``-stiffness (q - rest)``."""

    summary: ClassVar[str] = "a cable or hose across a joint: a spring with an angle of rest"
    family: ClassVar[str] = "drivetrain"
    aliases: ClassVar[tuple[str, ...]] = ("torque_offset", "joint_friction")
    strength: ClassVar[tuple[str, ...]] = ("stiffness",)
    kind: Literal["joint_cable"] = "joint_cable"
    joint: str = Field(description="joint of the model: `joint2`, or `left/joint2` of a mounted arm")
    stiffness: float = physical("N m/rad", lower=0.0, default=0.0, description="torque per angle from rest")
    rest: float = physical("rad", default=0.0, description="angle at which it does not pull")

    def driven_joints(self) -> tuple[str, ...]:
        """Return the joint whose motor torque it has to do with."""
        return (self.joint,)

    def attach(self, assembly: Assembly) -> None:
        """Add the spring. Raises `DescriptionError` for a joint that turns without end."""
        joint = assembly.model.joints[assembly.joint_id(self.joint)]
        if joint.nq != 1:
            raise DescriptionError(
                f"Joint '{self.joint}' turns without end: no cable is across it.",
                advice="Give it limits in the URDF (type revolute).",
                joint=self.joint,
            )
        place, index = joint.idx_q, joint.idx_v
        stiffness, rest, active = self.stiffness, self.rest, self.active

        def force(t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
            if active(t):
                tau[index] -= stiffness * (q[place] - rest)

        if stiffness:
            assembly.add_force(force, self.onset, ((index,), ()))
