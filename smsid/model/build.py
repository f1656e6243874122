"""From a description to a `SpacecraftModel`."""

from __future__ import annotations

import difflib
import importlib.metadata
import importlib.util
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pinocchio as pin

from smsid.description.schema import Arm, Description, Wheel
from smsid.description.urdf_check import check_inertias, check_meshes, read_urdf
from smsid.errors import DescriptionError, MissingDependencyError, require
from smsid.model.assembly import Assembly, inertia_from_parameters
from smsid.model.spacecraft import JointGroup, SloshJoint, SpacecraftModel


def build_model(description: Description, *, visuals: bool = False) -> SpacecraftModel:
    """Assemble the one Pinocchio model of a spacecraft.

    ``visuals`` loads the URDFs' visual geometry as well. Raises `DescriptionError` for an unphysical inertia, a
    missing file, mesh, frame or joint.
    """
    d = description
    path = d.folder / d.urdf
    folders = [path.parent, d.folder, *(d.folder / p for p in d.package_dirs)]
    free = d.root == "free"
    model, visual = _load(path, folders, d.meshes, pin.JointModelFreeFlyer() if free else None, visuals)
    own_joints = list(model.names)[2 if free else 1 :]
    mounted: dict[str, list[str]] = {}
    for arm in d.arm:
        if arm.urdf is None and arm.robot is None:
            continue
        model, visual, names = _mount(model, visual, arm, d, visuals)
        mounted[arm.name] = names
    model.gravity.linear = np.asarray(d.gravity)

    assembly = Assembly(model, base=1 if free else 0)
    wheels = [_add_wheel(assembly, wheel) for wheel in d.wheel]
    for effect in d.effect:
        effect.attach(assembly)

    arms = {}
    wheel_names = {w.joint for w in d.wheel if w.joint}
    for arm in d.arm or (Arm(name="arm"),):
        names = mounted.get(arm.name)
        if names is None:
            names = (
                list(arm.joints)
                if arm.joints is not None
                else [n for n in own_joints if n not in wheel_names]
            )
        arms[arm.name] = JointGroup.of(model, [assembly.joint_id(n) for n in names])
    arms = {name: group for name, group in arms.items() if len(group)}
    all_joints = JointGroup.of(model, [int(j) for group in arms.values() for j in group.joints])
    _check_single_dof(model, all_joints)
    _check_masses(model, free)
    return SpacecraftModel(
        description=d,
        pin=model,
        visual=visual,
        data=model.createData(),
        free=free,
        arms=arms,
        arm_joints=all_joints,
        wheels=JointGroup.of(model, wheels),
        slosh=tuple(_slosh_joint(model, name, j) for name, j in assembly.slosh.items()),
        appendages=tuple(assembly.appendages),
        modes=JointGroup.of(model, [j for a in assembly.appendages for j in a.joints]),
        mode_scale=np.concatenate([a.scale for a in assembly.appendages] or [np.zeros(0)]),
        **_springs(assembly),
        forces=tuple(assembly.forces),
        home=_home(model, d, arms),
        thrust_point=np.asarray(d.thrust.point, dtype=float),
    )


def _load(path: Path, folders: list[Path], meshes: str, root: pin.JointModel | None, visuals: bool):
    text = read_urdf(path)
    check_inertias(text, str(path))
    if meshes == "required":
        check_meshes(text, str(path), folders)
    try:
        model = pin.buildModelFromXML(text) if root is None else pin.buildModelFromXML(text, root)
    except (ValueError, RuntimeError) as error:
        raise DescriptionError(f"Pinocchio cannot read '{path}': {error}.") from error
    visual = None
    if visuals:
        shown = _without_meshes(text) if meshes == "ignored" else text
        places = [str(f) for f in folders]
        try:
            visual = pin.buildGeomFromUrdfString(model, shown, pin.GeometryType.VISUAL, None, places)
        except (ValueError, RuntimeError) as error:
            raise DescriptionError(
                f"The visuals of '{path}' cannot be loaded: {error}.", advice="Check `package_dirs`."
            ) from error
    return model, visual


def _without_meshes(text: str) -> str:
    root = ElementTree.fromstring(text)
    for link in root.iter("link"):
        for visual in link.findall("visual"):
            if visual.find("geometry/mesh") is not None:
                link.remove(visual)
    return ElementTree.tostring(root, encoding="unicode")


def _mount(model, visual, arm: Arm, d: Description, visuals: bool):
    if arm.robot is not None:
        path, folders = _robot_urdf(arm.robot)
    else:
        path = d.folder / str(arm.urdf)
        folders = [path.parent, *(d.folder / p for p in d.package_dirs)]
    child, child_visual = _load(path, folders, d.meshes, None, visuals)
    names = []
    for j in range(1, child.njoints):
        child.names[j] = f"{arm.name}/{child.names[j]}"
        names.append(child.names[j])
    for k in range(1, child.nframes):
        child.frames[k].name = f"{arm.name}/{child.frames[k].name}"
    mount = arm.mount
    frame = Assembly(model, base=1).frame(mount.frame)  # checks the name
    frame_id = model.getFrameId(mount.frame) if mount.frame else model.getFrameId(model.names[1])
    del frame
    placement = pin.SE3(pin.rpy.rpyToMatrix(*mount.rpy), np.asarray(mount.xyz))
    if visual is not None and child_visual is not None:
        for geometry in child_visual.geometryObjects:
            geometry.name = f"{arm.name}/{geometry.name}"
        model, visual = pin.appendModel(model, child, visual, child_visual, frame_id, placement)
    else:
        model = pin.appendModel(model, child, frame_id, placement)
    return model, visual, names


