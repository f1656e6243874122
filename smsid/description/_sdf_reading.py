"""SDFormat as URDF: the frames of a model resolved, what a URDF cannot say named."""

from __future__ import annotations

import logging
import xml.etree.ElementTree as ElementTree

import numpy as np
import pinocchio as pin

from smsid.description.urdf_reading import Mimic
from smsid.description.urdf_writing import INERTIA, UrdfTree
from smsid.errors import DescriptionError

logger = logging.getLogger(__name__)

KINDS = ("revolute", "continuous", "prismatic", "fixed")
UNLIMITED = 1e16
"""SDFormat's own word for a joint without limits."""


def sdf_to_urdf(content: bytes, source: str) -> bytes:
    """Return the one model of an SDF file as a URDF.

    Poses are resolved by ``relative_to`` over links, joints and frames. A joint that welds a link to the
    world makes that link the root.

    Raises:
        DescriptionError: no XML, not one model, nested models, a joint that no URDF has, or frames in a
            circle.
    """
    try:
        root = ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise DescriptionError(
            f"'{source}' is not well-formed XML: {error}.", advice="Is the file cut short?"
        ) from error
    models = root.findall("model") or root.findall("world/model")
    if len(models) != 1:
        names = ", ".join(str(m.get("name")) for m in models)
        raise DescriptionError(
            f"{source} has {len(models)} models{f': {names}' if names else ''}.", advice="Keep one."
        )
    model = models[0]
    inner = [f"<{tag.tag}> '{tag.get('name')}'" for tag in model if tag.tag in ("model", "include")]
    if inner:
        raise DescriptionError(
            f"{source} holds {', '.join(inner)} within its model.",
            advice="Flatten it first: `gz sdf -p FILE > flat.sdf`.",
        )
    frames = _Frames(model, source)
    tree = UrdfTree(str(model.get("name")))
    for link in model.findall("link"):
        tree.link(str(link.get("name")), *_inertial(link))
    # The frame of a URDF's link is that of its joint: a link that is given elsewhere hangs on one more.
    for joint in model.findall("joint"):
        _add_joint(joint, frames, tree, source)
    for what in _unsupported_parts(model, root):
        logger.warning("%s: not in the URDF made of it: %s.", source, what)
    return tree.text()


def _add_joint(joint: ElementTree.Element, frames: _Frames, tree: UrdfTree, source: str) -> None:
    name, kind = str(joint.get("name")), str(joint.get("type"))
    parent, child = (str(joint.findtext(end, "")).strip() for end in ("parent", "child"))
    if parent == "world":
        if kind != "fixed":
            raise DescriptionError(
                f"Joint '{name}' of {source} moves '{child}' against the world.",
                advice="Name the link it moves against, without mass.",
                joint=name,
            )
        logger.warning("%s: '%s' is welded to the world: state root = \"fixed\".", source, child)
        return
    if kind not in KINDS:
        raise DescriptionError(
            f"Joint '{name}' of {source} is of type '{kind}', which no URDF has.",
            advice="Replace it by revolute and prismatic joints.",
            joint=name,
        )
    parent, child = frames.carrier(parent), frames.carrier(child)
    at = frames.pose(name)
    place = frames.pose(parent).inverse() * at
    offset = at.inverse() * frames.pose(child)
    aside = not offset.isIdentity(1e-12)
    target = f"{name}_frame" if aside else child
    if aside:
        tree.link(target)
        tree.joint(f"{name}_offset", "fixed", target, child, offset.translation, offset.rotation)
    if kind == "fixed":
        tree.joint(name, kind, parent, target, place.translation, place.rotation)
        return
    axis = joint.find("axis")
    if axis is None or joint.find("axis2") is not None:
        raise DescriptionError(f"Joint '{name}' of {source} needs one <axis>.", advice="Give it.", joint=name)
    xyz = axis.find("xyz")
    along = _numbers(axis.findtext("xyz", "0 0 1"), 3, f"<axis> of joint '{name}' of {source}")
    expressed = "" if xyz is None else xyz.get("expressed_in", "")
    if axis.findtext("use_parent_model_frame", "0").strip() in ("1", "true"):
        expressed = "__model__"
    if expressed:
        along = at.rotation.T @ frames.pose(expressed).rotation @ along
    low, high = (_limit(axis, key, sign) for key, sign in (("lower", -1.0), ("upper", 1.0)))
    limited = max(-low, high) < UNLIMITED
    kind = "continuous" if kind == "revolute" and not limited else kind
    force, rate = (_limit(axis, key, 1.0) for key in ("effort", "velocity"))
    loss = [float(axis.findtext(f"dynamics/{key}", "0")) for key in ("damping", "friction")]
    tree.joint(
        name, kind, parent, target, place.translation, place.rotation, axis=along, lower=low, upper=high,
        effort=force, velocity=rate, damping=loss[0], friction=loss[1], mimic=_mimic(axis),
    )  # fmt: skip


