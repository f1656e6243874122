"""A URDF made link by link, of a robot that was written in another format."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable

import numpy as np
import pinocchio as pin

from smsid.description.urdf_reading import Mimic

INERTIA = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}


class UrdfTree:
    """The ``<robot>`` under construction."""

    def __init__(self, name: str) -> None:
        self.root = ElementTree.Element("robot", name=name)

    def link(
        self,
        name: str,
        mass: float = 0.0,
        centre: np.ndarray | None = None,
        inertia: np.ndarray | None = None,
    ) -> None:
        """Add a link with its mass [kg], centre (3,) [m] and inertia (3, 3) about it, link axes [kg m^2]."""
        link = ElementTree.SubElement(self.root, "link", name=name)
        if centre is None or inertia is None or not (mass > 0.0 or np.any(inertia)):
            return
        link.append(inertial_tag(mass, centre, inertia))

    def joint(
        self,
        name: str,
        kind: str,
        parent: str,
        child: str,
        position: np.ndarray,
        rotation: np.ndarray,
        *,
        axis: np.ndarray | None = None,
        lower: float = -1e9,
        upper: float = 1e9,
        effort: float = 1e9,
        velocity: float = 1e9,
        damping: float = 0.0,
        friction: float = 0.0,
        mimic: Mimic | None = None,
    ) -> None:
        """Add a joint: ``position`` (3,) [m] and ``rotation`` (3, 3) of its frame in the parent link's.

        ``axis`` (3,) in the joint's frame; limits [rad | m], [N m | N], [rad/s | m/s], losses [N m s/rad |
        N s/m], [N m | N].
        """
        joint = ElementTree.SubElement(self.root, "joint", name=name, type=kind)
        ElementTree.SubElement(joint, "parent", link=parent)
        ElementTree.SubElement(joint, "child", link=child)
        angles = pin.rpy.matrixToRpy(np.asarray(rotation, dtype=float))
        ElementTree.SubElement(joint, "origin", xyz=_text(position), rpy=_text(angles))
        if axis is None:
            return
        ElementTree.SubElement(joint, "axis", xyz=_text(axis))
        limit = {"effort": repr(effort), "velocity": repr(velocity)}
        if kind != "continuous":
            limit |= {"lower": repr(float(lower)), "upper": repr(float(upper))}
        ElementTree.SubElement(joint, "limit", limit)
        if damping or friction:
            ElementTree.SubElement(joint, "dynamics", damping=repr(damping), friction=repr(friction))
        if mimic is not None:
            line = {"multiplier": repr(float(mimic.ratio)), "offset": repr(float(mimic.offset))}
            ElementTree.SubElement(joint, "mimic", {"joint": mimic.joint, **line})

    def text(self) -> bytes:
        """Return the file."""
        ElementTree.indent(self.root, "  ")
        return ElementTree.tostring(self.root, encoding="utf-8")


def inertial_tag(mass: float, centre: np.ndarray, inertia: np.ndarray) -> ElementTree.Element:
    """Return the ``<inertial>`` of a mass [kg], its centre (3,) [m] and the inertia (3, 3) about that."""
    tag = ElementTree.Element("inertial")
    ElementTree.SubElement(tag, "origin", xyz=_text(centre), rpy="0 0 0")
    ElementTree.SubElement(tag, "mass", value=repr(float(mass)))
    ElementTree.SubElement(tag, "inertia", {k: repr(float(inertia[p])) for k, p in INERTIA.items()})
    return tag


def _text(values: Iterable[float]) -> str:
    return " ".join(repr(float(x)) for x in values)
