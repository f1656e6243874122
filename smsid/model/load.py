"""Reading URDFs into Pinocchio models that are checked against the file, and mounting one on another."""

from __future__ import annotations

import logging
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from smsid._listing import did_you_mean, some_of
from smsid.description.robots import robot_urdf
from smsid.description.schema import Arm, Description
from smsid.description.urdf_check import (
    check_inertias,
    check_meshes,
    normalise_urdf,
    package_folders,
    read_urdf,
    without_meshes,
)
from smsid.description.urdf_reading import JointReading, LinkReading, Mimic, UrdfReading, parse_urdf
from smsid.effects.assembly import find_frame
from smsid.effects.inertial_parameters import matrix_to_parameters
from smsid.errors import DescriptionError
from smsid.model.followers import Followers, mimics_of
from smsid.model.spacecraft import JointGroup, motion_columns, set_group_angles

logger = logging.getLogger(__name__)


@dataclass
class LoadedModel:
    """A Pinocchio model with its visuals, if asked for; joint 0 is the universe.

    ``losses``: viscous [N m s/rad | N s/m] and Coulomb friction [N m | N] of the URDFs' ``<dynamics>``, by
    joint; ``mimics``: its joints that follow another.
    """

    model: pin.Model
    visual: pin.GeometryModel | None
    losses: dict[str, tuple[float, float]] = field(default_factory=dict)
    mimics: dict[str, Mimic] = field(default_factory=dict)


def urdf_of(d: Description, arm: Arm | None = None) -> tuple[Path, list[Path]]:
    """Return the URDF of the spacecraft, or of a mounted arm, and the folders searched for packages.

    Raises `DescriptionError` for a robot that there is not.
    """
    if arm is not None and arm.robot is not None:
        return robot_urdf(arm.robot)
    path = d.folder / str(d.urdf if arm is None else arm.urdf)
    return path, [path.parent, d.folder, *(d.folder / p for p in d.package_dirs)]


def load_bus(d: Description, visuals: bool) -> LoadedModel:
    """Return the spacecraft's own URDF, on a free-flyer if its root is free."""
    return _load(d, None, pin.JointModelFreeFlyer() if d.root == "free" else None, visuals)


def mount_arm(bus: LoadedModel, arm: Arm, d: Description) -> tuple[LoadedModel, list[str]]:
    """Return the model with an arm's URDF mounted, and the names of the arm's joints.

    Every joint and frame of the arm gets the prefix ``<arm>/``; its root link becomes part of the body it is
    mounted on. Raises `DescriptionError` for a missing file, frame or robot.
    """
    child = _load(d, arm, None, bus.visual is not None)
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
    mimics = dict(bus.mimics)
    for name, mimic in child.mimics.items():
        mimics[f"{arm.name}/{name}"] = replace(mimic, joint=f"{arm.name}/{mimic.joint}")
    if arm.mount.frame is not None:
        frame = find_frame(bus.model, arm.mount.frame)
    else:
        frame = bus.model.getFrameId(bus.model.names[1], pin.JOINT) if d.root == "free" else 0
    placement = pin.SE3(pin.rpy.rpyToMatrix(*arm.mount.rpy), np.asarray(arm.mount.xyz))
    if bus.visual is None or child.visual is None:
        return LoadedModel(
            pin.appendModel(bus.model, child.model, frame, placement), None, losses, mimics
        ), names
    for geometry in child.visual.geometryObjects:
        geometry.name = f"{arm.name}/{geometry.name}"
    model, visual = pin.appendModel(bus.model, child.model, bus.visual, child.visual, frame, placement)
    return LoadedModel(model, visual, losses, mimics), names


def _with_fixed(child: LoadedModel, arm: Arm) -> LoadedModel:
    """Return an arm's model with its ``fixed`` joints welded at home."""
    model = child.model
    q = pin.neutral(model)
    for name in arm.fixed:
        if not model.existJointName(name):
            known = list(model.names)[1:]
            raise DescriptionError(
                f"`fixed` names joint '{name}', which the URDF does not have." + did_you_mean(name, known),
                advice=f"It has: {', '.join(known)}.",
                joint=name,
            )
        one = JointGroup.of(model, [model.getJointId(name)])
        q = set_group_angles(one, q, np.array([arm.home.get(name, 0.0)]))
    led = {n: m for n, m in child.mimics.items() if m.joint in arm.fixed and n not in arm.home}
    following = Followers.of(model, led)
    return _weld_joints(child, arm.fixed, q if following is None else following.place_followers(model, q))


