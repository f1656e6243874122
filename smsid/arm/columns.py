"""What effects add to joint torques, linear in their parameters."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import singledispatch
from typing import Any

import numpy as np

from smsid._short_repr import short_repr
from smsid.arm.units import joint_unit
from smsid.effects import (
    BaseTilt,
    Effect,
    Gear,
    JointCable,
    JointFriction,
    JointOffset,
    MotorCoupling,
    MotorInertia,
    Servo,
    TorqueOffset,
)
from smsid.effects.friction_law import BY_FIELD, friction_columns, sliding_state
from smsid.errors import DescriptionError
from smsid.model.spacecraft import SpacecraftModel


@short_repr
@dataclass(frozen=True)
class Column:
    """Joint torque (N, nv) [N m | N] per unit of the parameter ``name`` = ``<effect>.<field>``."""

    name: str
    unit: str
    values: np.ndarray


@short_repr
@dataclass(frozen=True)
class JointStates:
    """What joint torques depend on at N instants.

    ``q`` (N, nq), rates ``v`` and accelerations ``a`` (N, nv); ``load`` (N, nv) the torque that drives the
    joints [N m | N] and ``temperature`` (N, nv) [degC]; ``None`` for what is not known.
    """

    q: np.ndarray | None
    v: np.ndarray
    a: np.ndarray
    load: np.ndarray | None = None
    temperature: np.ndarray | None = None

    def __getitem__(self, part: slice) -> JointStates:
        """Return the instants of a slice."""
        every = (getattr(self, f.name) for f in fields(self))
        return JointStates(*(None if x is None else x[part] for x in every))  # type: ignore[arg-type]


def effect_columns(effect: Any, model: SpacecraftModel, states: JointStates) -> tuple[Column, ...]:
    """Return `torque_columns` of an effect, with all that friction may depend on.

    Raises:
        DescriptionError: as `torque_columns`, or a law of friction needs what is not known.
    """
    if isinstance(effect, JointFriction):
        return _friction(effect, model, states.v, states.a, states=states)
    if isinstance(effect, JointCable):
        return _cable(effect, model, states.v, states.a, states=states)
    return torque_columns(effect, model, states.v, states.a)


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
    effect: JointFriction,
    model: SpacecraftModel,
    v: np.ndarray,
    a: np.ndarray,
    *,
    states: JointStates | None = None,
) -> tuple[Column, ...]:
    k = joint_index(model, effect, effect.joint)
    given = states or JointStates(None, v, a)
    needed = {BY_FIELD[f].law for f in effect.asked()}
    for law, what, values in (
        ("position", "the joint's angle", given.q),
        ("load", "the torque that drives the joint", given.load),
        ("temperature", "a measured temperature (a channel 'joint_temperature')", given.temperature),
    ):
        if law in needed and values is None:
            raise DescriptionError(
                f"Friction '{effect.name}' of the law '{law}' needs {what}.",
                advice="Measure it, or leave the law out.",
                effect=effect.name,
                law=law,
            )
    at = sliding_state(
        effect,
        v[:, k],
        angle=0.0 if given.q is None else joint_angle(model, effect.joint, given.q),
        load=0.0 if given.load is None else given.load[:, k],
        temperature=None if given.temperature is None else given.temperature[:, k],
    )
    found = friction_columns(effect, effect.asked(), at)
    return tuple(_column(model, effect, field, v, {k: values}) for field, values in found.items())


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


@torque_columns.register
def _cable(
    effect: JointCable,
    model: SpacecraftModel,
    v: np.ndarray,
    a: np.ndarray,
    *,
    states: JointStates | None = None,
) -> tuple[Column, ...]:
    k = joint_index(model, effect, effect.joint)
    if states is None or states.q is None:
        raise DescriptionError(
            f"Cable '{effect.name}' needs the joint's angle.", advice="Measure it.", effect=effect.name
        )
    angle = joint_angle(model, effect.joint, states.q)
    return (_column(model, effect, "stiffness", v, {k: angle - effect.rest}),)


@torque_columns.register(BaseTilt)
@torque_columns.register(Gear)
@torque_columns.register(JointOffset)
@torque_columns.register(Servo)
def _measured(effect: Any, model: SpacecraftModel, v: np.ndarray, a: np.ndarray) -> tuple[Column, ...]:
    return ()  # they act on what is measured, see `joint_motion`, or on gravity, see `smsid.arm.level`


def joint_index(model: SpacecraftModel, effect: Effect, joint: str) -> int:
    """Return where a joint is in v; raises `DescriptionError` if the model does not have it."""
    if not model.pin.existJointName(joint):
        raise DescriptionError(
            f"Effect '{effect.name}' is on joint '{joint}', which does not exist.",
            advice=f"Joints of the model: {', '.join(model.arm_joints.names)}.",
            joint=joint,
        )
    return int(model.pin.joints[model.pin.getJointId(joint)].idx_v)


def joint_angle(model: SpacecraftModel, joint: str, q: np.ndarray) -> np.ndarray:
    """Return the angle or position (N,) of a joint from configurations (N, nq) [rad | m]."""
    own = model.pin.joints[model.pin.getJointId(joint)]
    return q[:, own.idx_q] if own.nq == 1 else np.arctan2(q[:, own.idx_q + 1], q[:, own.idx_q])


def _column(
    model: SpacecraftModel, effect: Effect, field: str, like: np.ndarray, at: dict[int, np.ndarray]
) -> Column:
    values = np.zeros(like.shape)
    for k, part in at.items():
        values[:, k] = part
    unit = next(p.unit for p in effect.parameters() if p.name == f"{effect.name}.{field}")
    joints = getattr(effect, "joints", None) or (str(getattr(effect, "joint", "")),)
    return Column(f"{effect.name}.{field}", joint_unit(unit, model, *joints), values)
