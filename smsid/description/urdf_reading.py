"""Our own strict reading of a URDF: what a model built from it must have, and what of it is not used."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from smsid._listing import some_of
from smsid.errors import DescriptionError

INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
OF_A_JOINT = ("origin", "parent", "child", "axis", "limit", "dynamics", "mimic")


@dataclass(frozen=True)
class LinkReading:
    """A link: mass [kg], centre (3,) [m] and inertia (3, 3) about the centre, link axes [kg m^2]."""

    name: str
    mass: float
    centre: np.ndarray
    inertia: np.ndarray


@dataclass(frozen=True)
class Mimic:
    """Where a joint is, by that of another: ``ratio`` times it, plus ``offset`` [rad | m]."""

    joint: str
    ratio: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class JointReading:
    """A joint: ``position`` (3,) [m] and ``rotation`` (3, 3) of its frame in the parent link's, ``axis`` (3,)
    of unit length, limits (None: not stated) [rad | m], [N m | N], [rad/s | m/s], and ``<dynamics>``.
    """

    name: str
    kind: str
    parent: str
    child: str
    position: np.ndarray
    rotation: np.ndarray
    axis: np.ndarray
    lower: float | None
    upper: float | None
    effort: float | None
    velocity: float | None
    damping: float
    friction: float
    mimic: Mimic | None


@dataclass(frozen=True)
class UrdfReading:
    """The links and joints of a URDF by name; ``unused`` names what has a meaning smsid does not use."""

    source: str
    links: dict[str, LinkReading]
    joints: dict[str, JointReading]
    unused: tuple[str, ...]

    @property
    def root(self) -> str:
        """Name of the link without parent."""
        children = {j.child for j in self.joints.values()}
        return next(name for name in self.links if name not in children)


def parse_urdf(text: str, source: str) -> UrdfReading:
    """Return the links and joints of a URDF's text, every number read strictly.

    ``source`` is the file's name for messages. The tree of links is taken as checked (`read_urdf`).

    Raises:
        DescriptionError: a number, vector or element that is no such thing, naming link or joint and element;
            an axis 0 0 0; limits upside down; an element that stands twice where one holds.
    """
    root = ElementTree.fromstring(text)
    links = {str(tag.get("name")): _link(tag, source) for tag in root.findall("link")}
    joints = {str(tag.get("name")): _joint(tag, source) for tag in root.findall("joint")}
    return UrdfReading(source, links, joints, unused_elements(root))


def _link(tag: ElementTree.Element, source: str) -> LinkReading:
    place = f"link '{tag.get('name')}' of {source}"
    _require_single(tag, ("inertial",), place)
    inertial = tag.find("inertial")
    if inertial is None:
        return LinkReading(str(tag.get("name")), 0.0, np.zeros(3), np.zeros((3, 3)))
    _require_single(inertial, ("origin", "mass", "inertia"), f"the <inertial> of {place}")
    mass_tag, inertia_tag = inertial.find("mass"), inertial.find("inertia")
    if mass_tag is None or inertia_tag is None:
        raise _fault(tag, f"{_upper(place)} has an <inertial> without <mass> or <inertia>.", "Give both.")
    mass = _number(mass_tag, "value", f"The mass of {place}")
    if mass < 0.0:
        text = f"{_upper(place)} has mass {mass:g} kg."
        raise _fault(tag, text, "A mass must be zero or positive.", mass=mass)
    xx, xy, xz, yy, yz, zz = (_number(inertia_tag, key, f"The inertia of {place}") for key in INERTIA)
    position, rotation = _origin(inertial, f"<inertial> of {place}")
    about = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return LinkReading(str(tag.get("name")), mass, position, rotation @ about @ rotation.T)


def _joint(tag: ElementTree.Element, source: str) -> JointReading:
    kind = str(tag.get("type"))
    place = f"joint '{tag.get('name')}' of {source}"
    _require_single(tag, OF_A_JOINT, place)
    position, rotation = _origin(tag, place)
    axis = np.array([1.0, 0.0, 0.0])
    axis_tag = tag.find("axis")
    if axis_tag is not None and kind not in ("fixed", "floating"):
        axis = _vector(axis_tag, "xyz", f"<axis> of {place}", "1 0 0")
        if not np.linalg.norm(axis) > 1e-9:
            text = f"The <axis> of {place} is {axis_tag.get('xyz')}: it has no direction."
            raise _fault(tag, text, "Give the axis the joint turns about or slides along.")
    read = _limits(tag, kind, place)
    losses, dynamics = [], tag.find("dynamics")
    for key in ("damping", "friction"):
        losses.append(0.0 if dynamics is None else _number(dynamics, key, f"<dynamics> of {place}", "0"))
        if losses[-1] < 0.0:
            text = f"<dynamics> of {place} has {key} = {losses[-1]:g}."
            raise _fault(tag, text, "Friction takes energy out: give zero or a positive number.")
    follows, mimic = tag.find("mimic"), None
    if follows is not None and kind != "fixed":
        numbers = (("multiplier", "1"), ("offset", "0"))
        line = (_number(follows, key, f"<mimic> of {place}", default) for key, default in numbers)
        mimic = Mimic(follows.get("joint", ""), *line)
    return JointReading(
        str(tag.get("name")),
        kind,
        _end(tag, "parent"),
        _end(tag, "child"),
        position,
        rotation,
        axis / np.linalg.norm(axis),
        **read,
        damping=losses[0],
        friction=losses[1],
        mimic=mimic,
    )


def _limits(tag: ElementTree.Element, kind: str, place: str) -> dict[str, float | None]:
    limit = tag.find("limit")
    read: dict[str, float | None] = dict.fromkeys(("lower", "upper", "effort", "velocity"))
    ranged = kind in ("revolute", "prismatic")
    missing = [k for k in ("effort", "velocity") if limit is not None and limit.get(k) is None]
    if missing or (ranged and limit is None):
        what = f"has a <limit> without {' and '.join(missing)}" if missing else "has no <limit>"
        turning = ", or make it continuous" if kind == "revolute" else ""
        advice = f"Give <limit lower upper effort velocity>{turning}."
        raise _fault(tag, f"{_upper(place)} is {kind} and {what}.", advice)
    if limit is None or kind in ("fixed", "floating"):
        return read
    for key in read:
        if limit.get(key) is not None:
            read[key] = _number(limit, key, f"<limit> of {place}", infinite=True)
    low, high = read["lower"] or 0.0, read["upper"] or 0.0
    if ranged and low > high:
        text = f"The limits of {place} are upside down: lower = {low:g}, upper = {high:g}."
        raise _fault(tag, text, "Swap them.")
    for key in ("effort", "velocity"):
        if (read[key] or 0.0) < 0.0:
            text = f"<limit> of {place} has {key} = {read[key]:g}."
            raise _fault(tag, text, "Give its size, not a negative number.")
    return read


def _fault(tag: ElementTree.Element, text: str, advice: str, **evidence: float) -> DescriptionError:
    return DescriptionError(text, advice=advice, **{tag.tag: tag.get("name")}, **evidence)


def _require_single(tag: ElementTree.Element, names: Sequence[str], place: str) -> None:
    """Raise `DescriptionError` for an element that stands there twice: which of them holds is open."""
    for name in names:
        count = len(tag.findall(name))
        if count > 1:
            raise _fault(tag, f"{_upper(place)} has {count} <{name}>.", "Keep one.")


def _origin(tag: ElementTree.Element, place: str) -> tuple[np.ndarray, np.ndarray]:
    origin = tag.find("origin")
    if origin is None:
        return np.zeros(3), np.eye(3)
    xyz = _vector(origin, "xyz", f"<origin> in {place}", "0 0 0")
    return xyz, pin.rpy.rpyToMatrix(_vector(origin, "rpy", f"<origin> in {place}", "0 0 0"))


def _vector(tag: ElementTree.Element, key: str, place: str, default: str) -> np.ndarray:
    text = tag.get(key, default)
    try:
        numbers = np.array([_strict(x) for x in text.split()])
    except ValueError:
        numbers = np.zeros(0)
    if len(numbers) != 3 or not np.isfinite(numbers).all():
        raise DescriptionError(
            f'{place}: {key}="{text}" is not three finite numbers.',
            advice="Separate them with blanks, with points for decimals.",
            element=tag.tag,
        )
    return numbers


def _number(
    tag: ElementTree.Element, key: str, place: str, default: str = "missing", *, infinite: bool = False
) -> float:
    text = tag.get(key, default)
    try:
        number = _strict(text.strip())
    except ValueError:
        number = float("nan")
    if np.isnan(number) or (np.isinf(number) and not (infinite and "inf" in text.lower())):  # 1e400 is none
        raise DescriptionError(f"{place} has {key} = '{text}'.", advice="Give a finite number.")
    return number


def _strict(text: str) -> float:
    """Return a number written as in C: no ``1_000``, which Python would take."""
    if "_" in text:
        raise ValueError(text)
    return float(text)


def _end(tag: ElementTree.Element, which: str) -> str:
    end = tag.find(which)
    return "" if end is None else str(end.get("link"))


def _upper(text: str) -> str:
    return text[:1].upper() + text[1:]


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
    unknown = _unknown_elements(root)
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


def _unknown_elements(root: Element) -> list[str]:
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
