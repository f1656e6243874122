"""The parts a scene is made of."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from smsid.effects.assembly import AppendageJoints
from smsid.model.spacecraft import SloshJoint, SpacecraftModel
from smsid.model.stations import station_indices
from smsid.view._drivers import Driver, StripDriver
from smsid.view._look import STRIPS, Look
from smsid.view._motion import DrawnMotion
from smsid.view._shapes import (
    Box,
    Color,
    Cylinder,
    Lines,
    Material,
    Mesh,
    Shape,
    Sphere,
    box_edges,
    boxes_mesh,
    contains,
    half_size,
)
from smsid.view._surface import inertia_box, solar_strip, surface_of
from smsid.view._visuals import shape_of

FUEL = Material((0.95, 0.42, 0.12), shine=0.9)
TANK = Material((0.72, 0.86, 1.0), opacity=0.22, shine=1.0)
WHEEL = Material((0.62, 0.64, 0.68), shine=0.8)
MARK = Material((0.90, 0.22, 0.16))
PLAIN = Material()
EDGE = Material((1.0, 0.86, 0.50), opacity=0.9, unlit=True)
LINK = Material((0.70, 0.72, 0.76))
LARGEST_TANK, TANK_MARGIN = 3.0, 1.05  # radius of a tank in those of its ball; room at the wall
WATER = 1000.0  # [kg/m^3] density that turns a slosh mass into a ball
WHEEL_SIZE = (0.21, 0.159)  # [m], [kg m^2]: radius drawn for a spin inertia; others scale as similar discs


@dataclass(frozen=True, eq=False)
class SceneNode:
    """A node of the scene: its path below the root, and its pose (4, 4) in the parent node (with scale).

    A part without shape groups others; one with a driver moves. ``layer`` names what a viewer may switch off,
    with all below it.
    """

    path: str
    pose: np.ndarray
    shape: Shape | None = None
    material: Material = PLAIN
    driver: Driver | None = None
    shadow: bool = True
    layer: str = ""

    @property
    def half_size(self) -> np.ndarray:
        """Half its extent along its own axes (3,) [m]."""
        return np.zeros(3) if self.shape is None else half_size(self.shape)


def node_name(name: str) -> str:
    """Return a name that is one step of a path."""
    return name.replace("/", ".")


def move_pose(translation: Any = (0.0, 0.0, 0.0), rotation: np.ndarray | None = None) -> np.ndarray:
    """Return a pose (4, 4)."""
    pose = np.eye(4)
    pose[:3, :3] = np.eye(3) if rotation is None else rotation
    pose[:3, 3] = translation
    return pose


def hidden_points(model: SpacecraftModel) -> list[np.ndarray]:
    """Return the points (3,) of the bus frame that the hull must not hide: tanks and wheels."""
    bus = 1 if model.free else 0
    joints = [*(s.joint for s in model.slosh), *(int(j) for j in model.wheels.joints)]
    return [model.pin.jointPlacements[j].translation for j in joints if model.pin.parents[j] == bus]


def visual_parts(parent: str, geometry: Any, inside: list[np.ndarray], opacity: float) -> list[SceneNode]:
    """Return a URDF visual, see-through with any of the points (3,) [m] inside."""
    found = shape_of(geometry)
    if found is None:
        return []
    path = f"{parent}/{node_name(geometry.name)}"
    return _hull(SceneNode(path, geometry.placement.homogeneous, *found), inside, opacity)


def _hull(part: SceneNode, inside: list[np.ndarray], opacity: float) -> list[SceneNode]:
    """Return a part; with any of the points (3,) [m] inside it is see-through, the edges of a box drawn."""
    assert part.shape is not None
    place = np.linalg.inv(part.pose)
    if opacity >= 1.0 or not any(contains(part.shape, place[:3, :3] @ p + place[:3, 3]) for p in inside):
        return [part]
    clear = replace(part.material, opacity=opacity * part.material.opacity)
    edges = box_edges(part.shape.size) if isinstance(part.shape, Box) else None
    more = [] if edges is None else [SceneNode(f"{part.path}/edges", np.eye(4), edges, EDGE)]
    return [replace(part, material=clear, shadow=False), *more]


def inertia_parts(
    model: SpacecraftModel, paths: dict[int, str], shown: set[int], inside: list[np.ndarray], opacity: float
) -> list[SceneNode]:
    """Return boxes of inertia of bodies without visuals, the bus's see-through by points (3,) [m] inside."""
    bus = 1 if model.free else 0
    drawn = shown | {int(j) for j in model.wheels.joints} | {s.joint for s in model.slosh}
    parts = []
    for joint, path in paths.items():
        inertia = model.pin.inertias[joint]
        if joint in drawn or joint == 0 or inertia.mass <= 0.0:
            continue
        size, pose = inertia_box(inertia)
        drawn_box = SceneNode(f"{path}/inertia", pose, Box((size[0], size[1], size[2])), LINK)
        parts += _hull(drawn_box, inside if joint == bus else [], opacity)
    return parts