def _robot_urdf(name: str) -> tuple[Path, list[Path]]:
    robots = _robot_urdfs()
    if name not in robots:
        near = difflib.get_close_matches(name, robots, n=1)
        raise DescriptionError(
            f"example-robot-data has no robot '{name}'." + (f" Did you mean '{near[0]}'?" if near else ""),
            advice=f"It has: {', '.join(sorted(robots))}.",
        )
    path = robots[name]
    # its meshes are package://example-robot-data/robots/...: the folder above the package counts
    above = ("robots", "example-robot-data", "share")
    return path, [folder for folder in path.parents if folder.name in above]


def _robot_urdfs() -> dict[str, Path]:
    """Return the URDFs of example-robot-data by name; from 4.4 on its wheel has the data but no loaders."""
    if importlib.util.find_spec("example_robot_data") is not None:
        data = require("example_robot_data", "robots").robots_loader
        return {
            name: Path(data.getModelPath(robot.path)) / robot.path / robot.urdf_subpath / robot.urdf_filename
            for name, robot in data.ROBOTS.items()
            if robot.urdf_filename
        }
    try:
        files = importlib.metadata.files("example-robot-data") or []
    except importlib.metadata.PackageNotFoundError as error:
        raise MissingDependencyError(
            "example-robot-data is not installed.", advice="Install it with: pip install 'smsid[robots]'"
        ) from error
    return {f.stem.removesuffix("_robot"): Path(str(f.locate())) for f in files if f.suffix == ".urdf"}


def _add_wheel(assembly: Assembly, wheel: Wheel) -> int:
    if wheel.joint is not None:
        return assembly.joint_id(wheel.joint)
    axis = np.asarray(wheel.axis) / np.linalg.norm(wheel.axis)
    spin = wheel.inertia * np.outer(axis, axis)
    placement = pin.SE3(np.eye(3), np.asarray(wheel.position))
    joint = assembly.add_joint(None, pin.JointModelRevoluteUnaligned(axis), placement, wheel.name)
    assembly.add_inertia(joint, pin.Inertia(0.0, np.zeros(3), spin))
    if wheel.inertia_in_bus and assembly.base:
        bus = assembly.model.inertias[assembly.base].toDynamicParameters()
        bus[4:] -= [spin[0, 0], spin[0, 1], spin[1, 1], spin[0, 2], spin[1, 2], spin[2, 2]]
        assembly.model.inertias[assembly.base] = inertia_from_parameters(bus, "bus")
    return joint


def _slosh_joint(model: pin.Model, name: str, joint: int) -> SloshJoint:
    j = model.joints[joint]
    placement = model.jointPlacements[joint]
    return SloshJoint(
        name, joint, slice(j.idx_q, j.idx_q + 3), slice(j.idx_v, j.idx_v + 3), placement.translation.copy()
    )


def _springs(assembly: Assembly) -> dict[str, np.ndarray]:
    rows: dict[int, list[float]] = {}
    seen: dict[int, int] = {}
    for joint, stiffness, damping in assembly.springs:
        j = assembly.model.joints[joint]
        if j.nq != j.nv and stiffness != 0.0:
            raise DescriptionError(
                f"A spring needs a joint with one coordinate per DoF, not '{j.shortname()}'."
            )
        # the springs of a joint come in order, a second set on the same joint adds to the first
        offset = seen.get(joint, 0) % j.nv
        seen[joint] = seen.get(joint, 0) + 1
        row = rows.setdefault(j.idx_v + offset, [j.idx_q + offset, 0.0, 0.0])
        row[1] += stiffness
        row[2] += damping
    index = np.array(sorted(rows), dtype=int)
    table = np.array([rows[i] for i in index]).reshape(-1, 3)
    return {
        "spring_v": index,
        "spring_q": table[:, 0].astype(int),
        "stiffness": table[:, 1],
        "damping": table[:, 2],
    }


def _home(model: pin.Model, d: Description, arms: dict[str, JointGroup]) -> np.ndarray:
    from smsid.model.spacecraft import set_group_angles

    q = pin.neutral(model)
    for arm in d.arm:
        group = arms.get(arm.name)
        if group is None or not arm.home:
            continue
        prefix = "" if arm.urdf is None and arm.robot is None else f"{arm.name}/"
        for name, angle in arm.home.items():
            if prefix + name not in group.names:
                raise DescriptionError(
                    f"`home` of arm '{arm.name}' names joint '{name}', which it does not have.",
                    advice=f"It has: {', '.join(n.removeprefix(prefix) for n in group.names)}.",
                )
            i = group.names.index(prefix + name)
            one = JointGroup(
                (group.names[i],), group.joints[i : i + 1], group.q[i : i + 1], group.v[i : i + 1]
            )
            q = set_group_angles(model, one, q, np.array([angle]))
    return q


def _check_single_dof(model: pin.Model, group: JointGroup) -> None:
    for name, j in zip(group.names, group.joints, strict=True):
        if model.joints[int(j)].nv != 1:
            raise DescriptionError(
                f"Joint '{name}' has {model.joints[int(j)].nv} degrees of freedom; an arm's joint has one.",
                advice="Name the arm's joints with `joints`, or mount a URDF without floating or planar joints.",
            )


def _check_masses(model: pin.Model, free: bool) -> None:
    if free and model.inertias[1].mass <= 0.0:
        raise DescriptionError(
            "The bus (root link of the URDF) has no mass.", advice="Give it an <inertial>."
        )