class _Frames:
    """Poses of a model's links, joints and frames in the model's."""

    def __init__(self, model: ElementTree.Element, source: str) -> None:
        self.source = source
        self.given: dict[str, tuple[pin.SE3, str]] = {"__model__": (pin.SE3.Identity(), "")}
        self.attached: dict[str, str] = {}
        for tag in ("link", "joint", "frame"):
            for item in model.findall(tag):
                pose = item.find("pose")
                base = "" if pose is None else pose.get("relative_to", "")
                if not base and tag == "joint":
                    base = str(item.findtext("child", "")).strip()
                if not base and tag == "frame":
                    base = item.get("attached_to", "")
                if tag == "frame":
                    self.attached[str(item.get("name"))] = item.get("attached_to", "")
                where = f"<pose> of {tag} '{item.get('name')}' of {source}"
                self.given[str(item.get("name"))] = (_pose(pose, where), base or "__model__")

    def pose(self, name: str) -> pin.SE3:
        """Return where a link, joint or frame is in the model."""
        place, seen = pin.SE3.Identity(), []
        while name != "__model__":
            if name not in self.given or name in seen:
                raise DescriptionError(
                    f"{self.source} refers to the frame '{name}', "
                    + ("in a circle." if name in seen else "which it does not have."),
                    advice="Correct the name.",
                )
            seen.append(name)
            own, name = self.given[name]
            place = own * place
        return place

    def carrier(self, name: str) -> str:
        """Return the link that a joint's end names, be it by a frame."""
        for _ in self.attached:
            name = self.attached.get(name) or name
        return name


def _inertial(link: ElementTree.Element) -> tuple[float, np.ndarray, np.ndarray]:
    """Return mass, centre (3,) and inertia (3, 3) about it, link axes; SDFormat's defaults."""
    where = f"link '{link.get('name')}'"
    tag = link.find("inertial")
    if tag is None:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    pose = _pose(tag.find("pose"), f"<inertial> of {where}")
    about = np.zeros((3, 3))
    for key, (i, j) in INERTIA.items():
        about[i, j] = about[j, i] = float(tag.findtext(f"inertia/{key}", "1" if i == j else "0"))
    return float(tag.findtext("mass", "1")), pose.translation, pose.rotation @ about @ pose.rotation.T


def _pose(tag: ElementTree.Element | None, where: str) -> pin.SE3:
    if tag is None or not (tag.text or "").strip():
        return pin.SE3.Identity()
    if tag.get("rotation_format") == "quat_xyzw":
        x = _numbers(str(tag.text), 7, where)
        return pin.SE3(pin.Quaternion(x[3:]).normalized().matrix(), x[:3])
    x = _numbers(str(tag.text), 6, where)
    angles = np.radians(x[3:]) if tag.get("degrees") in ("1", "true") else x[3:]
    return pin.SE3(pin.rpy.rpyToMatrix(*angles), x[:3])


def _numbers(text: str, count: int, where: str) -> np.ndarray:
    try:
        found = np.array([float(x) for x in text.split()])
    except ValueError:
        found = np.zeros(0)
    if found.size != count or not np.isfinite(found).all():
        raise DescriptionError(f"{where}: '{text.strip()}' is not {count} finite numbers.", advice="Mend it.")
    return found


def _mimic(axis: ElementTree.Element) -> Mimic | None:
    """Return what an axis follows: ``multiplier (leader - reference) + offset``."""
    tag = axis.find("mimic")
    if tag is None:
        return None
    ratio, offset, reference = (
        float(tag.findtext(key, default))
        for key, default in (("multiplier", "1"), ("offset", "0"), ("reference", "0"))
    )
    return Mimic(tag.get("joint", ""), ratio, offset - ratio * reference)


def _limit(axis: ElementTree.Element, key: str, sign: float) -> float:
    """Return a limit; those that are not given, negative where they cannot be, or infinite are far away."""
    value = float(axis.findtext(f"limit/{key}", "inf"))
    if key in ("effort", "velocity") and value < 0.0:
        return UNLIMITED
    return value if np.isfinite(value) and abs(value) < UNLIMITED else sign * UNLIMITED


def _unsupported_parts(model: ElementTree.Element, root: ElementTree.Element) -> list[str]:
    """Return what the model has that the URDF made of it does not say."""
    found = []
    springs = [
        str(j.get("name"))
        for j in model.findall("joint")
        if float(j.findtext("axis/dynamics/spring_stiffness", "0")) != 0.0
    ]
    if springs:
        found.append(f"springs of {', '.join(springs)}")
    for path, what in (
        ("link/visual", "visuals"),
        ("link/collision", "collision shapes"),
        (".//sensor", "sensors"),
        (".//plugin", "plugins"),
        ("gripper", "grippers"),
    ):
        count = len(model.findall(path))
        if count:
            found.append(f"{count} {what}")
    if model.find("link/inertial/fluid_added_mass") is not None:
        found.append("added masses of a fluid")
    return found + ([f"{len(root.findall('world'))} <world>"] if root.find("world") is not None else [])
