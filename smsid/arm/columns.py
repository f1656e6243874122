"""What effects add to joint torques, linear in their parameters."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from smsid._short_repr import short_repr
from smsid.arm.units import joint_unit
from smsid.effects import Effect
from smsid.effects.joint_state import JointState
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

    def instants(self, part: slice) -> JointStates:
        """Return the instants of a slice."""
        every = (getattr(self, f.name) for f in fields(self))
        return JointStates(*(None if x is None else x[part] for x in every))  # type: ignore[arg-type]

    def of(self, model: SpacecraftModel, joint: str) -> JointState:
        """Return what a joint's torque depends on; raises `DescriptionError` for a joint there is not."""
        k = joint_index(model, joint)
        angle = None if self.q is None else joint_angle(model, joint, self.q)
        load, temperature = (None if x is None else x[:, k] for x in (self.load, self.temperature))
        return JointState(self.v[:, k], self.a[:, k], angle, load, temperature)


def effect_columns(effect: Effect, model: SpacecraftModel, states: JointStates) -> tuple[Column, ...]:
    """Return what the motors must give for an effect, torques [N m | N] per unit of each parameter.

    They are the terms of joint dynamics beyond rigid links (Siciliano et al. 2009, *Robotics*, chapter 7);
    effects of users take part by their own `smsid.effects.Effect.torque_columns`.

    Raises:
        DescriptionError: the effect does not enter joint torques linearly, its joint does not exist, or it
            needs what is not known.
    """
    units = {p.name: p.unit for p in effect.parameters()}
    found = []
    for field, parts in effect.torque_columns(lambda joint: states.of(model, joint)).items():
        values = np.zeros(states.v.shape)
        for joint, part in parts.items():
            values[:, joint_index(model, joint)] = part
        name = f"{effect.name}.{field}"
        found.append(Column(name, joint_unit(units[name], model, *parts), values))
    return tuple(found)


def joint_index(model: SpacecraftModel, joint: str) -> int:
    """Return where a joint is in v; raises `DescriptionError` if the model does not have it."""
    if not model.pin.existJointName(joint):
        raise DescriptionError(
            f"There is no joint '{joint}'.",
            advice=f"Joints of the model: {', '.join(model.arm_joints.names)}.",
            joint=joint,
        )
    return int(model.pin.joints[model.pin.getJointId(joint)].idx_v)


def joint_angle(model: SpacecraftModel, joint: str, q: np.ndarray) -> np.ndarray:
    """Return the angle or position (N,) of a joint from configurations (N, nq) [rad | m]."""
    own = model.pin.joints[model.pin.getJointId(joint)]
    return q[:, own.idx_q] if own.nq == 1 else np.arctan2(q[:, own.idx_q + 1], q[:, own.idx_q])
