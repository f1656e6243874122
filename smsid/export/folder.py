"""Everything another program needs of an identified spacecraft, in one folder: URDFs with its inertias."""

from __future__ import annotations

import csv
import io
import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from smsid._files import atomic_folder, atomic_write, file_stem
from smsid._short_repr import short_repr
from smsid.arm.identify import rigid_arm
from smsid.description import Arm, Description, save_description
from smsid.description.robot_sources import robot_xml
from smsid.description.urdf_check import read_urdf
from smsid.description.urdf_writing import inertial_tag
from smsid.effects.assembly import find_frame
from smsid.effects.inertial_parameters import pinocchio_inertia
from smsid.errors import OutputError
from smsid.estimation.bodies import IdentifiedBodies, identified_bodies, with_estimate
from smsid.export._mjcf import counterparts, write_mjcf
from smsid.identify.estimate import Estimate
from smsid.model import SpacecraftModel, build_model
from smsid.model.load import load_bus, urdf_of
from smsid.model.regressor import INERTIAL_UNITS, Regressor
from smsid.model.rigid_bodies import with_shifts_as_numbers

ROOT = "root_joint"
"""Pinocchio's name of the free joint of the bus."""


@short_repr
@dataclass(frozen=True)
class Export:
    """What was written: names of the files, the bodies behind them (None without an estimate), and notes."""

    folder: Path
    files: tuple[str, ...]
    bodies: IdentifiedBodies | None
    notes: tuple[str, ...]


def export_folder(
    description: Description,
    folder: str | os.PathLike[str],
    estimate: Estimate | None = None,
    *,
    mujoco: bool = True,
) -> Export:
    """Write a description, at an estimate's values if one is given, for other programs.

    ``<name>.urdf`` (and one per mounted arm) with physically consistent inertias, ``<name>.toml`` that smsid
    reads, ``parameters.csv``, and ``<name>.xml``, the whole spacecraft for MuJoCo. The folder appears whole
    or not at all.

    Args:
        description: the spacecraft or arm.
        folder: to make; may exist if it is empty.
        estimate: of this description; None exports the description as it is.
        mujoco: whether to write the MuJoCo XML.

    Raises:
        OutputError: the folder is in use, its parent is missing, or a name in the description is no file's.
        DescriptionError: as `with_estimate`, `identified_bodies` and `write_mjcf`.
    """
    _check_names(description)
    target = Path(folder).resolve()
    with atomic_folder(folder) as temporary:
        files, bodies, notes = _write_files(description, temporary, target, estimate, mujoco)
    return Export(target, tuple(files), bodies, tuple(notes))


def _check_names(d: Description) -> None:
    """Raise `OutputError` where a name is no file's, or two files would have one name."""
    names = [d.name, *(arm.name for arm in d.arm if arm.mounted)]
    taken: dict[str, str] = {}
    for name in map(file_stem, names):
        other = taken.get(name.lower())
        taken[name.lower()] = name
        if other is not None:
            raise OutputError(
                f"'{name}' and '{other}' would be one file, {name}.urdf.",
                advice="Give the spacecraft and its arms different names.",
            )


def _write_files(
    description: Description, folder: Path, target: Path, estimate: Estimate | None, mujoco: bool
) -> tuple[list[str], IdentifiedBodies | None, list[str]]:
    notes: list[str] = []
    found = description
    bodies = None
    if estimate is not None:
        found, notes = with_estimate(description, estimate)
        found = with_shifts_as_numbers(found)  # of the bodies as described, not as they are written
        bodies = identified_bodies(_equations_of(found, estimate.held), estimate)
        notes += bodies.notes
    stem = description.name
    said = {e.name for e in found.effect}
    found = found.with_effects(*(e for e in _equations_of(found).description.effect if e.name not in said))
    moved = _urdfs(found, folder, target, None if bodies is None else bodies.parameters)
    save_description(moved, folder / f"{stem}.toml")
    # from here on with what was written
    atomic_write(folder / "parameters.csv", parameters_csv(moved, _equations_of(moved), estimate))
    if mujoco:
        model = build_model(moved)
        atomic_write(folder / f"{stem}.xml", write_mjcf(model))
        notes += [f.note for f in counterparts(model).values() if f.note]
        aside = [e.name for e in moved.effect if e.on_signals]
        if aside:
            notes.append(f"{', '.join(aside)}: on commands or readings, so not in the MuJoCo XML")
    return sorted(p.name for p in folder.iterdir()), bodies, notes


