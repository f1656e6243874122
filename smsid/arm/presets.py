"""The usual effects of every joint of an arm, in one call."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from fnmatch import fnmatch
from typing import Literal, get_args

from smsid.description import Description
from smsid.effects import Effect, JointCable, JointFriction, MotorInertia, Servo, TorqueOffset
from smsid.effects.friction import frictions_of
from smsid.effects.friction_law import Law
from smsid.effects.joint_bias import without_idle_offsets
from smsid.errors import DescriptionError

Kind = Literal["joint_friction", "motor_inertia", "torque_offset", "joint_cable", "servo"]
_MAKERS: dict[Kind, tuple[str, type[Effect]]] = {
    "joint_friction": ("friction", JointFriction),
    "motor_inertia": ("rotor", MotorInertia),
    "torque_offset": ("bias", TorqueOffset),
    "joint_cable": ("spring", JointCable),
    "servo": ("servo", Servo),
}


def with_joint_effects(description: Description, joints: Sequence[str], *kinds: Kind) -> Description:
    """Return the description with an effect of each kind on each joint that has none of it yet.

    They start at zero (servos at a guess) and are named ``friction_<joint>``, ``rotor_<joint>``,
    ``bias_<joint>``, ``spring_<joint>`` and ``servo_<joint>`` (with ``-`` for what a name cannot hold).

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
            name = _name(prefix, joint)
            if name in names:
                raise DescriptionError(f"An effect '{name}' is there already.", advice="Rename it.")
            start = {"inertia": 0.0} if kind == "motor_inertia" else {}
            new.append(cls.model_validate({"name": name, "joint": joint, **start}))
    return description.with_effects(*new)


def with_identified_effects(
    description: Description, joints: Sequence[str], names: Collection[str]
) -> Description:
    """Return the description of an arm with the effects of `with_joint_effects` that have parameters among
    ``names``: those of an estimate that was made without a description.
    """
    for kind, (prefix, _) in _MAKERS.items():
        own = [j for j in joints if any(n.startswith(f"{_name(prefix, j)}.") for n in names)]
        description = with_joint_effects(description, own, kind)
    return description


def _name(prefix: str, joint: str) -> str:
    return f"{prefix}_{joint.replace('/', '-')}"


def with_friction_laws(description: Description, joints: Sequence[str], chosen: Sequence[str]) -> Description:
    """Return the description whose joints have more terms of friction to identify.

    A joint without friction gets one. A constant torque (`TorqueOffset`) without a value, beside Coulomb
    friction that differs by direction, is left out: one is the other but at rest.

    Args:
        description: of a welded arm.
        joints: its joints.
        chosen: names of laws, ``direction``, or ``direction=shoulder_*`` for some joints.

    Raises:
        DescriptionError: no such law, or no such joint.
    """
    laws: dict[str, list[Law]] = {}
    for text in chosen:
        name, _, pattern = text.partition("=")
        law = next((x for x in get_args(Law) if x == name), None)
        if law is None:
            raise DescriptionError(
                f"There is no law of friction '{name}'.",
                advice=f"Choose of {', '.join(get_args(Law))}; viscous and Coulomb are always there.",
            )
        fitting = [j for j in joints if fnmatch(j, pattern or "*")]
        if not fitting:
            raise DescriptionError(
                f"--friction '{text}' fits no joint.", advice=f"Joints of the model: {', '.join(joints)}."
            )
        for joint in fitting:
            laws.setdefault(joint, []).append(law)
    description = with_joint_effects(description, list(laws), "joint_friction")
    kept = without_idle_offsets(description.effect, [j for j, own in laws.items() if "direction" in own])
    frictions = frictions_of(kept)
    described = description.model_copy(update={"effect": tuple(kept)})
    return described.with_effects(*(frictions[j].with_laws(*own) for j, own in laws.items()))
