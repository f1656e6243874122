"""Servo joints: a commanded position through a controller, and nothing measured but the angle."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

from pydantic import Field

from smsid.effects.base import Effect, physical, register
from smsid.effects.joint_effect import JointEffect
from smsid.effects.joint_state import JointStateOf, TorqueColumns


@register
class Servo(JointEffect):
    """The motor of a joint gives ``stiffness (commanded - q) - damping qd``, at most ``limit``.

    Back-EMF is damping. With ``damps = "error"`` the damping takes the commanded rate less qd. It says what a
    recorded command is worth; recordings of a welded arm without joint torques are identified with it. Gains
    that are `known` are taken as they stand. Damping of the rate is told from viscous friction by nothing:
    unless it is known and given, it is part of ``viscous``.
    """

    summary = "servo of a joint: from commanded position to torque"
    not_estimated = dict.fromkeys(
        ("stiffness", "damping", "limit"), "a spacecraft's motors are commanded by torque; see laboratory"
    )
    on_readings = True
    in_words = "the servo of {place} has another gain than described"
    kind: Literal["servo"] = "servo"
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

    def torque_columns(self, of: JointStateOf) -> TorqueColumns:
        """Return none: it is about what is measured, or commanded."""
        return {}


def servos_of(effects: Iterable[Effect]) -> dict[str, Servo]:
    """Return the servo by joint, of effects."""
    return {e.joint: e for e in effects if isinstance(e, Servo)}
