"""Drawing the inertias of links: a URDF whose bodies differ from the described ones, and stay physical."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio as pin

from smsid.campaign.vary import Generators, Variation, matching_names
from smsid.description.robots import robot_urdf
from smsid.description.schema import Arm, Description
from smsid.description.urdf_check import read_urdf
from smsid.description.urdf_writing import INERTIA
from smsid.errors import ExperimentError


@dataclass(frozen=True)
class UrdfPart:
    """A URDF of a spacecraft: its own (``arm`` is ``None``) or an arm's; ``prefix`` of its links' names."""

    path: Path
    prefix: str
    arm: Arm | None
    folders: tuple[Path, ...]
    arguments: Mapping[str, str] = field(default_factory=dict)

    def text(self) -> str:
        """Return the URDF; raises `DescriptionError`."""
        return read_urdf(self.path, self.arguments, self.folders)

    def links(self) -> list[str]:
        """Return the prefixed names of the links that have a mass."""
        root = ElementTree.fromstring(self.text())
        return [self.prefix + str(link.get("name")) for link in root.iter("link") if _mass(link) > 0.0]


def urdf_parts(description: Description) -> tuple[UrdfPart, ...]:
    """Return the URDFs a description names, its own first; raises `DescriptionError` for a missing robot."""
    own = description.folder / description.urdf
    parts = [UrdfPart(own, "", None, (own.parent,), description.arguments)]
    for arm in description.arm:
        if arm.robot is not None:
            path, folders = robot_urdf(arm.robot)
            parts.append(UrdfPart(path, f"{arm.name}/", arm, (path.parent, *folders)))
        elif arm.urdf is not None:
            path = description.folder / arm.urdf
            parts.append(UrdfPart(path, f"{arm.name}/", arm, (path.parent,), arm.arguments))
    return tuple(parts)


def link_sigmas(variations: Iterable[Variation], parts: Iterable[UrdfPart]) -> dict[str, float]:
    """Return the relative standard deviation [1] of every link that is drawn.

    Raises `ExperimentError` for a pattern that matches no link with mass, or a link drawn twice.
    """
    wanted = [v for v in variations if v.links is not None]
    if not wanted:
        return {}
    names = [name for part in parts for name in part.links()]
    out: dict[str, float] = {}
    for variation in wanted:
        for name in matching_names(variation.links or (), names, "link with mass"):
            if name in out:
                raise ExperimentError(f"Link '{name}' is drawn twice.", advice="Name it in one table only.")
            out[name] = float(variation.relative or 0.0)
    return out


def with_drawn_inertias(
    description: Description, variations: Iterable[Variation], rng: Generators, folder: Path
) -> Description:
    """Return the description with inertias of links drawn; its new URDFs are written to ``folder``.

    Raises `ExperimentError` as `link_sigmas`, `DescriptionError` for a URDF that cannot be read.
    """
    parts = urdf_parts(description)
    sigmas = link_sigmas(variations, parts)
    if not sigmas:
        return description
    package_dirs = list(description.package_dirs)
    own, arms = description.urdf, {arm.name: arm for arm in description.arm}
    for number, part in enumerate(parts):
        chosen = {n.removeprefix(part.prefix): s for n, s in sigmas.items() if _belongs(n, part)}
        if not chosen:
            continue
        file = folder / f"{number}_{part.path.stem}.urdf"
        file.write_text(_drawn_urdf(part, chosen, rng), encoding="utf-8")
        package_dirs += [str(place.resolve()) for place in part.folders]
        if part.arm is None:
            own = str(file)
        else:
            arms[part.arm.name] = part.arm.model_copy(
                update={"urdf": str(file), "robot": None, "arguments": {}}
            )
    return description.model_copy(
        update={"urdf": own, "arm": tuple(arms.values()), "package_dirs": tuple(package_dirs)}
    )


def drawn_inertia(
    mass: float, inertia: np.ndarray, relative: float, rng: np.random.Generator
) -> tuple[float, np.ndarray, np.ndarray]:
    """Return mass [kg], centre of mass (3,) [m] and inertia about it (3, 3) [kg m^2] of a body drawn around
    one of ``mass`` and ``inertia`` (3, 3) about its centre of mass, which is the origin.

    The pseudo-inertia J = L L^T becomes L exp(relative S) L^T, S symmetric with entries of variance 1 on the
    diagonal and 1/2 off it. So mass and principal second moments vary by ``relative`` [1], the centre of mass
    by ``relative``/sqrt(2) of the body's extent, the principal axes turn, and any draw is a physical body.
    """
    second = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    values, axes = np.linalg.eigh(second)
    root = np.zeros((4, 4))
    root[:3, :3] = axes * np.sqrt(np.maximum(values, 0.0))
    root[3, 3] = np.sqrt(mass)
    g = rng.standard_normal((4, 4))
    symmetric = np.tril(g, -1) / np.sqrt(2.0)
    size, vectors = np.linalg.eigh(symmetric + symmetric.T + np.diag(np.diag(g)))
    drawn = root @ (vectors * np.exp(relative * size)) @ vectors.T @ root.T
    new_mass = float(drawn[3, 3])
    centre = drawn[:3, 3] / new_mass
    about = drawn[:3, :3] - new_mass * np.outer(centre, centre)
    about = 0.5 * (about + about.T)
    return new_mass, centre, np.trace(about) * np.eye(3) - about


def _drawn_urdf(part: UrdfPart, sigmas: Mapping[str, float], rng: Generators) -> str:
    root = ElementTree.fromstring(part.text())
    for link in root.iter("link"):
        name = str(link.get("name"))
        if name in sigmas:
            _draw_link(link, sigmas[name], rng(f"link {part.prefix}{name}"))
    return ElementTree.tostring(root, encoding="unicode")


def _draw_link(link: ElementTree.Element, relative: float, rng: np.random.Generator) -> None:
    inertial = link.find("inertial")
    mass_tag = link.find("inertial/mass")
    tag = link.find("inertial/inertia")
    if inertial is None or mass_tag is None or tag is None:
        return
    xx, xy, xz, yy, yz, zz = (float(tag.get(k, "0")) for k in INERTIA)
    mass, centre, about = drawn_inertia(
        float(mass_tag.get("value", "0")), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), relative, rng
    )
    origin = inertial.find("origin")
    if origin is None:
        origin = ElementTree.SubElement(inertial, "origin", {"xyz": "0 0 0", "rpy": "0 0 0"})
    place = np.array(origin.get("xyz", "0 0 0").split(), dtype=float)
    turn = np.array(origin.get("rpy", "0 0 0").split(), dtype=float)
    place = place + pin.rpy.rpyToMatrix(*turn) @ centre
    origin.set("xyz", " ".join(repr(float(x)) for x in place))
    mass_tag.set("value", repr(mass))
    for key, place in INERTIA.items():
        tag.set(key, repr(float(about[place])))


def _belongs(name: str, part: UrdfPart) -> bool:
    return name.startswith(part.prefix) if part.prefix else "/" not in name


def _mass(link: ElementTree.Element) -> float:
    tag = link.find("inertial/mass")
    try:
        return 0.0 if tag is None else float(tag.get("value", "0"))
    except ValueError:
        return 0.0  # `build_model` says what is wrong with it
