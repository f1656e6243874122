"""A spacecraft as a ghost: see-through and of one colour, to lie over another."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from smsid.view.parts import Part
from smsid.view.shapes import Color, Lines, Material, Mesh

GHOST: Color = (0.10, 0.55, 0.85)
VEIL = Material(GHOST, opacity=0.30, shine=0.2, inside=False)
LEFT_OUT = ("centre of mass", "sensors")


def as_overlay(parts: Iterable[Part]) -> list[Part]:
    """Return parts as a ghost's: what would only confuse left out, trails as they are."""
    found: list[Part] = []
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
