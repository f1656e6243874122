"""The scene of a spacecraft: a tree of parts, with what moves each of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from smsid._short_repr import short_repr
from smsid.model.spacecraft import SpacecraftModel
from smsid.view import _parts as make
from smsid.view._arrows import sign_parts, trail_parts
from smsid.view._drivers import DrawnFrames, Scale, joint_driver
from smsid.view._look import HULL_OPACITY, Look
from smsid.view._momentum import momenta
from smsid.view._motion import DrawnMotion
from smsid.view._parts import GHOST, SceneNode, as_overlay
from smsid.view._shapes import CORNERS
from smsid.view._visuals import visuals_of

ROOT = "spacecraft"
TRAIL = 0.004  # radius of a trail in radii of the scene
FITTED_FRAMES = 12  # of a motion, that the camera is fitted to
WHEEL_STEP = 0.35  # [rad] a wheel turns at most between frames, or it would seem to stand or run backwards


@short_repr
@dataclass(frozen=True)
class Scene:
    """Parts of a spacecraft with their poses at rest, and what the view has to say about itself.

    ``scale`` says what is drawn larger or smaller than life; ``corners`` (K, 3) [m] are those of the parts'
    extents on their way, in inertial axes (as seen from the bus origin if the camera follows it). ``trails``
    says of how many pieces the tubes along the ways of the tools are, by path.
    """

    model: SpacecraftModel
    look: Look
    parts: tuple[SceneNode, ...]
    rest: DrawnFrames
    scale: Scale
    corners: np.ndarray
    notes: tuple[str, ...]
    trails: Mapping[str, int] = field(default_factory=dict)

    @property
    def root(self) -> str:
        """The path that all parts lie under."""
        return self.parts[0].path

    @property
    def layers(self) -> dict[str, tuple[str, ...]]:
        """What a viewer may switch off: paths by name, as drawn, of parts with all below them."""
        found: dict[str, list[str]] = {}
        for part in self.parts:
            if part.layer:
                found.setdefault(part.layer, []).append(part.path)
        return {name: tuple(paths) for name, paths in found.items()}

    @property
    def radius(self) -> float:
        """Half the diagonal of the extent [m]."""
        return float(np.linalg.norm(np.ptp(self.corners, axis=0)) / 2)

    def part(self, path: str) -> SceneNode:
        """Return a part by its path; raises KeyError."""
        return {p.path: p for p in self.parts}[path]

    def poses(self, frames: DrawnFrames) -> dict[str, np.ndarray]:
        """Return the poses (N, 4, 4) in parent axes of every moving part, by path."""
        return {p.path: p.driver(frames) for p in self.parts if p.driver is not None}


def build_scene(
    model: SpacecraftModel,
    motion: DrawnMotion | None = None,
    look: Look | None = None,
    *,
    scale: Scale | None = None,
    root: str = ROOT,
    ghost: bool = False,
) -> Scene:
    """Return the scene of a spacecraft, home at rest; a motion sizes tanks, arrows and wheel speed.

    Needs no meshcat and no server. A model built without visuals gets those of its description.

    Args:
        model: the spacecraft.
        motion: what it will do.
        look: factors and colours.
        scale: what is drawn larger than life; by default as `fitting_scale` finds.
        root: the path all parts lie under.
        ghost: see-through and of one colour, without tanks, signs and sensors.

    Raises:
        DescriptionError: a mesh of the URDFs is missing.
    """
    look = look or Look()
    still = DrawnMotion(np.zeros(1), model.home[None], np.zeros((1, 3)))
    motion = motion or still
    scale = scale or fitting_scale(model, (motion,), look)
    visual = visuals_of(model)
    paths = joint_paths(model, root)
    bus = 1 if model.free else 0
    inside = make.hidden_points(model)
    parts: list[SceneNode] = []
    for joint, path in paths.items():
        placed = np.eye(4) if joint == 0 else model.pin.jointPlacements[joint].homogeneous
        parts.append(SceneNode(path, placed, driver=joint_driver(joint) if joint else None))
    for geometry in visual.geometryObjects:
        parent = geometry.parentJoint
        see_through = HULL_OPACITY if parent == bus else 1.0
        parts += make.visual_parts(paths[parent], geometry, inside if parent == bus else [], see_through)
    shown = {g.parentJoint for g in visual.geometryObjects}
    parts += make.inertia_parts(model, paths, shown, inside, HULL_OPACITY)
    parts += make.wheel_parts(model, paths)
    parts += make.tank_parts(model, paths, motion, scale.slosh)
    notes = [*scale.notes]
    for appendage in model.appendages:
        surface_parts, remark = make.appendage_parts(model, appendage, paths, look)
        parts += surface_parts
        notes += remark
    if look.sensors and not ghost:
        parts += make.sensor_parts(model, paths[bus])
    rest = DrawnFrames.of(model, still, scale)
    corners = _corners(parts, DrawnFrames.of(model, _sample_frames(model, motion, look), scale))
    scene = Scene(model, look, tuple(parts), rest, scale, corners, (*notes, *motion.notes))
    trails: dict[str, int] = {}
    if look.trail:
        color = {"color": GHOST} if ghost else {}
        tubes, trails = trail_parts(model, root, motion, TRAIL * scene.radius, **color)
        parts += tubes
    if ghost:
        parts = as_overlay(parts)
    elif look.arrows and motion is not still:
        found = momenta(model, motion)
        parts += sign_parts(model, paths, motion, found, scene.radius)
        kinds = ("linear momentum", "angular momentum")
        words = [w for w, told in zip(kinds, found.telling, strict=True) if not told]
        if words and model.free:
            remark = f"{' and '.join(words)}: no more than the sensors' noise, not drawn"
            scene = replace(scene, notes=(*scene.notes, remark))
    return replace(scene, parts=tuple(parts), trails=trails)


def fitting_scale(model: SpacecraftModel, motions: Sequence[DrawnMotion], look: Look) -> Scale:
    """Return the scale that suits all motions: no fuel leaves its tank, no wheel seems to run backwards."""
    slosh = min(make.slosh_factor(model, m, look) for m in motions)
    return Scale(slosh, look.panel_factor, min(_wheel_factor(model, m) for m in motions))


def joint_paths(model: SpacecraftModel, root: str = ROOT) -> dict[int, str]:
    """Return the path of every joint but those of modes; a joint's path starts with its parent's."""
    modes = {int(j) for j in model.modes.joints}
    paths = {0: root}
    for joint in range(1, model.pin.njoints):
        if joint not in modes:
            paths[joint] = f"{paths[model.pin.parents[joint]]}/{make.node_name(model.pin.names[joint])}"
    return paths


def _sample_frames(model: SpacecraftModel, motion: DrawnMotion, look: Look) -> DrawnMotion:
    """Return a few frames of a motion, where the camera sees them."""
    chosen = np.unique(np.linspace(0, len(motion.time) - 1, FITTED_FRAMES).astype(int))
    q = motion.q[chosen].copy()
    if model.free:
        q[:, :3] = model.home[:3]
    return DrawnMotion(motion.time[chosen], q, motion.force[chosen])


def world_poses(parts: Iterable[SceneNode], frames: DrawnFrames) -> dict[str, np.ndarray]:
    """Return the poses (N, 4, 4) in inertial axes of every part, by path."""
    world: dict[str, np.ndarray] = {}
    for part in parts:
        pose = part.pose[None] if part.driver is None else part.driver(frames)
        world[part.path] = world.get(part.path.rpartition("/")[0], np.eye(4)) @ pose
    return world


def _corners(parts: list[SceneNode], frames: DrawnFrames) -> np.ndarray:
    """Return the corners (K, 3) [m] of the extents of all shapes in all frames."""
    world, found = world_poses(parts, frames), [np.zeros((1, 3))]
    for part in parts:
        if part.half_size.any():
            at = world[part.path]
            corners = (CORNERS * 2.0 * part.half_size) @ at[:, :3, :3].swapaxes(1, 2) + at[:, None, :3, 3]
            found.append(corners.reshape(-1, 3))
    return np.concatenate(found)


def _wheel_factor(model: SpacecraftModel, motion: DrawnMotion) -> float:
    columns = [
        k
        for j, k in zip(model.wheels.joints, model.wheels.q, strict=True)
        if model.pin.joints[int(j)].nq == 1
    ]
    if len(motion.time) < 2 or not columns:
        return 1.0
    fastest = float(np.abs(np.diff(motion.q[:, columns], axis=0)).max())
    return 1.0 if fastest <= WHEEL_STEP else 1.0 / float(np.ceil(fastest / WHEEL_STEP))
