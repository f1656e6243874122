"""Appendages as a page bends them itself: shapes and modal coordinates instead of the poses of strips."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from smsid.view.drivers import Frames, StripDriver
from smsid.view.scene import Scene


@dataclass(frozen=True)
class Bend:
    """A surface of S strips with M modes over N frames, in surface axes.

    ``paths`` (S) of the strips' nodes; ``step`` [m] a strip's length; ``edges`` (S + 1, M, 3) [m] movement of
    the strips' edges per unit modal coordinate, ``twist`` (S, M) [rad] their rotation about x; ``delta``
    (N, M) modal coordinates true to scale. Twin in the page: `bendStrips` in player.js.
    """

    paths: tuple[str, ...]
    step: float
    edges: np.ndarray
    twist: np.ndarray
    delta: np.ndarray


def bending_parts(scene: Scene, frames: Frames) -> list[Bend]:
    """Return what bends in a scene, over the frames; appendages without modes do not."""
    strips: dict[str, list[tuple[str, StripDriver]]] = {}
    for part in scene.parts:
        if isinstance(part.driver, StripDriver) and len(part.driver.q):
            strips.setdefault(part.path.rpartition("/")[0], []).append((part.path, part.driver))
    found = []
    for drawn in strips.values():
        driver = drawn[0][1]
        surface, count = driver.surface, driver.strips
        step = surface.length / count
        delta = frames.motion.q[:, driver.q] * driver.scale
        edges = surface.displacement(step * np.arange(count + 1))
        twist = surface.twist(step * (np.arange(count) + 0.5))
        found.append(Bend(tuple(path for path, _ in drawn), step, edges, twist, delta))
    return found