def wheel_parts(model: SpacecraftModel, paths: dict[int, str]) -> list[SceneNode]:
    """Return the discs of the wheels without a link of their own; those at one point are drawn apart."""
    parts = []
    wheels = [w for w in model.description.wheel if w.joint is None]
    for wheel in wheels:
        axis = np.asarray(wheel.axis) / np.linalg.norm(wheel.axis)
        radius = WHEEL_SIZE[0] * (wheel.inertia / WHEEL_SIZE[1]) ** 0.2
        shared = sum(w.position == wheel.position for w in wheels) > 1
        disc = f"{paths[model.pin.getJointId(wheel.name)]}/disc"
        # a wheel moved along its own axis still spins in place
        pose = move_pose(-1.7 * radius * axis if shared else np.zeros(3), z_to(axis))
        parts.append(SceneNode(disc, pose, Cylinder(radius, 0.4 * radius), WHEEL))
        stripe = ((0.5 * radius, 0.0, 0.0), (0.9 * radius, 0.2 * radius, 0.46 * radius), MARK.color)
        hub = ((0.0, 0.0, 0.0), (0.3 * radius, 0.3 * radius, 0.6 * radius), (0.2, 0.21, 0.24))
        parts.append(SceneNode(f"{disc}/mark", np.eye(4), boxes_mesh([stripe, hub])))
    return parts


def slosh_factor(model: SpacecraftModel, motion: DrawnMotion, look: Look) -> float:
    """Return how many times larger slosh is drawn, so that no ball leaves the largest tank it may have."""
    needed = [
        look.slosh_factor * _reach(motion, slosh) / ((LARGEST_TANK / TANK_MARGIN - 1.0) * _ball(slosh))
        for slosh in model.slosh
    ]
    return look.slosh_factor / max(1.0, *np.ceil(needed)) if needed else look.slosh_factor


def tank_parts(
    model: SpacecraftModel, paths: dict[int, str], motion: DrawnMotion, factor: float
) -> list[SceneNode]:
    """Return the slosh masses as balls of fuel, each in a tank that is wide enough for its motion."""
    parts = []
    for slosh in model.slosh:
        ball = _ball(slosh)
        tank = max(1.7 * ball, TANK_MARGIN * (ball + factor * _reach(motion, slosh)))
        parent = paths[model.pin.parents[slosh.joint]]
        rest = model.pin.jointPlacements[slosh.joint].homogeneous
        parts.append(
            SceneNode(f"{parent}/{node_name(slosh.name)}.tank", rest, Sphere(tank), TANK, shadow=False)
        )
        parts.append(SceneNode(f"{paths[slosh.joint]}/ball", np.eye(4), Sphere(ball), FUEL))
    return parts


def _ball(slosh: SloshJoint) -> float:
    """Return the radius of a slosh mass [m]."""
    return float((3.0 * slosh.tank.mass / (4.0 * np.pi * WATER)) ** (1.0 / 3.0))


def _reach(motion: DrawnMotion, slosh: SloshJoint) -> float:
    return float(np.linalg.norm(motion.q[:, slosh.q], axis=1).max())