def _equations_of(description: Description, held: Mapping[str, float] | None = None) -> SpacecraftModel:
    """Return a model for its inertial parameters: links of a welded arm need not be fit to be simulated."""
    return build_model(description) if description.root == "free" else rigid_arm(description, held)


def _urdfs(d: Description, folder: Path, target: Path, bodies: dict[str, np.ndarray] | None) -> Description:
    """Write the URDFs and return the description that refers to them."""
    path, places = urdf_of(d)
    free = d.root == "free"
    losses = _losses(d)
    own = None if bodies is None else {n: x for n, x in bodies.items() if "/" not in n}
    root = bodies.get(ROOT) if bodies is not None and free else None
    text = rewritten_urdf(path, target, own, root=root, losses=losses, arguments=d.arguments, folders=places)
    atomic_write(folder / f"{d.name}.urdf", text)
    arms = []
    for arm in d.arm:
        if not arm.mounted:
            arms.append(arm)
            continue
        path, more = urdf_of(d, arm)
        places += more
        prefix = f"{arm.name}/"
        part = None
        if bodies is not None:
            part = {n.removeprefix(prefix): x for n, x in bodies.items() if n.startswith(prefix)}
        text = rewritten_urdf(
            path,
            target,
            part,
            welded=arm.fixed,
            rootless=bodies is not None and _on_moving_body(d, arm),
            losses={n.removeprefix(prefix): x for n, x in losses.items() if n.startswith(prefix)},
            arguments=arm.arguments,
            folders=places,
        )
        atomic_write(folder / f"{arm.name}.urdf", text)
        arms.append(arm.model_copy(update={"urdf": f"{arm.name}.urdf", "robot": None, "arguments": {}}))
    folders = dict.fromkeys(os.path.relpath(Path(p).resolve(), target) for p in places)
    uses_packages = any("package://" in f.read_text(encoding="utf-8") for f in folder.glob("*.urdf"))
    return d.model_copy(
        update={
            "urdf": f"{d.name}.urdf",
            "arguments": {},
            "arm": tuple(arms),
            "folder": folder,
            "package_dirs": tuple(folders) if uses_packages else (),
        }
    )


def _losses(d: Description) -> dict[str, tuple[float, float]]:
    """Return viscous and Coulomb friction by joint, as far as a URDF can say it: what always acts."""
    found: dict[str, tuple[float, float]] = {}
    for effect in d.effect:
        for joint, own in effect.urdf_dynamics().items():
            viscous, coulomb = found.get(joint, (0.0, 0.0))
            found[joint] = viscous + own[0], coulomb + own[1]
    return found


def _on_moving_body(d: Description, arm: Arm) -> bool:
    """Whether a mounted arm's root link is part of a moving body, which then has its inertia."""
    if arm.mount.frame is None:
        return d.root == "free"
    bus = load_bus(d, False).model
    return bus.frames[find_frame(bus, arm.mount.frame)].parentJoint > 0


def parameters_csv(description: Description, model: SpacecraftModel, estimate: Estimate | None) -> str:
    """Return ``name, value, unit, sigma, low, high, status`` of the estimate, then of the exported bodies.

    Without an estimate the effects' parameters come first, with status ``described`` and their prior.
    """
    out = io.StringIO()
    table = csv.writer(out, lineterminator="\n")
    table.writerow(["name", "value", "unit", "sigma", "low_95", "high_95", "status"])
    if estimate is not None:
        for p in estimate.parameters:
            low, high = p.interval
            row = [repr(float(x)) if np.isfinite(x) else "" for x in (p.value, p.sigma, low, high)]
            table.writerow([p.name, row[0], p.unit, *row[1:], p.status])
    else:
        for effect in description.effect:
            for e in effect.parameters():
                sigma = "" if e.sigma is None else repr(e.sigma)
                table.writerow([e.name, repr(e.value), e.unit, sigma, "", "", "described"])
    regressor = Regressor(model)
    status = "described" if estimate is None else "exported"
    units = INERTIAL_UNITS * len(regressor.bodies)
    for name, x, unit in zip(regressor.names, regressor.parameters, units, strict=True):
        table.writerow([f"body {name}", repr(float(x)), unit, "", "", "", status])
    return out.getvalue()


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
    body = pinocchio_inertia(theta)
    link.insert(0, inertial_tag(body.mass, body.lever, body.inertia))
