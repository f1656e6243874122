"""Friction that a URDF states in ``<dynamics>``, as effects."""

from __future__ import annotations

import re
from collections.abc import Mapping

from smsid.description.schema import Description
from smsid.effects.friction import JointFriction


def with_urdf_friction(d: Description, losses: Mapping[str, tuple[float, float]]) -> Description:
    """Return the description with an effect `JointFriction` for every joint that loses energy.

    Args:
        d: the description; a friction it has for a joint already stands instead of the URDF's.
        losses: viscous [N m s/rad] and Coulomb friction [N m] by joint; N s/m and N of sliding joints.
    """
    described = {joint for e in d.effect for joint in e.urdf_dynamics()}
    taken = {e.name for e in d.effect}
    more = []
    for joint, (viscous, coulomb) in losses.items():
        if joint in described:
            continue
        name = re.sub(r"[^A-Za-z0-9_-]", "_", joint) + "_friction"
        name = name if name[0].isalpha() else f"joint_{name}"
        while name in taken:
            name += "_"
        taken.add(name)
        more.append(JointFriction(name=name, joint=joint, viscous=viscous, coulomb=coulomb))
    return d.with_effects(*more) if more else d
