"""A scene and its motion as meshcat commands: plain dictionaries, for a live viewer and a file alike."""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from smsid.errors import require
from smsid.recording.attitude import continuous
from smsid.view._look import FIELD_OF_VIEW, fitted_camera
from smsid.view._parts import SceneNode, move_pose
from smsid.view._scene import Scene
from smsid.view._shapes import Box, Cylinder, Lines, Material, Mesh, Shape, Sphere, Stars

Command = dict[str, Any]
PREFIX = "/meshcat"
SKY = "/sky"
CAMERA = "/Cameras/default/rotated/<object>"
SUN_FROM = np.array([0.10, 0.85, 1.0])
BACKGROUNDS = {  # top and bottom; "auto" begins as "light"
    "space": ((0.075, 0.095, 0.17), (0.012, 0.015, 0.035)),
    "light": ((0.96, 0.97, 0.99), (0.74, 0.79, 0.86)),
}
# three.js sides and the type codes of meshcat's typed arrays
_FRONT, _BOTH_SIDES = 0, 2
_TYPES = {"float32": ("Float32Array", 0x17), "uint32": ("Uint32Array", 0x16)}
_TYPES |= {"uint16": ("Uint16Array", 0x14), "uint8": ("Uint8Array", 0x12)}
_META = {"metadata": {"version": 4.5, "type": "Object"}}


def scene_commands(scene: Scene, first: dict[str, np.ndarray] | None = None) -> Iterator[Command]:
    """Yield the commands that draw a scene; ``first`` gives poses (4, 4) by path other than those at rest."""
    yield from _surroundings(scene)
    yield from part_commands(scene, first)


def part_commands(scene: Scene, first: dict[str, np.ndarray] | None = None) -> Iterator[Command]:
    """Yield the commands that draw a scene's parts alone; ``first``: poses (4, 4) they start at."""
    poses = {path: pose[0] for path, pose in scene.poses(scene.rest).items()}
    poses.update(first or {})
    for part in scene.parts:
        path = f"{PREFIX}/{part.path}"
        if part.shape is not None:
            yield {"type": "set_object", "path": path, "object": _object(part)}
            if not part.shadow:
                yield _property(f"{path}/<object>", "castShadow", False)
        yield transform(path, poses.get(part.path, part.pose))


def transform(path: str, pose: np.ndarray) -> Command:
    """Return the command that puts a node at a pose (4, 4) in its parent."""
    return {"type": "set_transform", "path": path, "matrix": _flat(pose)}


def animation_command(tracks: dict[str, np.ndarray], fps: float, *, play: bool) -> Command:
    """Return the command that plays poses (N, 4, 4) by path, one key a frame; what stands still has none."""
    animations = []
    for path, poses in tracks.items():
        keys = [track for track in _tracks(poses) if track is not None]
        if keys:
            full = path if path.startswith("/") else f"{PREFIX}/{path}"
            animations.append({"path": full, "clip": {"fps": float(fps), "name": "replay", "tracks": keys}})
    return {
        "type": "set_animation",
        "path": "",
        "animations": animations,
        "options": {"play": play, "repetitions": float("inf")},
    }


