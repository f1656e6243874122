"""Shapes and materials as plain data; what they become in a browser is in `commands`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Color = tuple[float, float, float]


@dataclass(frozen=True)
class Material:
    """Colour (red, green, blue in 0 to 1), opacity, gloss, and whether light does not matter to it.

    ``overlay``: seen through whatever is in front. ``inside``: faces are drawn from behind as well; for
    see-through materials a browser then draws twice.
    """

    color: Color = (0.9, 0.9, 0.9)
    opacity: float = 1.0
    shine: float = 0.3
    unlit: bool = False
    overlay: bool = False
    inside: bool = True


@dataclass(frozen=True)
class Box:
    """A box centred at the origin; ``size`` along x, y, z [m]."""

    size: tuple[float, float, float]


@dataclass(frozen=True)
class Sphere:
    """A sphere about the origin [m]."""

    radius: float


@dataclass(frozen=True)
class Cylinder:
    """A cylinder along z, centred at the origin; ``top`` is its upper radius (default: the same) [m]."""

    radius: float
    length: float
    top: float | None = None


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles: vertices (V, 3) [m], faces (F, 3), and colours of the vertices (V, 3) or None.

    Facets are shaded flat.
    """

    vertices: np.ndarray
    faces: np.ndarray
    colors: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Lines:
    """Line segments between points (2 S, 3) [m], taken in pairs."""

    points: np.ndarray


@dataclass(frozen=True, eq=False)
class Stars:
    """Points (S, 3) [m] of constant size on the screen, with colours (S, 3)."""

    points: np.ndarray
    colors: np.ndarray


CORNERS = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) / 2
"""Corners (8, 3) of a box of unit size."""

Shape = Box | Sphere | Cylinder | Mesh | Lines | Stars


def half_size(shape: Shape) -> np.ndarray:
    """Return half the axis-aligned extent of a shape about its origin (3,) [m]."""
    match shape:
        case Box(size):
            return np.asarray(size) / 2
        case Sphere(radius):
            return np.full(3, radius)
        case Cylinder(radius, length, top):
            widest = max(radius, top or 0.0)
            return np.array([widest, widest, length / 2])
        case Mesh(vertices=points) | Lines(points=points) | Stars(points=points):
            return np.abs(points).max(axis=0, initial=0.0)


def contains(shape: Shape, point: np.ndarray) -> bool:
    """Say whether a point (3,), in the shape's axes, lies inside it (a mesh: inside its extent)."""
    match shape:
        case Sphere(radius):
            return bool(np.linalg.norm(point) < radius)
        case Cylinder(radius, length):
            return bool(np.hypot(point[0], point[1]) < radius and abs(point[2]) < length / 2)
        case Mesh(vertices=v):
            return bool(np.all(point > v.min(axis=0)) and np.all(point < v.max(axis=0)))
        case Box():
            return bool(np.all(np.abs(point) < half_size(shape)))
        case _:
            return False


def box_edges(size: tuple[float, float, float]) -> Lines:
    """Return the twelve edges of a box."""
    pairs = [(a, b) for a in range(8) for b in range(a + 1, 8) if (a ^ b) in (1, 2, 4)]
    return Lines(CORNERS[np.array(pairs).ravel()] * size)


def boxes_mesh(boxes: list[tuple[tuple[float, float, float], tuple[float, float, float], Color]]) -> Mesh:
    """Return several boxes (centre, size, colour) as one mesh with a vertex each per face."""
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    vertices, faces, colors = [], [], []
    for centre, size, color in boxes:
        for quad in quads:
            first = 4 * len(faces)
            vertices.append(CORNERS[quad] * size + centre)
            faces.append([[first, first + 1, first + 2], [first, first + 2, first + 3]])
            colors.append(np.tile(color, (4, 1)))
    return Mesh(np.concatenate(vertices), np.concatenate(faces), np.concatenate(colors))
