"""The visual geometry of the URDFs as shapes."""

from __future__ import annotations

import logging
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from smsid.errors import require
from smsid.model.build import build_model
from smsid.model.spacecraft import SpacecraftModel
from smsid.view.collada import read_collada
from smsid.view.shapes import Box, Cylinder, Material, Mesh, Shape, Sphere

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
                mesh = _coloured(mesh, Path(geometry.meshPath), np.asarray(geometry.meshScale))
            return mesh, material
    logger.warning("visual '%s' is a %s, which is not drawn", geometry.name, type(body).__name__)
    return None


def _triangles(body: Any) -> Mesh:
    faces = np.array([[t[0], t[1], t[2]] for t in (body.tri_indices(k) for k in range(body.num_tris))])
    return Mesh(np.array(body.vertices()), faces)


def _coloured(mesh: Mesh, path: Path, scale: np.ndarray) -> Mesh:
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
