"""The visual geometry of the URDFs as shapes, with just enough of COLLADA to colour meshes:
triangles in metres, z up, with diffuse colours.
"""

from __future__ import annotations

import logging
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from smsid.errors import require
from smsid.model.build import build_model
from smsid.model.spacecraft import SpacecraftModel
from smsid.view._shapes import Box, Color, Cylinder, Material, Mesh, Shape, Sphere

logger = logging.getLogger(__name__)


def visuals_of(model: SpacecraftModel) -> pin.GeometryModel:
    """Return the model's visual geometry, loading it if the model was built without."""
    visual = model.visual or build_model(model.description, visuals=True).visual
    assert visual is not None
    return visual


def shape_of(geometry: Any) -> tuple[Shape, Material] | None:
    """Return shape and material of a `pin.GeometryObject`, scale included; None for what cannot be drawn."""
    coal = require("coal", "view")
    color = np.asarray(geometry.meshColor, dtype=float)
    material = Material((float(color[0]), float(color[1]), float(color[2])), float(color[3]))
    body = geometry.geometry
    match body:
        case coal.Box():
            x, y, z = 2.0 * body.halfSide
            return Box((float(x), float(y), float(z))), material
        case coal.Sphere():
            return Sphere(body.radius), material
        case coal.Cylinder():
            return Cylinder(body.radius, 2.0 * body.halfLength), material
        case coal.Capsule():
            return Cylinder(body.radius, 2.0 * (body.halfLength + body.radius)), material
        case coal.Cone():
            return Cylinder(body.radius, 2.0 * body.halfLength, top=0.0), material
        case coal.BVHModelBase():
            mesh = _triangles(body)
            if not geometry.overrideMaterial and Path(geometry.meshPath).suffix.lower() == ".dae":
                mesh = _coloured_triangles(mesh, Path(geometry.meshPath), np.asarray(geometry.meshScale))
            return mesh, material
    logger.warning("visual '%s' is a %s, which is not drawn", geometry.name, type(body).__name__)
    return None


def _triangles(body: Any) -> Mesh:
    faces = np.array([[t[0], t[1], t[2]] for t in (body.tri_indices(k) for k in range(body.num_tris))])
    return Mesh(np.array(body.vertices()), faces)


def _coloured_triangles(mesh: Mesh, path: Path, scale: np.ndarray) -> Mesh:
    """Return the file's own triangles with colours if they fill the same space as Pinocchio's, else those."""
    for up_axis in (False, True):
        try:
            found = read_collada(path, up_axis=up_axis)
        except (ElementTree.ParseError, ValueError, KeyError, StopIteration) as error:
            logger.info("colours of '%s' are not read: %s", path.name, error)
            return mesh
        placed = Mesh(found.vertices * scale, found.faces, found.colors)
        if np.allclose(_extent(placed), _extent(mesh), atol=0.01 * float(np.ptp(mesh.vertices))):
            return placed
    return mesh


def _extent(mesh: Mesh) -> np.ndarray:
    return np.stack([mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)])


_UP = {
    "Y_UP": np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]),
    "X_UP": np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]),
}
_TEXTURED: Color = (0.7, 0.7, 0.72)


def read_collada(path: Path, *, up_axis: bool) -> Mesh:
    """Return a .dae file as one mesh with colours; ``up_axis`` turns the file's up axis to z.

    Raises ValueError, KeyError or `ElementTree.ParseError` for what it cannot read.
    """
    root = ElementTree.parse(path).getroot()
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    ids = {e.get("id"): e for e in root.iter() if e.get("id")}
    unit = root.find("asset/unit")
    start = np.diag([float(unit.get("meter", 1)) if unit is not None else 1.0] * 3 + [1.0])
    if up_axis:
        start = _UP.get(root.findtext("asset/up_axis", "Y_UP").strip(), np.eye(4)) @ start
    pieces: list[tuple[np.ndarray, np.ndarray, Color]] = []
    scene = root.find("scene/instance_visual_scene")
    top = ids[_target(scene)] if scene is not None else root.find("library_visual_scenes/visual_scene")
    if top is None:
        raise ValueError("no scene")
    for node in top.findall("node"):
        _walk(node, start, ids, pieces)
    if not pieces:
        raise ValueError("no triangles")
    offsets = np.cumsum([0, *(len(v) for v, _, _ in pieces)])
    return Mesh(
        np.concatenate([v for v, _, _ in pieces]),
        np.concatenate([f + o for (_, f, _), o in zip(pieces, offsets, strict=False)]),
        np.concatenate([np.tile(c, (len(v), 1)) for v, _, c in pieces]),
    )


