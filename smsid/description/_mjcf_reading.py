"""MJCF as URDF: bodies, joints and inertias as MuJoCo compiles them."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np

from smsid._listing import some_of
from smsid.description.urdf_reading import Mimic
from smsid.description.urdf_writing import UrdfTree
from smsid.errors import DescriptionError, require

logger = logging.getLogger(__name__)

HINGE, SLIDE, BALL, FREE = 3, 2, 1, 0  # mjtJoint


def mjcf_to_urdf(path: Path) -> bytes:
    """Return an MJCF model as a URDF; what a URDF cannot say is logged by name.

    A body with a free joint, or without joint, directly in the world is the root. Several joints of a body
    become a chain of links without mass.

    Raises:
        DescriptionError: MuJoCo cannot compile it, it has a ball joint, or no single tree that moves.
        MissingDependencyError: MuJoCo is not installed.
    """
    mujoco = require("mujoco", "mujoco")
    try:
        m = mujoco.MjModel.from_xml_path(str(path))
    except Exception as error:
        raise DescriptionError(
            f"MuJoCo cannot read '{path}': {error}.", advice="Mend the file; its meshes must be there."
        ) from error
    top, others = _root(m, str(path))
    tree = UrdfTree(m.body(top).name or path.stem)
    name = {0: "world"}
    lost = _unsupported_parts(m)
    if others:
        lost.append(f"{len(others)} bodies of the world beside '{m.body(top).name}': {', '.join(others[:5])}")
    jointed = m.body_jntnum[top] and m.jnt_type[m.body_jntadr[top]] != FREE
    if jointed:
        tree.link("world")
    mimics = _mimics(m)
    for b in range(top, m.nbody):
        if int(m.body_rootid[b]) != int(m.body_rootid[top]):
            continue
        name[b] = m.body(b).name or f"body{b}"
        _add_body(m, b, name, tree, str(path), mimics, is_root=b == top and not jointed)
    for what in lost:
        logger.warning("%s: not in the URDF made of it: %s.", path, what)
    return tree.text()


def _root(m: Any, source: str) -> tuple[int, list[str]]:
    """Return the body at the root of the one tree that moves, and the names of the other roots."""
    tops = [b for b in range(1, m.nbody) if int(m.body_parentid[b]) == 0]
    moving = {int(m.body_rootid[int(m.jnt_bodyid[j])]) for j in range(m.njnt)}
    chosen = [b for b in tops if b in moving] or tops
    if len(chosen) != 1:
        names = ", ".join(m.body(b).name or f"body{b}" for b in chosen)
        raise DescriptionError(
            f"{source} has {len(chosen)} trees of bodies that move{f': {names}' if names else ''}.",
            advice="Keep the one that is the craft or the arm.",
        )
    return chosen[0], [m.body(b).name or f"body{b}" for b in tops if b != chosen[0]]


def _mimics(m: Any) -> dict[int, Mimic]:
    """Return joints that an equality constraint makes follow another in a straight line, by number."""
    import mujoco

    found = {}
    for k in range(m.neq):
        follower, leader = int(m.eq_obj1id[k]), int(m.eq_obj2id[k])
        straight = m.eq_type[k] == mujoco.mjtEq.mjEQ_JOINT and leader >= 0 and not m.eq_data[k, 2:5].any()
        if straight and m.eq_active0[k]:
            offset, ratio = (float(x) for x in m.eq_data[k, :2])
            found[follower] = Mimic(m.joint(leader).name, ratio, offset)
    return found


def _add_body(
    m: Any,
    b: int,
    name: dict[int, str],
    tree: UrdfTree,
    source: str,
    mimics: dict[int, Mimic],
    *,
    is_root: bool,
) -> None:
    rotation = _matrix(m.body_iquat[b])
    inertia = rotation @ np.diag(m.body_inertia[b]) @ rotation.T
    tree.link(name[b], float(m.body_mass[b]), np.array(m.body_ipos[b]), inertia)
    if is_root:
        return
    parent = name[int(m.body_parentid[b])]
    turn, place = _matrix(m.body_quat[b]), np.array(m.body_pos[b])
    first, count = int(m.body_jntadr[b]), int(m.body_jntnum[b])
    if count == 0:
        tree.joint(f"{name[b]}_fixed", "fixed", parent, name[b], place, turn)
        return
    anchor = np.zeros(3)  # the last link's frame, in body axes
    for k in range(first, first + count):
        own = m.joint(k).name or f"{name[b]}_joint{k - first + 1}"
        kind = int(m.jnt_type[k])
        if kind not in (HINGE, SLIDE):
            what = "ball" if kind == BALL else "free"
            raise DescriptionError(
                f"Joint '{own}' of {source} is a {what} joint below the root.",
                advice="Replace a ball by three hinges.",
                joint=own,
            )
        # A hinge's anchor is a point of the body; the frame of its link is put there.
        at = np.array(m.jnt_pos[k]) if kind == HINGE else anchor
        last = k == first + count - 1
        child = name[b] if last and not at.any() else f"{own}_link"
        limited = bool(m.jnt_limited[k])
        low, high = (float(x) for x in m.jnt_range[k])
        dof = int(m.jnt_dofadr[k])
        types = {HINGE: "revolute" if limited else "continuous", SLIDE: "prismatic"}
        offset = place + turn @ at if k == first else at - anchor
        tree.joint(
            own, types[kind], parent, child, offset, turn if k == first else np.eye(3),
            axis=np.array(m.jnt_axis[k]), lower=low if limited else -1e9, upper=high if limited else 1e9,
            damping=float(np.ravel(m.dof_damping[dof])[0]), friction=float(m.dof_frictionloss[dof]),
            mimic=mimics.get(k),
        )  # fmt: skip
        parent, anchor = child, at
        if child != name[b]:
            tree.link(child)
    if parent != name[b]:
        tree.joint(f"{name[b]}_fixed", "fixed", parent, name[b], -anchor, np.eye(3))


def _matrix(quaternion: np.ndarray) -> np.ndarray:
    """Return the rotation (3, 3) of a quaternion w x y z."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(np.roll(np.array(quaternion, dtype=float), -1)).as_matrix()


def _unsupported_parts(m: Any) -> list[str]:
    """Return what the model has that a URDF cannot say."""
    joints = [m.joint(k).name or f"joint{k}" for k in range(m.njnt)]
    armed = [joints[int(m.dof_jntid[d])] for d in range(m.nv) if m.dof_armature[d] > 0.0]
    armature = list(dict.fromkeys(armed))
    springs = [joints[k] for k in range(m.njnt) if np.any(np.ravel(m.jnt_stiffness[k]) > 0.0)]
    moved = [
        joints[k] for k in range(m.njnt) if m.jnt_type[k] in (HINGE, SLIDE) and m.qpos0[m.jnt_qposadr[k]]
    ]
    found = []
    if armature:
        found.append(f"armature of {some_of(armature, 6)} (effect `motor_inertia`)")
    if springs:
        found.append(f"springs of {some_of(springs, 6)}")
    if moved:
        found.append(f"`ref` of {some_of(moved, 6)}, whose angle is counted from the pose drawn")
    for count, what in (
        (m.neq - len(_mimics(m)), "equality constraints (closed loops are left open)"),
        (m.ntendon, "tendons"),
        (m.nu, "actuators"),
        (m.nsensor, "sensors"),
        (m.npair, "contact pairs"),
    ):
        if count:
            found.append(f"{int(count)} {what}")
    if np.any(m.body_gravcomp):
        found.append("gravity compensation of bodies")
    if m.ngeom:
        found.append(f"the shapes of {int(m.ngeom)} geoms")
    return found