def _weld_joints(loaded: LoadedModel, names: Sequence[str], q: np.ndarray) -> LoadedModel:
    """Return a model with joints welded at the configuration q (nq,), those that follow them with them."""
    if not names:
        return loaded
    mimics = {n: m for n, m in loaded.mimics.items() if n not in names}
    led = {n: m for n, m in mimics.items() if m.joint in names}
    if led:
        following = Followers.of(loaded.model, led)
        assert following is not None
        q, names = following.place_followers(loaded.model, q), [*names, *led]
    joints = [loaded.model.getJointId(name) for name in names]
    losses = {n: x for n, x in loaded.losses.items() if n not in names}
    mimics = {n: m for n, m in mimics.items() if n not in led}
    if loaded.visual is None:
        return LoadedModel(pin.buildReducedModel(loaded.model, joints, q), None, losses, mimics)
    reduced, visual = pin.buildReducedModel(loaded.model, loaded.visual, joints, q)
    return LoadedModel(reduced, visual, losses, mimics)


def _load(d: Description, arm: Arm | None, root: pin.JointModel | None, visuals: bool) -> LoadedModel:
    """Return the spacecraft's own URDF, or that of a mounted arm, with its ``fixed`` joints welded."""
    path, folders = urdf_of(d, arm)
    where, source, keep = "the TOML (before its tables)", d, texts_of(d)
    own = [a for a in d.arm if not a.mounted]
    if arm is not None:
        where, source, own = f"[[arm]] '{arm.name}'", arm, [arm]
        keep |= {name.removeprefix(f"{arm.name}/") for name in keep} | set(arm.home)
    keep |= {name for a in own for name in a.fixed}
    text = read_urdf(path, source.arguments, folders)
    reading = parse_urdf(text, str(path))
    check_inertias(reading, trusted=source.inertias == "trusted", where=where)
    folders = [*folders, *package_folders(text, path)]
    meshless = d.meshes == "ignored"
    if not meshless:
        try:
            check_meshes(text, str(path), folders)
        except DescriptionError as error:
            if d.meshes == "required":
                raise
            meshless = True
            if visuals:
                logger.warning("%s Drawn without meshes.", error.message)
    for what in reading.unused:
        logger.warning("%s: not used: %s.", Path(reading.source).name, what)
    text = normalise_urdf(text)
    mimics = mimics_of(reading)
    empty = [j for j in frame_joints(reading, text) if j not in keep]
    leading = {m.joint for n, m in mimics.items() if n not in empty}
    empty = [j for j in empty if j not in leading]
    if empty:
        logger.warning(
            "%s: welded, as only frames without mass or shape lie beyond: joints %s. Name one in `joints`, "
            "or as a wheel with `inertia`, to keep it.",
            path,
            some_of(empty),
        )
    try:
        model = pin.buildModelFromXML(text) if root is None else pin.buildModelFromXML(text, root)
    except (ValueError, RuntimeError) as error:
        raise DescriptionError(
            f"Pinocchio cannot read '{path}': {error}.",
            advice="What urdfdom printed above says where.",
            path=str(path),
        ) from error
    check_against_urdf(model, reading, free=root is not None)
    losses = {
        j.name: (j.damping, j.friction)
        for j in reading.joints.values()
        if (j.damping or j.friction) and j.kind in ("revolute", "continuous", "prismatic")
    }
    rest = pin.neutral(model)
    still = {n: m for n, m in mimics.items() if reading.joints[m.joint].kind == "fixed"}
    for name, mimic in still.items():  # what follows a joint that does not move stands at the offset
        one = JointGroup.of(model, [model.getJointId(name)])
        rest = set_group_angles(one, rest, np.array([mimic.offset]))
    empty += [n for n in still if n not in empty]
    mimics = {n: m for n, m in mimics.items() if n not in still}
    visual = None
    if visuals:
        places = [str(f) for f in folders]
        shown = without_meshes(text) if meshless else text
        try:
            visual = pin.buildGeomFromUrdfString(model, shown, pin.GeometryType.VISUAL, None, places)
        except (ValueError, RuntimeError) as error:
            raise DescriptionError(
                f"The visuals of '{path}' cannot be loaded: {error}.", advice="Check `package_dirs`."
            ) from error
    loaded = _weld_joints(LoadedModel(model, visual, losses, mimics), empty, rest)
    for fixing in own:
        loaded = _with_fixed(loaded, fixing) if fixing.fixed else loaded
    return loaded


