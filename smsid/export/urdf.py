"""URDFs with identified inertias, readable from another folder."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np

from smsid.description.robot_sources import robot_xml
from smsid.description.urdf_check import read_urdf
from smsid.effects.inertial_parameters import parameters_to_matrix


def rewritten_urdf(
    path: Path,
    folder: Path,
    bodies: Mapping[str, np.ndarray] | None,
    *,
    root: np.ndarray | None = None,
    welded: Collection[str] = (),
    rootless: bool = False,
    losses: Mapping[str, tuple[float, float]] | None = None,
    arguments: Mapping[str, str] | None = None,
    folders: Sequence[Path] = (),
) -> str:
    """Return the text of a URDF for another folder, with inertias replaced.

    Links welded together carry their inertia on the first of them.

    Args:
        path: the URDF, or what can become one.
        folder: where the text will be; paths of meshes that are relative are made to start there.
        bodies: parameters (10,) by joint of this URDF, in the frame of its child link; None leaves all.
        root: parameters (10,) of the root link's body; None leaves them.
        welded: joints counted as fixed besides those of that type.
        rootless: take the root body's inertia away: another body has it.
        losses: viscous and Coulomb friction by joint, written to ``<dynamics>``; None leaves what is there.
        arguments: of a xacro.
        folders: searched for the packages it includes.

    Raises:
        DescriptionError: the file is missing or no URDF.
    """
    read_urdf(path, arguments, folders)
    parser = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))
    tree = ElementTree.fromstring(robot_xml(path, arguments, folders), parser)
    for mesh in tree.iter("mesh"):
        name = mesh.get("filename", "")
        if "://" not in name and not os.path.isabs(name):
            mesh.set("filename", Path(os.path.relpath((path.parent / name).resolve(), folder)).as_posix())
    links = {link.get("name"): link for link in tree.findall("link")}
    children: dict[str, list[tuple[str, str]]] = {}
    moving: dict[str, str] = {}
    for joint in tree.findall("joint"):
        name, child, parent = joint.get("name", ""), _end(joint, "child"), _end(joint, "parent")
        if joint.get("type") == "fixed" or name in welded:
            children.setdefault(parent, []).append((name, child))
        else:
            moving[name] = child
    has_parent = {_end(joint, "child") for joint in tree.findall("joint")}
    first = next(name for name in links if name not in has_parent)

    def carried(link: str) -> list[str]:
        return [x for _, child in children.get(link, []) for x in (child, *carried(child))]

    for joint, link in moving.items():
        if bodies is not None and joint in bodies:
            _replace(links[link], bodies[joint])
            for other in carried(link):
                _replace(links[other], None)
    if root is not None or rootless:
        _replace(links[first], root)
        for other in carried(str(first)):
            _replace(links[other], None)
    if losses is not None:
        for joint in tree.findall("joint"):
            _set_dynamics(joint, losses.get(joint.get("name", "")))
    ElementTree.indent(tree, "  ")
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(tree, encoding="unicode") + "\n"


def _end(joint: ElementTree.Element, which: str) -> str:
    tag = joint.find(which)
    return "" if tag is None else tag.get("link", "")


def _set_dynamics(joint: ElementTree.Element, loss: tuple[float, float] | None) -> None:
    tag = joint.find("dynamics")
    if loss is None:
        if tag is not None:
            tag.set("damping", "0")
            tag.set("friction", "0")
        return
    if tag is None:
        tag = ElementTree.SubElement(joint, "dynamics")
    tag.set("damping", repr(float(loss[0])))
    tag.set("friction", repr(float(loss[1])))


def _replace(link: ElementTree.Element, theta: np.ndarray | None) -> None:
    for old in link.findall("inertial"):
        link.remove(old)
    if theta is None or not theta[0] > 0.0:
        return
    centre = theta[1:4] / theta[0]
    about = parameters_to_matrix(theta) - theta[0] * (
        (centre @ centre) * np.eye(3) - np.outer(centre, centre)
    )
    new = ElementTree.Element("inertial")
    ElementTree.SubElement(new, "origin", xyz=" ".join(repr(float(x)) for x in centre), rpy="0 0 0")
    ElementTree.SubElement(new, "mass", value=repr(float(theta[0])))
    places = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    ElementTree.SubElement(new, "inertia", {k: repr(float(about[p])) for k, p in places.items()})
    link.insert(0, new)
