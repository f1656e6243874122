"""A bending surface: a flat plate cut into strips whose poses follow the modal coordinates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline

from smsid.effects.appendage import Appendage
from smsid.view._shapes import Color, Mesh, boxes_mesh

Field = Callable[[np.ndarray], np.ndarray]

SILVER: Color = (0.72, 0.74, 0.78)
BACK: Color = (0.40, 0.38, 0.36)


@dataclass(frozen=True)
class Surface:
    """A plate with x along its length from the root end, z normal, in ``frame`` of the appendage axes.

    ``displacement`` gives, for stations x (S,) [m], the movement (S, modes, 3) [m] in surface axes per unit
    modal coordinate; ``twist`` the rotation about x (S, modes) [rad] per unit.
    """

    frame: np.ndarray
    length: float
    width: float
    thickness: float
    displacement: Field
    twist: Field
    rigid: bool = False

    def strip_poses(self, delta: np.ndarray, strips: int, index: np.ndarray | None = None) -> np.ndarray:
        """Return the poses (N, strips, 4, 4) in surface axes for modal coordinates delta (N, modes).

        A strip's x axis is the chord between its edges, scaled so that neighbours meet; ``index`` picks some.
        """
        chosen = np.arange(strips) if index is None else index
        step = self.length / strips
        edges = np.stack([chosen * step, (chosen + 1) * step])
        at = edges.ravel()
        points = np.einsum("nm,smk->nsk", delta, self.displacement(at))
        points[..., 0] += at
        start, end = points[:, : len(chosen)], points[:, len(chosen) :]
        angle = delta @ self.twist(edges.mean(axis=0)).T
        chord = end - start
        size = np.linalg.norm(chord, axis=-1, keepdims=True)
        x = chord / size
        lateral = np.stack([np.zeros_like(angle), np.cos(angle), np.sin(angle)], axis=-1)
        z = np.cross(x, lateral)
        z /= np.linalg.norm(z, axis=-1, keepdims=True)
        poses = np.zeros((*angle.shape, 4, 4))
        poses[..., :3, 0] = x * size / step
        poses[..., :3, 1] = np.cross(z, x)
        poses[..., :3, 2] = z
        poses[..., :3, 3] = (start + end) / 2
        poses[..., 3, 3] = 1.0
        return poses


def surface_of(appendage: Appendage) -> Surface:
    """Return the surface that stands for an appendage; one without mode shapes is drawn rigid.

    Where its shape is known at stations alone, it is interpolated along the plate, clamped at the root; it
    twists where stations lie abreast.
    """
    plate, described = appendage.plate(), appendage.modal_data()
    modes = len(described)
    still = np.zeros(modes)
    if plate is not None:
        size, shape = plate
        up = np.array([0.0, 0.0, 1.0])
        return Surface(np.eye(4), *size, lambda x: shape(x)[..., None] * up, _constant(still))
    size, pose = inertia_box(appendage.rigid_inertia())
    frame = pose.copy()
    frame[:3, 3] -= pose[:3, 0] * size[0] / 2
    rotation, origin = frame[:3, :3], frame[:3, 3]
    root = float(-origin @ rotation[:, 0])
    stations = (appendage.station_positions() - origin) @ rotation
    shapes = np.array([m.shape for m in described]).reshape(modes, len(stations), 3) @ rotation
    rows: list[tuple[float, np.ndarray]] = []
    twists: list[tuple[float, np.ndarray]] = []
    left = [k for k in np.argsort(stations[:, 0], kind="stable") if stations[k, 0] > root + 0.02 * size[0]]
    while left:
        abreast = [k for k in left if stations[k, 0] < stations[left[0], 0] + 0.02 * size[0]]
        left = left[len(abreast) :]
        s, y = float(stations[abreast, 0].mean()), stations[abreast, 1]
        mean = shapes[:, abreast].mean(axis=1)
        if np.ptp(y) > 0.02 * size[1]:
            slope, level = np.polyfit(y, shapes[:, abreast, 2].T, 1)
            mean[:, 2] = level
            twists.append((s, slope))
        rows.append((s, mean))
    rigid, flat = not rows or not modes, np.zeros((modes, 3))
    bent = _constant(flat) if rigid else _clamped_spline(root, rows, flat, order=1)
    turned = _constant(still) if rigid or not twists else _clamped_spline(root, twists, still, order=2)
    return Surface(frame, float(size[0]), float(size[1]), float(size[2]), bent, turned, rigid)


def inertia_box(inertia: pin.Inertia) -> tuple[np.ndarray, np.ndarray]:
    """Return the uniform box with this inertia: its sizes (3,), longest first, and its pose (4, 4)."""
    moments, axes = np.linalg.eigh(inertia.inertia)
    squares = 6.0 / max(inertia.mass, 1e-12) * (moments.sum() - 2.0 * moments)
    size = np.sqrt(np.maximum(squares, 0.0))
    size = np.maximum(size, max(0.003 * size.max(), 1e-3))
    pose = np.eye(4)
    x, z = axes[:, 0], axes[:, 2]
    x = -x if x @ inertia.lever < -1e-12 else x
    z = -z if z[np.argmax(np.abs(z))] < 0.0 else z
    pose[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    pose[:3, 3] = inertia.lever
    return size, pose


def _constant(value: np.ndarray) -> Field:
    return lambda x: np.broadcast_to(value, (len(x), *value.shape))


def _clamped_spline(
    root: float, rows: list[tuple[float, np.ndarray]], zero: np.ndarray, *, order: int
) -> Field:
    """Spline through the rows, zero at the root with its derivative of that order; straight past the end."""
    at = np.array([root, *(s for s, _ in rows)])
    values = np.array([zero, *(v for _, v in rows)])
    ends: Any = ((order, zero), (2, zero))
    spline = CubicSpline(at, values, bc_type=ends)
    slope = spline(at[-1], 1)

    def field(x: np.ndarray) -> np.ndarray:
        inside = spline(np.clip(x, root, at[-1]))
        beyond = np.maximum(x - at[-1], 0.0).reshape(-1, *([1] * zero.ndim))
        return inside + beyond * slope

    return field


def solar_strip(surface: Surface, strips: int, index: int) -> Mesh:
    """Return the mesh of one strip: blue cells on a silver grid, a wider gap between panels, a dark back."""
    step, t = surface.length / strips, max(surface.thickness, 0.004 * surface.length)
    rows = max(1, round(surface.width / step))
    cell = surface.width / rows
    gap, hinge = 0.035 * min(step, cell), 0.10 * step
    per_panel = max(2, round(strips / max(1, round(surface.length / max(surface.width, 1e-9) * 1.5))))
    low = -step / 2 + (hinge if index % per_panel == 0 else gap)
    high = step / 2 - (hinge if (index + 1) % per_panel == 0 or index == strips - 1 else gap)
    boxes = [
        ((0.0, 0.0, 0.0), (step, surface.width, 0.6 * t), SILVER),
        ((0.0, 0.0, -0.4 * t), (step, 0.985 * surface.width, 0.2 * t), BACK),
    ]
    for row in range(rows):
        tone = 1.0 + 0.13 * np.sin(12.9 * index + 78.2 * row)
        color = (0.05 * tone, 0.10 * tone, 0.34 * tone)
        centre = ((low + high) / 2, -surface.width / 2 + (row + 0.5) * cell, 0.4 * t)
        boxes.append((centre, (high - low, cell - 2 * gap, 0.2 * t), color))
    return boxes_mesh(boxes)