def _target(element: ElementTree.Element, key: str = "url") -> str:
    return element.get(key, "").removeprefix("#")


def _numbers(text: str | None, kind: type = float) -> np.ndarray:
    return np.array((text or "").split(), dtype=kind)


def _walk(node: ElementTree.Element, parent: np.ndarray, ids: dict, pieces: list) -> None:
    pose = parent
    for element in node:
        values = _numbers(element.text) if element.tag in ("matrix", "translate", "rotate", "scale") else None
        if values is None:
            continue
        step = np.eye(4)
        if element.tag == "matrix":
            step = values.reshape(4, 4)
        elif element.tag == "translate":
            step[:3, 3] = values
        elif element.tag == "scale":
            step[:3, :3] = np.diag(values)
        else:
            step[:3, :3] = Rotation.from_rotvec(np.deg2rad(values[3]) * values[:3]).as_matrix()
        pose = pose @ step
    for instance in node.findall("instance_geometry"):
        bound = {m.get("symbol"): _target(m, "target") for m in instance.iter("instance_material")}
        mesh = ids[_target(instance)].find("mesh")
        if mesh is not None:
            pieces += _primitives(mesh, pose, bound, ids)
    for child in node.findall("node"):
        _walk(child, pose, ids, pieces)
    for instance in node.findall("instance_node"):
        _walk(ids[_target(instance)], pose, ids, pieces)


def _primitives(mesh: ElementTree.Element, pose: np.ndarray, bound: dict, ids: dict) -> list:
    pieces = []
    for primitive in mesh:
        if primitive.tag not in ("triangles", "polylist"):
            continue
        inputs = primitive.findall("input")
        vertex = next(i for i in inputs if i.get("semantic") == "VERTEX")
        stride = 1 + max(int(i.get("offset", 0)) for i in inputs)
        index = _numbers(primitive.findtext("p"), int)
        index = index.reshape(-1, stride)[:, int(vertex.get("offset", 0))]
        if primitive.tag == "polylist":
            index = _fan(index, _numbers(primitive.findtext("vcount"), int))
        position = next(
            i for i in ids[_target(vertex, "source")].findall("input") if i.get("semantic") == "POSITION"
        )
        points = _numbers(ids[_target(position, "source")].findtext("float_array")).reshape(-1, 3)
        used, faces = np.unique(index, return_inverse=True)
        placed = points[used] @ pose[:3, :3].T + pose[:3, 3]
        pieces.append((placed, faces.reshape(-1, 3), _color(primitive.get("material", ""), bound, ids)))
    return pieces


def _fan(index: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Cut polygons into triangles."""
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    first = np.repeat(starts, counts - 2)
    step = np.concatenate([np.arange(1, c - 1) for c in counts]) if len(counts) else np.zeros(0, dtype=int)
    return index[np.stack([first, first + step, first + step + 1], axis=1).ravel()]


def _color(symbol: str, bound: dict, ids: dict) -> Color:
    material = ids.get(bound.get(symbol, symbol))
    instance = material.find("instance_effect") if material is not None else None
    effect = ids.get(_target(instance)) if instance is not None else None
    diffuse = effect.find(".//diffuse") if effect is not None else None
    if diffuse is None:
        return _TEXTURED
    color = diffuse.find("color")
    if color is None:
        return _TEXTURED
    r, g, b = np.clip(_numbers(color.text)[:3], 0.0, 1.0)
    return float(r), float(g), float(b)