def texts_of(d: Description) -> set[str]:
    """Return every text in a description's arms, wheels, effects and sensors: names of joints among them."""
    found: set[str] = set()

    def walk(value: Any) -> None:
        if isinstance(value, str):
            found.add(value)
        elif isinstance(value, Mapping):
            for key, item in value.items():
                walk(key)
                walk(item)
        elif isinstance(value, list | tuple):
            for item in value:
                walk(item)

    for part in (*d.arm, *d.wheel, *d.effect, *d.sensor):
        walk(part.model_dump(exclude_none=True))
    return found


def frame_joints(reading: UrdfReading, text: str) -> list[str]:
    """Return the joints beyond which there are only frames: links without mass, moment or shape.

    None, if no other joint moves: then the masses are missing.
    """
    shaped = {
        link.get("name")
        for link in ElementTree.fromstring(text).findall("link")
        if link.find("visual") is not None or link.find("collision") is not None
    }
    children: dict[str, list[str]] = {}
    for joint in reading.joints.values():
        children.setdefault(joint.parent, []).append(joint.child)

    def is_body(name: str) -> bool:
        link = reading.links[name]
        own = bool(link.mass > 0.0 or np.any(link.inertia)) or name in shaped
        return own or any(is_body(child) for child in children.get(name, ()))

    moving = [j for j in reading.joints.values() if j.kind != "fixed"]
    found = [j.name for j in moving if not is_body(j.child)]
    return found if len(found) < len(moving) else []


CLOSE = 1e-9
"""Largest difference between file and model, relative to the size of what is compared."""
DOF = {"revolute": 1, "continuous": 1, "prismatic": 1, "planar": 3, "floating": 6}


def check_against_urdf(model: pin.Model, reading: UrdfReading, *, free: bool) -> None:
    """Compare every link's inertia and every joint's frame, axis and limits with the file.

    ``model`` is what was built of the URDF alone, on a free joint if ``free``.

    Raises:
        DescriptionError: anything differs: names link or joint and element, with both values.
    """
    inertias = {1 if free else 0: np.zeros(10)}
    members: dict[int, list[str]] = {}
    carried: dict[str, tuple[int, pin.SE3]] = {reading.root: (1 if free else 0, pin.SE3.Identity())}
    waiting = list(reading.joints.values())
    while waiting:
        ready = [j for j in waiting if j.parent in carried]
        if not ready:  # read_urdf refuses loops
            raise DescriptionError(f"Joints of {reading.source} hang on no root.", advice="Close the tree.")
        for joint in ready:
            parent, placement = carried[joint.parent]
            placement = placement * pin.SE3(joint.rotation, joint.position)
            if joint.kind == "fixed":
                carried[joint.child] = parent, placement
                continue
            carried[joint.child] = (
                _check_joint(model, joint, parent, placement, reading.source),
                (pin.SE3.Identity()),
            )
        waiting = [j for j in waiting if j.child not in carried]
    for name, (body, placement) in carried.items():
        members.setdefault(body, []).append(name)
        theta = inertias.setdefault(body, np.zeros(10))
        theta += _parameters(reading.links[name], placement)
    for body, theta in inertias.items():
        if body:  # the root of a welded robot moves nothing
            _check_body(model, body, theta, [reading.links[n] for n in members[body]], carried, reading)


