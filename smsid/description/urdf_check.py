"""Checks of a URDF before Pinocchio sees it: errors that name the link and say what to mend."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from smsid.description.robot_sources import robot_xml
from smsid.description.urdf_reading import INERTIA, UrdfReading
from smsid.errors import DescriptionError

NUMBERS = {"value", "xyz", "rpy", "lower", "upper", "effort", "velocity", "damping", "friction", *INERTIA}
JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")


def read_urdf(path: Path, arguments: Mapping[str, str] | None = None, folders: Sequence[Path] = ()) -> str:
    """Return the text of a robot's file as a URDF, decoded as it declares; see `robot_xml`.

    Raises `DescriptionError` if it is missing, not XML, cannot become a URDF, or is not a tree of links.
    """
    content = robot_xml(path, arguments, folders)
    try:
        root = ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise DescriptionError(
            f"'{path}' is not well-formed XML: {error}.",
            advice="Is the file cut short? Mend the line it names.",
        ) from error
    if root.tag != "robot" or root.find("link") is None:
        raise DescriptionError(
            f"'{path}' is no URDF: it needs a <robot> with links.", advice="Is it the right file?"
        )
    _check_tree(root, str(path))
    return ElementTree.tostring(root, encoding="unicode")


def _check_tree(root: ElementTree.Element, source: str) -> None:
    """Raise `DescriptionError` for joints between links that do not exist, names used twice, or two roots."""
    links = [link.get("name", "") for link in root.findall("link")]
    joints = root.findall("joint")
    for label, names in (("links", links), ("joints", [j.get("name", "") for j in joints])):
        twice = sorted({n for n in names if names.count(n) > 1})
        if twice:
            raise DescriptionError(
                f"Two {label} of {source} are named {', '.join(map(repr, twice))}.", advice="Rename one."
            )
    children = []
    for joint in joints:
        name, kind = joint.get("name"), joint.get("type")
        if kind not in JOINT_TYPES:
            raise DescriptionError(
                f"Joint '{name}' of {source} has type '{kind}'.",
                advice=f"Types of URDF: {', '.join(JOINT_TYPES)}.",
            )
        for end in ("parent", "child"):
            tag = joint.find(end)
            link = None if tag is None else tag.get("link")
            if link not in links:
                raise DescriptionError(
                    f"The {end} of joint '{name}' of {source} is link '{link}', which does not exist.",
                    advice="Correct its name or add the link.",
                )
            if end == "child":
                children.append(link)
        if kind in ("revolute", "prismatic") and joint.find("limit") is None:
            raise DescriptionError(
                f"Joint '{name}' of {source} has no <limit>, which a {kind} joint needs.",
                advice='Give one, or make a turning joint "continuous".',
            )
    twice = sorted({c for c in children if c is not None and children.count(c) > 1})
    if twice:
        by = [str(j.get("name")) for j, child in zip(joints, children, strict=True) if child == twice[0]]
        raise DescriptionError(
            f"Link '{twice[0]}' of {source} has {len(by)} parents, by the joints {', '.join(map(repr, by))}: "
            "a closed loop.",
            advice="A URDF is a tree: every link is the child of one joint. Remove one of them.",
            link=twice[0],
            joints=by,
        )
    roots = [link for link in links if link not in children]
    if len(roots) != 1:
        raise DescriptionError(
            f"The links of {source} are no tree: {len(roots)} have no parent ({', '.join(roots) or 'none'}).",
            advice="Every link but the root must be the child of exactly one joint.",
        )


def check_inertias(reading: UrdfReading, *, trusted: bool = False, where: str = "the TOML") -> None:
    """Raise `DescriptionError` for an inertia no rigid body can have.

    A principal moment may be zero (a thin rod), but not negative, and no moment may exceed the sum of the
    other two (triangle inequality), to one part in 1e3 of the largest. ``trusted`` leaves out the test of
    the moments; ``where`` says in the advice where the key ``inertias`` belongs.
    """
    if trusted:
        return
    for link in reading.links.values():
        moments = np.linalg.eigvalsh(link.inertia)
        slack = 1e-3 * max(abs(moments[-1]), 1e-12)
        if moments[0] < -slack or moments[2] > moments[0] + moments[1] + slack:
            raise DescriptionError(
                f"The inertia of link '{link.name}' of {reading.source} is impossible: principal moments "
                f"{', '.join(f'{m:.4g}' for m in moments)} kg m^2.",
                advice="Moments must be positive, none larger than the sum of the other two; check the "
                "signs of the products and whether it is taken about the centre of mass. To take the "
                f'inertias as they are, set `inertias = "trusted"` in {where}.',
                link=link.name,
                moments=moments,
            )


def normalise_urdf(text: str) -> str:
    """Return the URDF with its numbers as they were read, for a reader that is less careful.

    Blanks around a number, of which urdfdom makes a link without mass, are gone.
    """
    root, same = ElementTree.fromstring(text), True
    for tag in root.iter():
        if tag.tag in ("mass", "inertia", "limit", "dynamics", "origin", "axis"):
            for key in NUMBERS & set(tag.keys()):
                read = str(tag.get(key))
                plain = " ".join(read.split())
                same = same and plain == read
                tag.set(key, plain)
    return text if same else ElementTree.tostring(root, encoding="unicode")


def without_meshes(text: str) -> str:
    """Return the URDF without the visuals that are meshes."""
    root = ElementTree.fromstring(text)
    for link in root.iter("link"):
        for visual in link.findall("visual"):
            if visual.find("geometry/mesh") is not None:
                link.remove(visual)
    return ElementTree.tostring(root, encoding="unicode")


def package_folders(text: str, path: Path) -> list[Path]:
    """Return the folders above a URDF that hold a package its meshes are named in (``package://NAME/...``)."""
    names = [mesh.get("filename", "") for mesh in ElementTree.fromstring(text).iter("mesh")]
    packages = {n.removeprefix("package://").partition("/")[0] for n in names if n.startswith("package://")}
    return [place for place in path.resolve().parents if any((place / p).is_dir() for p in packages if p)]


def check_meshes(text: str, source: str, folders: Iterable[Path]) -> None:
    """Raise `DescriptionError` if a mesh the URDF names is in none of the folders."""
    places = list(folders)
    for link in ElementTree.fromstring(text).iter("link"):
        for mesh in link.iter("mesh"):
            name = mesh.get("filename", "")
            relative = name.removeprefix("package://").removeprefix("file://").removeprefix("/")
            absolute = Path(name.removeprefix("file://"))
            if absolute.is_file() or any((place / relative).is_file() for place in places):
                continue
            raise DescriptionError(
                f"Mesh '{name}' of link '{link.get('name')}' in {source} is missing.",
                advice='Add its folder to `package_dirs`, or set `meshes = "ignored"` to do without visuals.',
                mesh=name,
                searched=[str(p) for p in places],
            )
