"""The usual effects of every joint of an arm, in one call."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from smsid.description import Description
from smsid.effects import Effect, JointFriction, MotorInertia, TorqueOffset
from smsid.errors import DescriptionError

Kind = Literal["joint_friction", "motor_inertia", "torque_offset"]
_MAKERS: dict[str, tuple[str, type[Effect]]] = {
    "joint_friction": ("friction", JointFriction),
    "motor_inertia": ("rotor", MotorInertia),
    "torque_offset": ("bias", TorqueOffset),
}


def with_joint_effects(description: Description, joints: Sequence[str], *kinds: Kind) -> Description:
    """Return the description with an effect of each kind on each joint that has none of it yet.

    They start at zero and are named ``friction_<joint>``, ``rotor_<joint>`` and ``bias_<joint>`` (with
    ``-`` for what a name cannot hold).

    Raises:
        DescriptionError: an unknown kind, or a name is taken.
    """
    new: list[Effect] = []
    taken = {(e.kind, getattr(e, "joint", "")) for e in description.effect}
    names = {e.name for e in description.effect}
    for kind in kinds:
        if kind not in _MAKERS:
            raise DescriptionError(
                f"There is no joint effect '{kind}'.", advice=f"Choose of {', '.join(_MAKERS)}."
            )
        prefix, cls = _MAKERS[kind]
        for joint in joints:
            if (kind, joint) in taken:
                continue
            name = f"{prefix}_{joint.replace('/', '-')}"
            if name in names:
                raise DescriptionError(f"An effect '{name}' is there already.", advice="Rename it.")
            start = {"inertia": 0.0} if kind == "motor_inertia" else {}
            new.append(cls.model_validate({"name": name, "joint": joint, **start}))
    return description.with_effects(*new)
