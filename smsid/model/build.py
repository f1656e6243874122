"""From a description to a `SpacecraftModel`."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pinocchio as pin
from scipy.linalg import lapack

from smsid.description.schema import Arm, Description, Wheel
from smsid.effects.assembly import Assembly
from smsid.effects.friction import JointFriction
from smsid.effects.inertial_parameters import matrix_to_parameters
from smsid.errors import DescriptionError
from smsid.model._joint_order import is_depth_first, with_room_for
from smsid.model.followers import Followers
from smsid.model.inertial_forces import InertialForces
from smsid.model.load import load_bus, mount_arm
from smsid.model.spacecraft import (
    JointGroup,
    SloshJoint,
    Source,
    SpacecraftModel,
    group_angles,
    motion_columns,
    outside_limits,
    set_group_angles,
)

logger = logging.getLogger(__name__)


def build_model(description: Description, *, visuals: bool = False) -> SpacecraftModel:
    """Assemble the one Pinocchio model of a spacecraft.

    ``visuals`` loads the URDFs' visual geometry as well. Joints of the spacecraft's URDF that no arm and no
    wheel names stay in the model and move freely. ``<dynamics>`` of a joint becomes an effect `JointFriction`
    of the model's description, unless that has one for the joint already.

    Raises `DescriptionError` for an unphysical inertia, a missing file, mesh, frame or joint, a model that
    differs from the file, and `MissingDependencyError` for a robot without example-robot-data.
    """
    d = description
    loaded = load_bus(d, visuals)
    own_joints = tuple(loaded.model.names)[2 if d.root == "free" else 1 :]
    mounted: dict[str, tuple[str, ...]] = {}
    for arm in d.arm:
        if arm.mounted:
            with _name_table("arm", arm.name):
                loaded, names = mount_arm(loaded, arm, d)
            mounted[arm.name] = tuple(names)
    model = _assemble(
        d,
        Source(loaded.model, own_joints, mounted, losses=loaded.losses, mimics=loaded.mimics),
        loaded.visual,
    )
    _tell_home(model.pin, d, model.arm_joints, model.home)
    return model


def rebuild(model: SpacecraftModel, description: Description) -> SpacecraftModel:
    """Return the model of a description like that of ``model``, without reading the URDFs again.

    Description and model share URDF, root, arms and everything else that is loaded; effects, wheels, sensors,
    gravity and thrust may differ, and the result is that of `build_model` without visuals. Where they do not
    share it, it is built from the files. Raises what `build_model` raises.
    """
    if model.source is None or any(
        getattr(description, key) != getattr(model.description, key) for key in _LOADED
    ):
        return build_model(description)
    source = model.source
    if description.wheel != model.description.wheel:
        source = replace(source, wheeled=None, wheels=())
    return _assemble(description, source, None)


_LOADED = ("urdf", "folder", "root", "meshes", "inertias", "package_dirs", "arm")


def _assemble(d: Description, source: Source, visual: pin.GeometryModel | None) -> SpacecraftModel:
    free = d.root == "free"
    d = with_urdf_friction(d, source.losses)
    trusted = {*source.own_joints, "root_joint"} if d.inertias == "trusted" else set()
    for arm in d.arm:
        if arm.mounted and arm.inertias == "trusted":
            trusted |= set(source.mounted[arm.name])
    if source.wheeled is None:
        source = _add_wheels(d, source, frozenset(trusted))
    assembly = _with_effects(d, _copy_model(d, source), frozenset(trusted))
    if not is_depth_first(assembly.model):
        room = with_room_for(_copy_model(d, source), assembly.model)
        assembly = _with_effects(d, room, frozenset(trusted))
    model = assembly.model
    wheels = [model.getJointId(name) for name in source.wheels]
    for geometry in visual.geometryObjects if visual is not None else ():
        geometry.parentJoint = model.frames[geometry.parentFrame].parentJoint

    arms = _arms(assembly, d, source)
    all_joints = JointGroup.of(model, [int(j) for group in arms.values() for j in group.joints])
    _check_roles(model, all_joints, wheels)
    followers = Followers.of(model, source.mimics)
    _check_followers(followers, all_joints)
    home = _home(model, d, arms, followers)
    _check_masses(model, free, home)
    bound = bool(assembly.inertias) or followers is not None
    inertial = InertialForces(model, assembly.inertias, followers) if bound else None
    return SpacecraftModel(
        description=d,
        pin=model,
        visual=visual,
        data=model.createData(),
        free=free,
        arms=arms,
        arm_joints=all_joints,
        wheels=JointGroup.of(model, wheels),
        slosh=tuple(SloshJoint.of(model, tank, j) for tank, j in assembly.slosh.values()),
        appendages=tuple(assembly.appendages),
        modes=JointGroup.of(model, [j for a in assembly.appendages for j in a.joints]),
        mode_scale=np.concatenate([a.scale for a in assembly.appendages] or [np.zeros(0)]),
        **_springs(assembly),
        forces=(*assembly.forces, *((inertial,) if inertial else ())),
        home=home,
        thrust_point=np.asarray(d.thrust.point, dtype=float),
        loads=tuple(assembly.loads),
        inertial=inertial,
        owned=tuple(assembly.owned),
        breakpoints=tuple(sorted(set(assembly.breakpoints))),
        motors=_motors(model, all_joints, assembly.motors),
        twists=tuple(
            (i, int(all_joints.v[i]), assembly.twists[int(j)])
            for i, j in enumerate(all_joints.joints)
            if int(j) in assembly.twists
        ),
        source=source,
        followers=followers,
    )


def _add_wheels(d: Description, source: Source, trusted: frozenset[str]) -> Source:
    """Return what is loaded with the wheels of the description on it."""
    assembly = Assembly(source.pin.copy(), base=1 if d.root == "free" else 0, trusted=trusted)
    joints = []
    for wheel in d.wheel:
        with _name_table("wheel", wheel.name):
            joints.append(_add_wheel(assembly, wheel))
    names = tuple(assembly.model.names[j] for j in joints)
    return replace(source, wheeled=assembly.model, wheels=names)


def _copy_model(d: Description, source: Source) -> pin.Model:
    model = (source.wheeled or source.pin).copy()
    model.gravity.linear = np.asarray(d.gravity)
    return model


def _with_effects(d: Description, model: pin.Model, trusted: frozenset[str]) -> Assembly:
    """Return the model, which may have room for them already, with the effects of the description."""
    assembly = Assembly(
        model,
        base=1 if d.root == "free" else 0,
        trusted=trusted,
        thrusters=tuple(t.name for t in d.thruster),
        described=[i.toDynamicParameters() for i in model.inertias],
    )
    for effect in d.effect:
        with _name_table("effect", effect.name):
            assembly.attach(effect)
    return assembly


@contextmanager
def _name_table(table: str, name: str) -> Iterator[None]:
    """Put the table of the TOML in front of what a `DescriptionError` says."""
    try:
        yield
    except DescriptionError as error:
        raise error.at(f"[[{table}]] '{name}'") from error


def _add_wheel(assembly: Assembly, wheel: Wheel) -> int:
    if wheel.joint is not None:
        return _wheel_of_urdf(assembly, wheel, wheel.joint)
    axis = np.asarray(wheel.axis) / np.linalg.norm(wheel.axis)
    spin = wheel.inertia * np.outer(axis, axis)
    placement = pin.SE3(np.eye(3), np.asarray(wheel.position))
    joint = assembly.add_joint(None, pin.JointModelRevoluteUnaligned(axis), placement, wheel.name)
    assembly.add_inertia(joint, pin.Inertia(0.0, np.zeros(3), spin))
    if wheel.inertia_in_bus:
        less = np.concatenate([np.zeros(4), -matrix_to_parameters(spin)])
        assembly.add_remainder(None, less, pin.SE3.Identity())
    return joint


def _wheel_of_urdf(assembly: Assembly, wheel: Wheel, name: str) -> int:
    """Return the joint of the URDF that is the wheel, with the spin inertia that the URDF leaves out."""
    joint = assembly.joint_id(name)
    if wheel.inertia > 0.0:
        turning = motion_columns(assembly.model, joint)[3:]
        if turning.shape[1] != 1 or not turning.any():
            raise DescriptionError(f"Joint '{name}' does not turn about one axis: it is no wheel.")
        axis = turning[:, 0]
        own = float(axis @ assembly.model.inertias[joint].matrix()[3:, 3:] @ axis)
        if own > 0.0:
            raise DescriptionError(
                f"The URDF gives joint '{name}' a spin inertia of {own:.4g} kg m^2 already.",
                advice="Remove `inertia` from the wheel, or the <inertial> from the link.",
                joint=name,
            )
        assembly.add_inertia(joint, pin.Inertia(0.0, np.zeros(3), wheel.inertia * np.outer(axis, axis)))
    return joint


def _motors(
    model: pin.Model, arm_joints: JointGroup, motors: dict[int, int]
) -> tuple[tuple[int, int, int], ...]:
    place = {int(j): i for i, j in enumerate(arm_joints.joints)}
    return tuple(
        (place[joint], model.joints[extra].idx_q, model.joints[extra].idx_v)
        for joint, extra in motors.items()
        if joint in place
    )


def _arms(assembly: Assembly, d: Description, source: Source) -> dict[str, JointGroup]:
    wheels = {w.joint for w in d.wheel if w.joint}
    arms = {}
    for arm in d.arm or (Arm(name="arm"),):
        names = source.mounted.get(arm.name)
        if names is None:
            names = (
                arm.joints if arm.joints is not None else [n for n in source.own_joints if n not in wheels]
            )
        with _name_table("arm", arm.name):
            group = JointGroup.of(assembly.model, [assembly.joint_id(n) for n in names])
        if len(group):
            arms[arm.name] = group
    return arms


def _springs(assembly: Assembly) -> dict[str, np.ndarray]:
    """Return the springs by degree of freedom, those on the same one added up."""
    rows: dict[int, list[float]] = {}
    for joint, axis, stiffness, damping in assembly.springs:
        j = assembly.model.joints[joint]
        if j.nq != j.nv and stiffness != 0.0:
            raise DescriptionError(
                f"A spring needs a joint with one coordinate per degree of freedom, not '{j.shortname()}' "
                f"('{assembly.model.names[joint]}')."
            )
        row = rows.setdefault(j.idx_v + axis, [j.idx_q + axis, 0.0, 0.0])
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


def _home(
    model: pin.Model, d: Description, arms: dict[str, JointGroup], followers: Followers | None
) -> np.ndarray:
    q = pin.neutral(model)
    for arm in d.arm:
        if not arm.home:
            continue
        names = arms[arm.name].names if arm.name in arms else ()
        prefix = f"{arm.name}/" if arm.mounted else ""
        for name, angle in arm.home.items():
            if name in arm.fixed:
                continue
            if prefix + name not in names:
                raise DescriptionError(
                    f"[[arm]] '{arm.name}': `home` names joint '{name}', which it does not have.",
                    advice=f"It has: {', '.join(n.removeprefix(prefix) for n in names) or 'none'}.",
                )
            one = JointGroup.of(model, [model.getJointId(prefix + name)])
            q = set_group_angles(one, q, np.array([angle]))
    return q if followers is None else _with_followers(model, d, followers, q)


def _check_followers(followers: Followers | None, arm_joints: JointGroup) -> None:
    """Raise `DescriptionError` for a follower or leader that is no joint of an arm.

    What predicts free joints from their own equations of motion does not know of a leader.
    """
    if followers is None:
        return
    arms = {int(j) for j in arm_joints.joints}
    for name, leader, j, k in zip(
        followers.names, followers.leaders, followers.joints, followers.leading, strict=True
    ):
        if not {int(j), int(k)} <= arms:
            raise DescriptionError(
                f"Joint '{name}' mimics '{leader}': both have to be joints of an arm.",
                advice="Name both in the arm's `joints`, or list the leader in its `fixed`.",
                joint=name,
            )


def _with_followers(model: pin.Model, d: Description, followers: Followers, q: np.ndarray) -> np.ndarray:
    """Return q (nq,) with followers where their leaders put them; raise if a home says something else."""
    placed = followers.place_followers(model, q)
    group = JointGroup.of(model, followers.joints.tolist())
    found, given = group_angles(model, group, placed), group_angles(model, group, q)
    stated = {f"{a.name}/{n}" if a.mounted else n for a in d.arm for n in a.home}
    for name, leader, at, said in zip(followers.names, followers.leaders, found, given, strict=True):
        if name in stated and abs(said - at) > 1e-6:
            raise DescriptionError(
                f"`home` puts joint '{name}' at {said:.6g}; it mimics '{leader}', which puts it at {at:.6g}.",
                advice=f"Leave '{name}' out of `home`.",
                joint=name,
            )
    return placed


def _tell_home(model: pin.Model, d: Description, group: JointGroup, home: np.ndarray) -> None:
    """Warn of joints whose home is beyond their limits, and offer the middle."""
    found = outside_limits(model, group, group_angles(model, group, home))
    if found:
        offered = ", ".join(f'"{use.name.split("/")[-1]}" = {use.middle:.4g}' for use in found)
        logger.warning(
            "%s: %s. The middle of the limits would be: home = { %s }",
            d.name,
            "; ".join(f"'{use.name}': {use}" for use in found),
            offered,
        )


def _check_roles(model: pin.Model, arm_joints: JointGroup, wheels: list[int]) -> None:
    """Raise `DescriptionError` for a joint with two roles or with more than one degree of freedom."""
    taken = [*(int(j) for j in arm_joints.joints), *wheels]
    for j in taken:
        name = model.names[j]
        if model.joints[j].nv != 1:
            raise DescriptionError(
                f"Joint '{name}' has {model.joints[j].nv} degrees of freedom; that of an arm or wheel has 1.",
                advice="Name the arm's joints with `joints`; mount URDFs without floating or planar joints.",
            )
        if taken.count(j) > 1:
            raise DescriptionError(
                f"Joint '{name}' belongs to two arms or wheels.", advice="Name it once, with `joints`."
            )


def _check_masses(model: pin.Model, free: bool, home: np.ndarray) -> None:
    """Raise `DescriptionError` if some motion moves no mass: the accelerations would be undefined."""
    if free and model.inertias[1].mass <= 0.0:
        raise DescriptionError(
            "The bus (root link of the URDF) has no mass.",
            advice='Give it an <inertial>; of a machine on the ground say root = "fixed" in its TOML (of '
            "`smsid regressor`: --fixed). Where joints of a 'world' let a craft slide and turn in a plane, "
            "take the world and these joints out of the URDF: it floats without them.",
        )
    if model.nv == 0:
        raise DescriptionError("Nothing can move.", advice='Give the spacecraft joints, or `root = "free"`.')
    mass = pin.crba(model, model.createData(), home)
    mass = np.triu(mass) + np.triu(mass, 1).T
    size = np.diag(mass)
    if size.min() > 0.0:
        scale = 1.0 / np.sqrt(size)
        scaled = mass * scale[:, None] * scale
        if lapack.dpotrf(scaled - 1e-13 * np.eye(len(scaled)))[1] == 0:
            return
        vectors = np.linalg.eigh(scaled)[1]
        worst = int(np.argmax(np.abs(vectors[:, 0])))
    else:
        worst = int(np.argmin(size))
    joint = next(
        j for j in range(1, model.njoints) if 0 <= worst - model.joints[j].idx_v < model.joints[j].nv
    )
    raise DescriptionError(
        f"Moving joint '{model.names[joint]}' takes no inertia: its acceleration is undefined.",
        advice="Give the links beyond it an <inertial> with mass and positive moments. A reaction wheel has "
        f"its spin inertia in the description: [[wheel]] joint = '{model.names[joint]}', inertia = ... in "
        "kg m^2; a joint that is welded stands in `fixed` of its [[arm]].",
        joint=model.names[joint],
    )


def with_urdf_friction(d: Description, losses: Mapping[str, tuple[float, float]]) -> Description:
    """Return the description with an effect `JointFriction` for every joint that loses energy.

    Args:
        d: the description; a friction it has for a joint already stands instead of the URDF's.
        losses: viscous [N m s/rad] and Coulomb friction [N m] by joint; N s/m and N of sliding joints.
    """
    described = {joint for e in d.effect for joint in e.urdf_dynamics()}
    taken = {e.name for e in d.effect}
    more = []
    for joint, (viscous, coulomb) in losses.items():
        if joint in described:
            continue
        name = re.sub(r"[^A-Za-z0-9_-]", "_", joint) + "_friction"
        name = name if name[0].isalpha() else f"joint_{name}"
        while name in taken:
            name += "_"
        taken.add(name)
        more.append(JointFriction(name=name, joint=joint, viscous=viscous, coulomb=coulomb))
    return d.with_effects(*more) if more else d