def decompose(poses: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Split poses (N, 4, 4) into position (N, 3), quaternion xyzw (N, 4) of steady sign, and scale (N, 3)."""
    scale = np.linalg.norm(poses[:, :3, :3], axis=1)
    quaternion = Rotation.from_matrix(poses[:, :3, :3] / scale[:, None, :]).as_quat()
    return poses[:, :3, 3], continuous(quaternion), scale


def _tracks(poses: np.ndarray) -> Iterator[dict[str, Any] | None]:
    position, quaternion, scale = decompose(poses)
    yield _track("position", "vector3", position, 1e-6)
    yield _track("quaternion", "quaternion", quaternion, 1e-6)
    yield _track("scale", "vector3", scale, 1e-4)


def _track(name: str, kind: str, values: np.ndarray, still: float) -> dict[str, Any] | None:
    if np.all(np.ptp(values, axis=0) < still):
        return None
    # times and values flat, as three.js keeps them: a third of the size of meshcat.animation's list of keys
    times = _array(np.arange(len(values)), "float32")
    return {"name": f".{name}", "type": kind, "times": times, "values": _array(values, "float32")}


def _array(values: np.ndarray, dtype: str) -> Any:
    packed = np.ascontiguousarray(values, dtype=dtype).tobytes()
    return require("umsgpack", "view").Ext(_TYPES[dtype][1], packed)


def _attribute(values: np.ndarray, dtype: str = "float32", *, normalized: bool = False) -> dict[str, Any]:
    array = _array(values, dtype)
    return {"itemSize": 3, "type": _TYPES[dtype][0], "array": array, "normalized": normalized}


def _flat(pose: np.ndarray) -> list[float]:
    return [float(x) for x in pose.T.ravel()]


def _id(*key: str) -> str:
    return str(uuid.uuid5(uuid.NAMESPACE_OID, "/".join(key)))


def _property(path: str, name: str, value: Any) -> Command:
    return {"type": "set_property", "path": path, "property": name, "value": value}


def _hex(color: Any) -> int:
    r, g, b = (round(255 * min(max(float(c), 0.0), 1.0)) for c in color)
    return (r << 16) + (g << 8) + b


def _object(part: SceneNode) -> dict[str, Any]:
    assert part.shape is not None
    geometry, matrix = _geometry(part.shape)
    material = _material(part.shape, part.material)
    geometry["uuid"], material["uuid"] = _id(part.path, "geometry"), _id(part.path, "material")
    kind = {Lines: "LineSegments", Stars: "Points"}.get(type(part.shape), "Mesh")
    node: dict[str, Any] = {"uuid": _id(part.path), "type": kind, "matrix": _flat(matrix)}
    node |= {"geometry": geometry["uuid"], "material": material["uuid"]}
    return {**_META, "geometries": [geometry], "materials": [material], "object": node}


def _geometry(shape: Shape) -> tuple[dict[str, Any], np.ndarray]:
    upright = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # three.js: axis along y
    match shape:
        case Box((x, y, z)):
            size = {"width": float(x), "height": float(y), "depth": float(z)}
            return {"type": "BoxGeometry", **size}, np.eye(4)
        case Sphere(radius):
            segments = {"widthSegments": 40, "heightSegments": 24}
            return {"type": "SphereGeometry", "radius": float(radius), **segments}, np.eye(4)
        case Cylinder(radius, length, top):
            ends = {"radiusTop": float(radius if top is None else top), "radiusBottom": float(radius)}
            size = {"height": float(length), "radialSegments": 40}
            return {"type": "CylinderGeometry", **ends, **size}, upright
        case Mesh(vertices, faces, colors):
            data: dict[str, Any] = {"attributes": {"position": _attribute(vertices)}}
            data["index"] = _attribute(faces, "uint16" if len(vertices) < 65536 else "uint32")
        case Lines(points):
            data, colors = {"attributes": {"position": _attribute(points)}}, None
        case Stars(points, colors):
            data = {"attributes": {"position": _attribute(points)}}
    if colors is not None:
        data["attributes"]["color"] = _attribute(np.rint(255 * colors), "uint8", normalized=True)
    return {"type": "BufferGeometry", "data": data}, np.eye(4)


def _material(shape: Shape, material: Material) -> dict[str, Any]:
    color, clear = _hex(material.color), material.opacity < 1.0
    common = {"color": color, "opacity": material.opacity, "transparent": clear, "depthWrite": not clear}
    if material.overlay:  # drawn last, over everything
        common |= {"depthTest": False, "transparent": True}
    if isinstance(shape, Stars):
        return {"type": "PointsMaterial", "size": 1.6, "sizeAttenuation": False, "vertexColors": True}
    if isinstance(shape, Lines):
        return {"type": "LineBasicMaterial", **common}
    coloured = isinstance(shape, Mesh) and shape.colors is not None
    sides = _BOTH_SIDES if material.inside else _FRONT
    common |= {"side": sides, "vertexColors": coloured, "flatShading": isinstance(shape, Mesh)}
    if coloured:
        common["color"] = 0xFFFFFF
    if material.unlit:
        return {"type": "MeshBasicMaterial", **{k: v for k, v in common.items() if k != "flatShading"}}
    gloss = {"specular": _hex([0.45 * material.shine] * 3), "shininess": 8.0 + 70.0 * material.shine}
    return {"type": "MeshPhongMaterial", **common, **gloss}


def _surroundings(scene: Scene) -> Iterator[Command]:
    radius, look = scene.radius, scene.look
    yield from sky_commands(scene, "space" if look.background == "space" else "light")
    for name in ("/Grid", "/Axes", "/Lights/PointLightNegativeX", "/Lights/PointLightPositiveX"):
        yield _property(name, "visible", False)
    yield _property("/Lights/AmbientLight/<object>", "intensity", 0.50)
    yield _property("/Lights/FillLight/<object>", "intensity", 0.30)
    yield {"type": "set_object", "path": "/Lights/Sun", "object": _sun(scene)}
    target, offset = fitted_camera(scene.corners)
    x, y, z = offset.tolist()
    yield transform(PREFIX, move_pose(-target))  # meshcat's camera always looks at its origin
    yield _property(CAMERA, "fov", FIELD_OF_VIEW)
    yield _property(CAMERA, "far", 200.0 * radius)
    yield _property(CAMERA, "position", [x, z, -y])


def sky_commands(scene: Scene, background: str) -> Iterator[Command]:
    """Yield the commands that put a scene before a background, ``light`` or ``space`` (with stars)."""
    top, bottom = BACKGROUNDS[background]
    yield _property("/Background", "top_color", list(top))
    yield _property("/Background", "bottom_color", list(bottom))
    if background == "space":
        stars = SceneNode("sky", np.eye(4), _stars(100.0 * scene.radius))
        yield {"type": "set_object", "path": SKY, "object": _object(stars)}
    else:
        yield {"type": "delete", "path": SKY}


def _sun(scene: Scene) -> dict[str, Any]:
    reach = 2.0 * scene.radius
    camera: dict[str, Any] = {"uuid": _id("sun", "camera"), "type": "OrthographicCamera", "zoom": 1.0}
    camera |= {"left": -reach, "right": reach, "top": reach, "bottom": -reach}
    camera |= {"near": 0.1, "far": 8.0 * scene.radius}
    shadow = {"mapSize": [4096, 4096], "bias": -0.0004, "normalBias": 0.02, "radius": 2.0, "camera": camera}
    place = move_pose(4.0 * scene.radius * SUN_FROM / np.linalg.norm(SUN_FROM))
    node: dict[str, Any] = {"type": "DirectionalLight", "uuid": _id("sun"), "color": 0xFFF6E8}
    node |= {"intensity": 0.85, "shadow": shadow, "matrix": _flat(place)}
    return {**_META, "geometries": [], "materials": [], "object": node}


def _stars(distance: float) -> Stars:
    count = 900
    rng = np.random.default_rng(48)
    points = rng.normal(size=(count, 3))
    points *= distance / np.linalg.norm(points, axis=1, keepdims=True)
    brightness = np.clip(0.25 + 0.5 * rng.random(count) ** 3, 0.0, 1.0)[:, None]
    tint = 1.0 + 0.15 * rng.uniform(-1.0, 1.0, count)[:, None] * np.array([1.0, 0.0, -1.0])
    return Stars(points, np.clip(brightness * tint, 0.0, 1.0))
