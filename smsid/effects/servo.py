"""Servo joints: a commanded position through a controller, and nothing measured but the angle."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, ClassVar, Literal

from pydantic import Field

from smsid.effects.base import Effect, physical, register

if TYPE_CHECKING:
    from smsid.effects.assembly import Assembly


@register
class Servo(Effect):
    """The motor of a joint gives ``stiffness (commanded - q) - damping qd``, at most ``limit``.

    Back-EMF is damping. With ``damps = "error"`` the damping takes the commanded rate less qd. It says what a
    recorded command is worth; recordings of a welded arm without joint torques are identified with it. Gains
    that are `known` are taken as they stand. Damping of the rate is told from viscous friction by nothing:
    unless it is known and given, it is part of ``viscous``.
    """

    summary: ClassVar[str] = "servo of a joint: from commanded position to torque"
    family: ClassVar[str] = "drivetrain"
    not_estimated: ClassVar[Mapping[str, str]] = dict.fromkeys(
        ("stiffness", "damping", "limit"), "a spacecraft's motors are commanded by torque; see laboratory"
    )
    on_readings: ClassVar[bool] = True
    kind: Literal["servo"] = "servo"
    joint: str = Field(description="joint that it turns")
    stiffness: float = physical(
        "N m/rad", lower=0.0, default=1.0, description="torque per position error; a guess unless `known`"
    )
    damping: float = physical("N m s/rad", lower=0.0, default=0.0, description="torque per rate")
    damps: Literal["rate", "error"] = Field(
        default="rate", description="what the damping takes: the joint's `rate`, or that of the `error`"
    )
    limit: float | None = physical(
        "N m", lower=0.0, default=None, description="largest torque, as of a limit of current"
    )

    def driven_joints(self) -> tuple[str, ...]:
        """Return the joint whose motor torque it has to do with."""
        return (self.joint,)

    def attach(self, assembly: Assembly) -> None:
        """Check that the joint is there; nothing acts on the motion."""
        assembly.joint_id(self.joint)


def servos_of(effects: Iterable[Effect]) -> dict[str, Servo]:
    """Return the servo by joint, of effects."""
    return {e.joint: e for e in effects if isinstance(e, Servo)}
