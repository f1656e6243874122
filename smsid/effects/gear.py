"""Gears and servos: what a motor's encoder, current and commanded position say about the joints."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal

import numpy as np
from pydantic import Field

from smsid.effects.assembly import Assembly
from smsid.effects.base import Effect, JointEffect, physical, register
from smsid.errors import DescriptionError


@register
class Gear(JointEffect):
    """The motor of a joint turns by ``ratio * q + sum of also * (other q)``; its torque signal times
    ``torque_gain`` is its torque.

    With motor coordinates ``theta = C q`` the joint torques are ``C' tau_motor``, whatever couples them. It
    changes what is measured, not the motion.
    """

    summary = "gear of a motor: from what the motor measures to joint angle and torque"
    not_estimated = dict.fromkeys(
        ("ratio", "torque_gain"),
        "equations of torques at a welded arm's motors tell it (--method ml), motion of joints does not",
    )
    on_readings = True
    in_words = "the gear of {place} turns by another ratio than described"
    kind: Literal["gear"] = "gear"
    ratio: float = physical(
        "1", description="turns of the motor per turn of the joint; negative when it reverses"
    )
    torque_gain: float = physical(
        "1",
        default=1.0,
        description="motor torque per recorded signal [N m per its unit]; negative when it is"
        " counted the other way",
    )
    also: dict[str, float] = Field(
        default_factory=dict, description="turns of the motor per turn of other joints, `{ joint5 = 32.0 }`"
    )

    def attach(self, assembly: Assembly) -> None:
        """Check that the joints are there; nothing acts on the motion."""
        for name in (self.joint, *self.also):
            assembly.joint_id(name)


def gears_of(effects: Iterable[Effect]) -> tuple[Gear, ...]:
    """Return the gears among effects."""
    return tuple(e for e in effects if isinstance(e, Gear))


def gear_matrix(gears: Sequence[Gear], joints: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Return C (joints, joints) with motor coordinates ``C q``, and the torque gains (joints,).

    Rows and columns are in the order of ``joints``; the motor of a joint is called after it.

    Raises:
        DescriptionError: a joint has no gear or two, a gear names another joint, or C is singular.
    """
    matrix, gain = np.zeros((len(joints), len(joints))), np.ones(len(joints))
    by_joint = {gear.joint: gear for gear in gears}
    lacking = [name for name in joints if name not in by_joint]
    strangers = sorted({n for g in gears for n in (g.joint, *g.also)} - set(joints))
    if lacking or strangers or len(by_joint) != len(gears):
        raise DescriptionError(
            f"Gears do not fit the joints {', '.join(joints)}: without gear {lacking}, unknown {strangers}.",
            advice="Give every recorded joint one effect of kind 'gear'.",
            lacking=lacking,
            unknown=strangers,
        )
    place = {name: k for k, name in enumerate(joints)}
    for name, gear in by_joint.items():
        row = place[name]
        matrix[row, row], gain[row] = gear.ratio, gear.torque_gain
        for other, ratio in gear.also.items():
            matrix[row, place[other]] += ratio
    if not np.linalg.cond(matrix) < 1e12:
        raise DescriptionError(
            "The gears do not determine the joints: their matrix is singular.",
            advice="Check for a ratio of zero.",
            matrix=matrix,
        )
    return matrix, gain


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
        ("stiffness", "damping", "limit"),
        "equations of a welded arm's servos tell it (--method ml), motion under torques does not",
    )
    on_readings = True
    in_words = "the servo of {place} has another gain than described"
    kind: Literal["servo"] = "servo"
    stiffness: float = physical(
        "N m/rad", lower=0.0, default=1.0, description="torque per position error; a guess unless `known`"
    )
    damping: float = physical(
        "N m s/rad", lower=0.0, may_vanish=True, default=0.0, description="torque per rate"
    )
    damps: Literal["rate", "error"] = Field(
        default="rate", description="what the damping takes: the joint's `rate`, or that of the `error`"
    )
    limit: float | None = physical(
        "N m", lower=0.0, default=None, description="largest torque, as of a limit of current"
    )


def servos_of(effects: Iterable[Effect]) -> dict[str, Servo]:
    """Return the servo by joint, of effects."""
    return {e.joint: e for e in effects if isinstance(e, Servo)}
