"""What effects add to joint torques, linear in their parameters."""

from __future__ import annotations

from dataclasses import dataclass
from functools import singledispatch
from typing import Any

import numpy as np

from smsid._short_repr import short_repr
from smsid.arm.units import joint_unit
from smsid.effects import (
    Effect,
    FrictionAsymmetry,
    Gear,
    JointDrag,
    JointFriction,
    JointOffset,
    MotorCoupling,
    MotorInertia,
    TorqueOffset,
)
from smsid.errors import DescriptionError
from smsid.model.spacecraft import SpacecraftModel


@short_repr
@dataclass(frozen=True)
class Column:
    """Joint torque (N, nv) [N m | N] per unit of the parameter ``name`` = ``<effect>.<field>``."""

    name: str
    unit: str
    values: np.ndarray


@singledispatch
def torque_columns(effect: Any, model: SpacecraftModel, v: np.ndarray, a: np.ndarray) -> tuple[Column, ...]:
    """Return what the motors must give for an effect at joint rates v and accelerations a (N, nv).

    Rates and accelerations [rad/s, rad/s^2]; the columns are torques [N m] per unit of a parameter: the terms
    of joint dynamics beyond rigid links (Siciliano et al. 2009, *Robotics*, chapter 7).

    Effects of users take part by ``torque_columns.register(TheirEffect)``.

    Raises:
        DescriptionError: the effect does not enter joint torques linearly.
    """
    raise DescriptionError(
        f"Effect '{effect.name}' of kind '{effect.kind}' does not enter joint torques linearly.",
        advice="Leave it out, or register its columns with smsid.arm.torque_columns.register.",
        effect=effect.name,
    )


@torque_columns.register
def _friction(
    effect: JointFriction, model: SpacecraftModel, v: np.ndarray, a: np.ndarray
) -> tuple[Column, ...]:
    k = joint_index(model, effect, effect.joint)
    rate = v[:, k]
    return (
        _column(model, effect, "viscous", v, {k: rate}),
        _column(model, effect, "coulomb", v, {k: np.tanh(rate / effect.smoothing)}),
    )


@torque_columns.register
def _drag(effect: JointDrag, model: SpacecraftModel, v: np.ndarray, a: np.ndarray) -> tuple[Column, ...]:
    k = joint_index(model, effect, effect.joint)
    size, rate = np.abs(v[:, k]), v[:, k]
    return (
        _column(model, effect, "quadratic", v, {k: size * rate}),
        _column(model, effect, "cubic", v, {k: size**2 * rate}),
    )


@torque_columns.register
def _asymmetry(
    effect: FrictionAsymmetry, model: SpacecraftModel, v: np.ndarray, a: np.ndarray
) -> tuple[Column, ...]:
    k = joint_index(model, effect, effect.joint)
    size = np.abs(v[:, k])
    return (
        _column(model, effect, "viscous", v, {k: size}),
        _column(model, effect, "coulomb", v, {k: np.tanh(size / effect.smoothing)}),
    )


@torque_columns.register
def _inertia(
    effect: MotorInertia, model: SpacecraftModel, v: np.ndarray, a: np.ndarray
) -> tuple[Column, ...]:
    k = joint_index(model, effect, effect.joint)
    return (_column(model, effect, "inertia", v, {k: a[:, k]}),)


@torque_columns.register
def _offset(effect: TorqueOffset, model: SpacecraftModel, v: np.ndarray, a: np.ndarray) -> tuple[Column, ...]:
    k = joint_index(model, effect, effect.joint)
    return (_column(model, effect, "torque", v, {k: np.ones(len(v))}),)


@torque_columns.register
def _coupling(
    effect: MotorCoupling, model: SpacecraftModel, v: np.ndarray, a: np.ndarray
) -> tuple[Column, ...]:
    index = [joint_index(model, effect, name) for name in effect.joints]
    weights = np.asarray(effect.weights)
    rate, acceleration = v[:, index] @ weights, a[:, index] @ weights
    parts = {"inertia": acceleration, "viscous": rate, "coulomb": np.tanh(rate / effect.smoothing)}
    return tuple(
        _column(model, effect, field, v, {k: w * values for k, w in zip(index, weights, strict=True)})
        for field, values in parts.items()
    )


@torque_columns.register(Gear)
@torque_columns.register(JointOffset)
def _measured(effect: Any, model: SpacecraftModel, v: np.ndarray, a: np.ndarray) -> tuple[Column, ...]:
    return ()  # they act on what is measured, see `joint_motion`


def joint_index(model: SpacecraftModel, effect: Effect, joint: str) -> int:
    """Return where a joint is in v; raises `DescriptionError` if the model does not have it."""
    if not model.pin.existJointName(joint):
        raise DescriptionError(
            f"Effect '{effect.name}' is on joint '{joint}', which does not exist.",
            advice=f"Joints of the model: {', '.join(model.arm_joints.names)}.",
            joint=joint,
        )
    return int(model.pin.joints[model.pin.getJointId(joint)].idx_v)


def _column(
    model: SpacecraftModel, effect: Effect, field: str, like: np.ndarray, at: dict[int, np.ndarray]
) -> Column:
    values = np.zeros(like.shape)
    for k, part in at.items():
        values[:, k] = part
    unit = next(p.unit for p in effect.parameters() if p.name == f"{effect.name}.{field}")
    joints = getattr(effect, "joints", None) or (str(getattr(effect, "joint", "")),)
    return Column(f"{effect.name}.{field}", joint_unit(unit, model, *joints), values)