def appendage_parts(
    model: SpacecraftModel, appendage: AppendageJoints, paths: dict[int, str], look: Look
) -> tuple[list[SceneNode], list[str]]:
    """Return an appendage's strips and accelerometer marks, and a remark if it cannot bend on screen."""
    effect = appendage.appendage
    surface = surface_of(effect)
    path = f"{paths[appendage.parent]}/{node_name(effect.name)}"
    parts = [SceneNode(path, appendage.placement.homogeneous @ surface.frame)]
    q = np.array([model.pin.joints[j].idx_q for j in appendage.joints], dtype=int)
    marks = _marked_stations(model, appendage) if look.sensors else np.zeros((0, 3))
    local = (marks - surface.frame[:3, 3]) @ surface.frame[:3, :3]
    step = surface.length / STRIPS
    owner = np.clip(local[:, 0] / step - 1e-6, 0, STRIPS - 1).astype(int)
    for k in range(STRIPS):
        driver = StripDriver(surface, STRIPS, k, q, np.asarray(appendage.scale))
        rest = move_pose(((k + 0.5) * step, 0.0, 0.0))
        strip = f"{path}/strip{k:02d}"
        parts.append(SceneNode(strip, rest, solar_strip(surface, STRIPS, k), Material(shine=0.7), driver))
        for i in np.flatnonzero(owner == k):
            size = 0.014 * surface.length
            at = local[i] - rest[:3, 3] + [0.0, 0.0, 0.5 * size + 0.5 * surface.thickness]
            mark = Box((size, size, size))
            parts.append(SceneNode(f"{strip}/station{i}", move_pose(at), mark, MARK, layer="sensors"))
    rigid = surface.rigid and len(appendage.joints) > 0
    return parts, [f"'{effect.name}' has no mode shapes: drawn rigid"] if rigid else []


def sensor_parts(model: SpacecraftModel, bus: str) -> list[SceneNode]:
    """Return a frame of three coloured bars at each place where a pose sensor or IMU sits."""
    parts, places = [], set()
    for sensor in model.description.sensor:
        place = (*sensor.position, *sensor.orientation)
        if sensor.kind not in ("pose", "imu") or place in places:
            continue
        places.add(place)
        size, thin = 0.5, 0.02
        bars = [
            (tuple(size / 2 * e), tuple(thin + (size - thin) * e), tuple(0.15 + 0.85 * e)) for e in np.eye(3)
        ]
        pose = move_pose(sensor.position, sensor.rotation)
        path = f"{bus}/{node_name(sensor.name)}.frame"
        parts.append(SceneNode(path, pose, boxes_mesh(bars), Material(shine=0.0), layer="sensors"))
    return parts


def _marked_stations(model: SpacecraftModel, appendage: AppendageJoints) -> np.ndarray:
    positions = appendage.appendage.station_positions()
    for sensor in model.description.sensor:
        if sensor.kind == "accelerometers" and sensor.appendage == appendage.appendage.name:
            return positions[station_indices(appendage, sensor)]
    return np.zeros((0, 3))


def z_to(axis: np.ndarray) -> np.ndarray:
    """Return a rotation (3, 3) that takes z to a unit axis."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    x = np.cross(helper, axis)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)


GHOST: Color = (0.10, 0.55, 0.85)
VEIL = Material(GHOST, opacity=0.30, shine=0.2, inside=False)
LEFT_OUT = ("centre of mass", "sensors")


def as_overlay(parts: Iterable[SceneNode]) -> list[SceneNode]:
    """Return parts as a ghost's: what would only confuse left out, trails as they are."""
    found: list[SceneNode] = []
    hulls = tuple(p.path for p in parts if p.shape is not None and p.material.opacity < 1.0)
    for part in parts:
        if part.layer in LEFT_OUT or part.path.startswith(hulls) or isinstance(part.shape, Lines):
            continue
        if part.shape is None or part.layer:
            found.append(part)
            continue
        shape = replace(part.shape, colors=None) if isinstance(part.shape, Mesh) else part.shape
        found.append(replace(part, shape=shape, material=VEIL, shadow=False))
    return found