def _check_joint(model: pin.Model, joint: JointReading, parent: int, placement: pin.SE3, source: str) -> int:
    """Return the joint's index in the model."""
    if not model.existJointName(joint.name):
        _differs(f"Joint '{joint.name}'", source, "", "in the file", "missing")
    index = model.getJointId(joint.name)
    built = model.joints[index]
    place = f"Joint '{joint.name}'"
    if built.nv != DOF[joint.kind]:
        _differs(place, source, "type", joint.kind, built.shortname())
    if model.parents[index] != parent:
        _differs(place, source, "<parent>", joint.parent, model.names[model.parents[index]])
    frame = model.jointPlacements[index]
    size = max(1.0, float(np.abs(placement.translation).max()))
    if not (
        np.allclose(frame.translation, placement.translation, atol=CLOSE * size, rtol=0.0)
        and np.allclose(frame.rotation, placement.rotation, atol=CLOSE, rtol=0.0)
    ):
        _differs(place, source, "<origin>", placement.translation, frame.translation)
    if built.nv != 1:
        return index
    motion = motion_columns(model, index)[:, 0]
    expected = np.zeros(6)
    expected[slice(0, 3) if joint.kind == "prismatic" else slice(3, 6)] = joint.axis
    if not np.allclose(motion, expected, atol=CLOSE, rtol=0.0):
        _differs(place, source, "<axis>", joint.axis, motion[:3] if joint.kind == "prismatic" else motion[3:])
    pairs = [
        ("effort", joint.effort, model.effortLimit[built.idx_v]),
        ("velocity", joint.velocity, model.velocityLimit[built.idx_v]),
    ]
    if joint.kind != "continuous":
        pairs += [
            ("lower", joint.lower, model.lowerPositionLimit[built.idx_q]),
            ("upper", joint.upper, model.upperPositionLimit[built.idx_q]),
        ]
    for key, said, has in pairs:
        if said is None:
            continue
        if not (np.isinf(said) and abs(has) > 1e300) and not np.isclose(has, said, rtol=CLOSE, atol=0.0):
            _differs(place, source, f"<limit {key}>", said, has)
    return index


def _check_body(
    model: pin.Model,
    body: int,
    theta: np.ndarray,
    links: list[LinkReading],
    carried: dict[str, tuple[int, pin.SE3]],
    reading: UrdfReading,
) -> None:
    built = np.asarray(model.inertias[body].toDynamicParameters())
    size = np.array([theta[0], *[np.abs(theta[1:4]).max()] * 3, *[np.abs(theta[4:]).max()] * 6])
    if (np.abs(built - theta) <= CLOSE * np.maximum(size, 1e-12)).all():
        return
    missing = theta - built  # one link alone often explains it
    guilty = [
        link.name
        for link in links
        if np.allclose(_parameters(link, carried[link.name][1]), missing, rtol=1e-6, atol=1e-12)
    ] or [link.name for link in links if link.mass > 0.0]
    what = (
        ("<mass>", theta[0], built[0])
        if not np.isclose(built[0], theta[0], rtol=CLOSE)
        else ("first moment of <inertial>", theta[1:4], built[1:4])
        if not np.allclose(built[1:4], theta[1:4], rtol=0.0, atol=CLOSE * max(size[1], 1e-12))
        else ("<inertia>", theta[4:], built[4:])
    )
    named = ", ".join(f"'{n}'" for n in guilty)
    _differs(f"Link{'s' if len(guilty) > 1 else ''} {named}", reading.source, *what)


def _parameters(link: LinkReading, placement: pin.SE3) -> np.ndarray:
    """Inertial parameters (10,) about the origin of the joint that carries the link."""
    centre = placement.act(link.centre)  # `pin.Inertia` refuses bodies that cannot exist, as some robots have
    about = placement.rotation @ link.inertia @ placement.rotation.T
    about = about + link.mass * ((centre @ centre) * np.eye(3) - np.outer(centre, centre))
    return np.array([link.mass, *(link.mass * centre), *matrix_to_parameters(about)])


def _differs(place: str, source: str, element: str, said: object, has: object) -> None:
    raise DescriptionError(
        f"{place} of {source}: {element} is {_format_value(said)} in the file and "
        f"{_format_value(has)} in the model built.",
        advice="Pinocchio read the file otherwise than it is written: simplify that element, and please "
        "report it.",
        file=said,
        model=has,
    )


def _format_value(value: object) -> str:
    if isinstance(value, np.ndarray):
        return "(" + ", ".join(f"{x:.6g}" for x in value) + ")"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
