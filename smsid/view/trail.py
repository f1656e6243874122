"""The way the tools of the arms have come, as tubes."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from smsid.model.spacecraft import JointGroup, SpacecraftModel
from smsid.view.arrows import tube_faces
from smsid.view.motion import Motion
from smsid.view.parts import Part, node_name
from smsid.view.shapes import Color, Material, Mesh

TOOL = re.compile(r"tool|tcp|tip|gripper|hand|ee\b|flange", re.IGNORECASE)
COLOR: Color = (0.90, 0.62, 0.0)
SIDES, LONGEST = 6, 800  # of a tube: sides, and pieces
INDICES = 6 * SIDES  # of one piece of a tube, in the list of its triangles' corners


@dataclass(frozen=True)
class Trail:
    """A tube along the way of a tool: its node's path, and of how many pieces it is."""

    path: str
    pieces: int


def tool_frame(model: SpacecraftModel, arm: JointGroup) -> int:
    """Return the frame that stands for an arm's tool.

    The last link whose name says tool (or tcp, tip, gripper, hand, ee, flange), else the last link.
    """
    own = {int(j) for j in arm.joints}
    links = [
        k
        for k, f in enumerate(model.pin.frames)
        if f.parentJoint in own and f.type in (pin.FrameType.BODY, pin.FrameType.FIXED_JOINT)
    ]
    named = [k for k in links if TOOL.search(model.pin.frames[k].name)]
    return (named or links)[-1]


def tool_positions(model: SpacecraftModel, q: np.ndarray) -> dict[str, np.ndarray]:
    """Return the positions (N, 3) [m] of each arm's tool over configurations q (N, nq), inertial axes."""
    frames = {name: tool_frame(model, arm) for name, arm in model.arms.items() if len(arm)}
    data, found = model.pin.createData(), {name: np.empty((len(q), 3)) for name in frames}
    for i, row in enumerate(q):
        pin.forwardKinematics(model.pin, data, row)
        for name, frame in frames.items():
            found[name][i] = pin.updateFramePlacement(model.pin, data, frame).translation
    return found


def trail_parts(
    model: SpacecraftModel, root: str, motion: Motion, radius: float, color: Color = COLOR
) -> tuple[list[Part], list[Trail]]:
    """Return a tube for each tool that moves, ``radius`` [m] thick, and what a player needs to grow it."""
    parts, trails = [], []
    for name, way in tool_positions(model, motion.q).items():
        if np.ptp(way, axis=0).max() < 4.0 * radius:
            continue
        chosen = np.linspace(0, len(way) - 1, min(len(way), LONGEST + 1)).round().astype(int)
        path = f"{root}/trail.{node_name(name)}"
        tube = tube_along(way[chosen], radius)
        parts.append(
            Part(path, np.eye(4), tube, Material(color, unlit=True), shadow=False, layer="tool trail")
        )
        trails.append(Trail(path, len(chosen) - 1))
    return parts, trails


def tube_along(points: np.ndarray, radius: float) -> Mesh:
    """Return a tube about a polyline (K, 3) [m], piece after piece, without twist."""
    ahead = np.diff(points, axis=0)
    length = np.linalg.norm(ahead, axis=1, keepdims=True)
    around = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)
    tangent = np.array([1.0, 0.0, 0.0])
    side = np.array([0.0, 0.0, 1.0])
    rings = []
    for k, point in enumerate(points):
        here = ahead[min(k, len(ahead) - 1)] if len(ahead) else tangent
        if len(ahead) and length[min(k, len(ahead) - 1), 0] > 1e-9:
            tangent = here / np.linalg.norm(here)
        side = side - (side @ tangent) * tangent
        if np.linalg.norm(side) < 1e-6:
            side = np.cross(tangent, np.eye(3)[int(np.argmin(np.abs(tangent)))])
        side = side / np.linalg.norm(side)
        other = np.cross(tangent, side)
        rings.append(point + radius * (np.outer(np.cos(around), side) + np.outer(np.sin(around), other)))
    return Mesh(np.concatenate(rings), tube_faces(len(points), SIDES))
