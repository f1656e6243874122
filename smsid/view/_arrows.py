"""Signs: arrows of thrust and momentum, bent arrows of torque, the centre of mass, the ways of tools."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pinocchio as pin

from smsid.model.spacecraft import JointGroup, SpacecraftModel, motion_columns
from smsid.view._drivers import DrawnFrames, Driver, VectorDriver, centre_poses
from smsid.view._momentum import Momenta
from smsid.view._motion import DrawnMotion
from smsid.view._parts import SceneNode, move_pose, node_name, z_to
from smsid.view._shapes import Color, Cylinder, Material, Mesh

# told apart by those who see colours differently (Okabe and Ito)
THRUST: Color = (0.84, 0.37, 0.0)
TORQUE: Color = (0.80, 0.40, 0.63)
LINEAR: Color = (0.0, 0.62, 0.45)
ANGULAR: Color = (0.0, 0.45, 0.70)
HIDDEN = np.diag([1e-4, 1e-4, 1e-4, 1.0])
# in radii of the scene, at the largest value
ARROW_LENGTH, MARK_SIZE = 0.75, 0.02
BUS_RING, JOINT_RING, WHEEL_RING = 0.30, 0.28, 0.13


def sign_parts(
    model: SpacecraftModel, paths: dict[int, str], motion: DrawnMotion, found: Momenta, radius: float
) -> list[SceneNode]:
    """Return the arrows of all forces, torques and momenta of a motion; ``radius`` [m] is the scene's."""
    bus, root = paths[1 if model.free else 0], paths[0]
    parts: list[SceneNode] = []
    if model.free and np.any(motion.force):
        driver = VectorDriver(
            lambda f: f.motion.force, model.thrust_point, _per(ARROW_LENGTH * radius, motion.force)
        )
        parts += _arrow(f"{bus}/thrust", driver, THRUST, "thrust")
    parts += _torques(model, paths, bus, motion, radius)
    parts += _momenta(model, root, found, ARROW_LENGTH * radius)
    mark, paint = _quartered_ball(MARK_SIZE * radius), Material(shine=0.2, overlay=True, inside=False)
    centre = move_pose(found.com[0])
    return [*parts, SceneNode(f"{root}/com", centre, mark, paint, centre_poses, False, "centre of mass")]


def _torques(
    model: SpacecraftModel, paths: dict[int, str], bus: str, motion: DrawnMotion, radius: float
) -> list[SceneNode]:
    """Return the bent arrows at the bus, the joints and the wheels; each kind has a scale of its own."""
    parts: list[SceneNode] = []
    if model.free and motion.torque is not None and np.any(motion.torque):
        turning = _torque_of("torque", slice(None), np.ones(3))
        driver = VectorDriver(turning, np.zeros(3), _per(BUS_RING * radius, motion.torque))
        parts += _ring(f"{bus}/torque", driver)
    kinds = ((model.arm_joints, "joint_torque", JOINT_RING), (model.wheels, "wheel_torque", WHEEL_RING))
    for group, kind, size in kinds:
        values = getattr(motion, kind)
        if values is None or not np.any(values):
            continue
        per = size * radius / float(np.abs(values).max())
        for k, joint in enumerate(group.joints):
            axis = joint_axis(model, int(joint))
            if axis is not None and np.any(values[:, k]):
                driver = VectorDriver(_torque_of(kind, [k], axis), np.zeros(3), per)
                parts += _ring(f"{paths[int(joint)]}/torque", driver)
    return parts


def _torque_of(
    kind: str, columns: slice | list[int], axis: np.ndarray
) -> Callable[[DrawnFrames], np.ndarray]:
    """Return what gives the torques (N, 3) of a kind over frames: the columns, along an axis (3,)."""

    def torque(frames: DrawnFrames) -> np.ndarray:
        values = getattr(frames.motion, kind)
        return np.zeros((len(frames.q), 3)) if values is None else values[:, columns] * axis

    return torque


def _momenta(model: SpacecraftModel, root: str, found: Momenta, length: float) -> list[SceneNode]:
    """Return the arrows of momentum; full length is what there would be if nothing cancelled."""
    parts: list[SceneNode] = []
    if not model.free:
        return parts
    whole, turning = found.telling
    if found.linear_scale > 0.0 and whole:
        driver = VectorDriver(lambda f: f.momenta.linear, None, length / found.linear_scale)
        parts += _arrow(f"{root}/linear_momentum", driver, LINEAR, "momentum")
    if found.angular_scale > 0.0 and turning:
        driver = VectorDriver(lambda f: f.momenta.angular, None, length / found.angular_scale)
        parts += _arrow(f"{root}/angular_momentum", driver, ANGULAR, "angular momentum")
    return parts


def joint_axis(model: SpacecraftModel, joint: int) -> np.ndarray | None:
    """Return the unit axis (3,) a joint turns about, in its own axes; None for one that does not turn."""
    turning = motion_columns(model.pin, joint)[3:]
    return turning[:, 0] if turning.shape[1] == 1 and turning.any() else None


