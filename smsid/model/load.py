"""Reading URDFs into Pinocchio models, and mounting one on another."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio as pin

from smsid._listing import some_of
from smsid.description.schema import Arm, Description, did_you_mean
from smsid.description.urdf_check import check_inertias, check_meshes, normalised, read_urdf, without_meshes
from smsid.description.urdf_reading import UrdfReading, parse_urdf
from smsid.errors import DescriptionError
from smsid.model.assembly import find_frame
from smsid.model.built_check import check_built
from smsid.model.robots import robot_urdf
from smsid.model.spacecraft import JointGroup, set_group_angles

logger = logging.getLogger(__name__)


@dataclass
class Loaded:
    """A Pinocchio model with its visuals, if asked for; joint 0 is the universe.

    ``losses``: viscous [N m s/rad | N s/m] and Coulomb friction [N m | N] of the URDFs' ``<dynamics>``, by
    joint.
    """

    model: pin.Model
    visual: pin.GeometryModel | None
    losses: dict[str, tuple[float, float]] = field(default_factory=dict)


def load_bus(d: Description, visuals: bool) -> Loaded:
    """Return the spacecraft's own URDF, on a free-flyer if its root is free."""
    path = d.folder / d.urdf
    folders = [path.parent, d.folder, *(d.folder / p for p in d.package_dirs)]
    root = pin.JointModelFreeFlyer() if d.root == "free" else None
    own = [arm for arm in d.arm if not arm.mounted]
    fixed = tuple(name for arm in own for name in arm.fixed)
    where = "the TOML (before its tables)"
    loaded = _load(path, folders, d, root, visuals, d.inertias == "trusted", where, fixed)
    for arm in own:
        if arm.fixed:
            loaded = _with_fixed(loaded, arm)
    return loaded


def mount_arm(bus: Loaded, arm: Arm, d: Description) -> tuple[Loaded, list[str]]:
    """Return the model with an arm's URDF mounted, and the names of the arm's joints.

    Every joint and frame of the arm gets the prefix ``<arm>/``; its root link becomes part of the body it is
    mounted on. Raises `DescriptionError` for a missing file, frame or robot.
    """
    if arm.robot is not None:
        path, folders = robot_urdf(arm.robot)
    else:
        path = d.folder / str(arm.urdf)
        folders = [path.parent, *(d.folder / p for p in d.package_dirs)]
    trusted = arm.inertias == "trusted"
    child = _load(path, folders, d, None, bus.visual is not None, trusted, f"[[arm]] '{arm.name}'", arm.fixed)
    if arm.fixed:
        child = _with_fixed(child, arm)
    names = []
    for j in range(1, child.model.njoints):
        child.model.names[j] = f"{arm.name}/{child.model.names[j]}"
        names.append(child.model.names[j])
    taken: set[str] = set()
    for k in sorted(range(1, child.model.nframes), key=lambda k: child.model.frames[k].type != pin.BODY):
        name = f"{arm.name}/{child.model.frames[k].name}"
        # a link and a joint may share a name in a URDF, but not when models are appended
        child.model.frames[k].name = f"{name}.joint" if name in taken else name
        taken.add(name)
    losses = {**bus.losses, **{f"{arm.name}/{n}": x for n, x in child.losses.items()}}
    if arm.mount.frame is not None:
        frame = find_frame(bus.model, arm.mount.frame)
    else:
        frame = bus.model.getFrameId(bus.model.names[1], pin.JOINT) if d.root == "free" else 0
    placement = pin.SE3(pin.rpy.rpyToMatrix(*arm.mount.rpy), np.asarray(arm.mount.xyz))
    if bus.visual is None or child.visual is None:
        return Loaded(pin.appendModel(bus.model, child.model, frame, placement), None, losses), names
    for geometry in child.visual.geometryObjects:
        geometry.name = f"{arm.name}/{geometry.name}"
    model, visual = pin.appendModel(bus.model, child.model, bus.visual, child.visual, frame, placement)
    return Loaded(model, visual, losses), names


def _with_fixed(child: Loaded, arm: Arm) -> Loaded:
    """Return an arm's model with its ``fixed`` joints welded at home."""
    model = child.model
    q = pin.neutral(model)
    joints = []
    for name in arm.fixed:
        if not model.existJointName(name):
            known = list(model.names)[1:]
            raise DescriptionError(
                f"`fixed` names joint '{name}', which the URDF does not have." + did_you_mean(name, known),
                advice=f"It has: {', '.join(known)}.",
                joint=name,
            )
        joints.append(model.getJointId(name))
        one = JointGroup.of(model, joints[-1:])
        q = set_group_angles(model, one, q, np.array([arm.home.get(name, 0.0)]))
    losses = {n: x for n, x in child.losses.items() if n not in arm.fixed}
    if child.visual is None:
        return Loaded(pin.buildReducedModel(model, joints, q), None, losses)
    reduced, visual = pin.buildReducedModel(model, child.visual, joints, q)
    return Loaded(reduced, visual, losses)


def _load(
    path: Path,
    folders: list[Path],
    d: Description,
    root: pin.JointModel | None,
    visuals: bool,
    trusted: bool,
    where: str,
    fixed: tuple[str, ...] = (),
) -> Loaded:
    text = read_urdf(path)
    reading = parse_urdf(text, str(path))
    check_inertias(reading, trusted=trusted, where=where)
    if d.meshes == "required":
        check_meshes(text, str(path), folders)
    _tell_unused(reading, fixed)
    text = normalised(text)
    try:
        model = pin.buildModelFromXML(text) if root is None else pin.buildModelFromXML(text, root)
    except (ValueError, RuntimeError) as error:
        raise DescriptionError(
            f"Pinocchio cannot read '{path}': {error}.",
            advice="What urdfdom printed above says where.",
            path=str(path),
        ) from error
    check_built(model, reading, free=root is not None)
    losses = {
        j.name: (j.damping, j.friction)
        for j in reading.joints.values()
        if (j.damping or j.friction) and j.kind in ("revolute", "continuous", "prismatic")
    }
    if not visuals:
        return Loaded(model, None, losses)
    places = [str(f) for f in folders]
    shown = without_meshes(text) if d.meshes == "ignored" else text
    try:
        visual = pin.buildGeomFromUrdfString(model, shown, pin.GeometryType.VISUAL, None, places)
    except (ValueError, RuntimeError) as error:
        raise DescriptionError(
            f"The visuals of '{path}' cannot be loaded: {error}.", advice="Check `package_dirs`."
        ) from error
    return Loaded(model, visual, losses)


def _tell_unused(reading: UrdfReading, fixed: tuple[str, ...]) -> None:
    """Log what of the file has a physical meaning and is not used."""
    followers = [j.name for j in reading.joints.values() if j.mimic is not None and j.name not in fixed]
    if followers:
        logger.warning(
            "%s: joints %s mimic another; here each moves on its own.", reading.source, some_of(followers)
        )
    for what in reading.unused:
        logger.warning("%s: not used: %s.", reading.source, what)
