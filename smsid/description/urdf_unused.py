"""What stands in a URDF, has or may have a physical meaning, and is not used: it is told, not dropped."""

from __future__ import annotations

import math
from collections.abc import Iterator
from xml.etree.ElementTree import Element

from smsid._listing import some_of

CHILDREN = {
    "inertial": {"origin", "mass", "inertia"},
    "joint": {
        "origin", "parent", "child", "axis", "limit", "dynamics", "mimic", "calibration", "safety_controller",
    },
}  # fmt: skip
"""Elements that belong into another; a misspelt one would leave its default standing."""
ATTRIBUTES = {
    "origin": {"xyz", "rpy"},
    "mass": {"value"},
    "inertia": {"ixx", "ixy", "ixz", "iyy", "iyz", "izz"},
    "axis": {"xyz"},
    "dynamics": {"damping", "friction"},
    "mimic": {"joint", "multiplier", "offset"},
}
GEAR = {"mechanicalReduction": {"", "1", "1.0"}, "motorInertia": {"", "0", "0.0"}}
"""Elements of a transmission, and what leaves the motion as it is."""
GAZEBO = {
    "springStiffness": {"", "0", "0.0"},
    "springReference": {"", "0", "0.0"},
    "dampingFactor": {"", "0", "0.0"},
}
"""The same of Gazebo's extensions."""


def unused_elements(root: Element) -> tuple[str, ...]:
    """Return a phrase for each kind of element with a physical meaning that smsid does not use."""
    found = []
    geared = list(_settings(root, "transmission", "name", GEAR))
    if geared:
        found.append(f"<transmission> {some_of(geared)}: use the effects `gear` and `motor_inertia`")
    extended = list(_settings(root, "gazebo", "reference", GAZEBO))
    if extended:
        found.append(f"<gazebo> {some_of(extended)}: a spring is the effect `joint_cable`")
    unknown = _unknown(root)
    if unknown:
        found.append(f"{some_of(unknown)}: a URDF knows no such thing (misspelt?)")
    undrawn = list(_unreadable_shapes(root))
    if undrawn:
        found.append(f"{some_of(undrawn, 1)}: not the numbers that a shape has")
    loops = [tag.tag for tag in root if tag.tag in ("loop_joint", "constraint")]
    if loops:
        found.append(f"{len(loops)} <{loops[0]}>: closed loops are left open")
    return tuple(found)


def _unreadable_shapes(root: Element) -> Iterator[str]:
    """Yield what urdfdom leaves out of what is drawn, as it cannot read its numbers."""
    for link in root.findall("link"):
        for outer in [*link.findall("visual"), *link.findall("collision")]:
            for tag in outer.iter():
                for key in set(tag.keys()) & {"size", "radius", "length", "xyz", "rpy", "scale"}:
                    try:
                        sound = all(math.isfinite(float(x)) for x in tag.get(key, "").split())
                    except ValueError:
                        sound = False
                    if not sound:
                        yield f"<{outer.tag}> of link '{link.get('name')}' ({key}=\"{tag.get(key)}\")"


def _settings(root: Element, outer: str, named_by: str, neutral: dict[str, set[str]]) -> Iterator[str]:
    for element in root.findall(outer):
        for tag in element.iter():
            text = (tag.text or "").strip()
            if tag.tag in neutral and text.lower() not in neutral[tag.tag]:
                yield f"{element.get(named_by)} ({tag.tag} {text})"


def _unknown(root: Element) -> list[str]:
    """Return elements and attributes of links' inertia and of joints that a URDF does not know."""
    places = [(f"joint '{tag.get('name')}'", tag) for tag in root.findall("joint")]
    for link in root.findall("link"):
        places += [(f"link '{link.get('name')}'", tag) for tag in link.findall("inertial")]
    found: dict[str, list[str]] = {}
    for place, outer in places:
        for tag in outer:
            if tag.tag not in CHILDREN[outer.tag]:
                found.setdefault(f"<{tag.tag}>", []).append(place)
            strange = sorted(set(tag.keys()) - ATTRIBUTES.get(tag.tag, set(tag.keys())))
            if strange:
                found.setdefault(f"{', '.join(strange)} in <{tag.tag}>", []).append(place)
    return [f"{what} of {some_of(there, 1)}" for what, there in found.items()]