def _per(length: float, vectors: np.ndarray) -> float:
    return length / float(np.linalg.norm(vectors, axis=1).max())


def _arrow(path: str, driver: Driver, color: Color, layer: str) -> list[SceneNode]:
    turn, paint = z_to(np.array([1.0, 0.0, 0.0])), Material(color, unlit=True)
    shaft, head = Cylinder(0.009, 0.84), Cylinder(0.03, 0.18, top=0.0)
    return [
        SceneNode(path, HIDDEN, driver=driver, layer=layer),
        SceneNode(f"{path}/shaft", move_pose((0.42, 0.0, 0.0), turn), shaft, paint, shadow=False),
        SceneNode(f"{path}/head", move_pose((0.91, 0.0, 0.0), turn), head, paint, shadow=False),
    ]


def _ring(path: str, driver: Driver) -> list[SceneNode]:
    paint = Material(TORQUE, unlit=True)
    return [
        SceneNode(path, HIDDEN, driver=driver, layer="torques"),
        SceneNode(f"{path}/ring", np.eye(4), _bent_arrow(), paint, shadow=False),
    ]


def _bent_arrow() -> Mesh:
    """Return three quarters of a turn about x, of radius one half, with a head: right-handed about +x."""
    radius, thick, sides, steps = 0.5, 0.035, 10, 40
    angle = np.linspace(0.0, 1.5 * np.pi, steps + 1)
    width = np.full(steps + 1, thick)
    # the head: a cone over the last stretch, its base wider than the shaft
    head = np.linspace(1.5 * np.pi, 1.5 * np.pi + 0.42, 5)
    angle = np.concatenate([angle, head])
    width = np.concatenate([width, np.linspace(3.0 * thick, 0.0, 5)])
    around = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    out, along = np.stack([np.zeros_like(angle), np.cos(angle), np.sin(angle)], axis=1), np.eye(3)[0]
    ring = out[:, None] * np.cos(around)[None, :, None] + along * np.sin(around)[None, :, None]
    vertices = radius * out[:, None] + width[:, None, None] * ring
    return Mesh(vertices.reshape(-1, 3), tube_faces(len(angle), sides))


def tube_faces(rings: int, sides: int) -> np.ndarray:
    """Return the triangles (2 sides (rings - 1), 3) of a tube of rings of vertices, ring after ring."""
    k, i = np.meshgrid(np.arange(rings - 1), np.arange(sides), indexing="ij")
    a, b = k * sides + i, k * sides + (i + 1) % sides
    quads = np.stack([a, a + sides, b, b, a + sides, b + sides], axis=-1)
    return quads.reshape(-1, 3)


def _quartered_ball(radius: float) -> Mesh:
    """Return a ball whose octants are dark and light by turns: the usual mark of a centre of mass."""
    n, vertices, faces, colors = 8, [], [], []
    for octant in range(8):
        sign = np.array([1 if octant >> k & 1 else -1 for k in range(3)])
        first = len(vertices)
        index = {}
        for i in range(n + 1):
            for j in range(n + 1 - i):
                index[i, j] = first + len(index)
                point = np.array([i, j, n - i - j], dtype=float)
                vertices.append(radius * sign * point / np.linalg.norm(point))
                colors.append((0.08, 0.08, 0.09) if sign.prod() > 0 else (1.0, 0.86, 0.20))
        for i in range(n):
            for j in range(n - i):
                corners = [index[i, j], index[i + 1, j], index[i, j + 1]]
                faces.append(corners if sign.prod() > 0 else corners[::-1])
                if i + j < n - 1:
                    corners = [index[i + 1, j], index[i + 1, j + 1], index[i, j + 1]]
                    faces.append(corners if sign.prod() > 0 else corners[::-1])
    return Mesh(np.array(vertices), np.array(faces), np.array(colors))


TOOL = re.compile(r"tool|tcp|tip|gripper|hand|ee\b|flange", re.IGNORECASE)
TRAIL_COLOR: Color = (0.90, 0.62, 0.0)
SIDES, LONGEST = 6, 800  # of a tube: sides, and pieces
INDICES = 6 * SIDES  # of one piece of a tube, in the list of its triangles' corners


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
    model: SpacecraftModel, root: str, motion: DrawnMotion, radius: float, color: Color = TRAIL_COLOR
) -> tuple[list[SceneNode], dict[str, int]]:
    """Return a tube for each tool that moves, ``radius`` [m] thick, and by path of how many pieces it is."""
    parts, trails = [], {}
    for name, way in tool_positions(model, motion.q).items():
        if np.ptp(way, axis=0).max() < 4.0 * radius:
            continue
        chosen = np.linspace(0, len(way) - 1, min(len(way), LONGEST + 1)).round().astype(int)
        path = f"{root}/trail.{node_name(name)}"
        tube = tube_along(way[chosen], radius)
        parts.append(
            SceneNode(path, np.eye(4), tube, Material(color, unlit=True), shadow=False, layer="tool trail")
        )
        trails[path] = len(chosen) - 1
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
