"""All effects a world may hide, by name."""

from __future__ import annotations

from functools import cache

from .body_effects import body_effects
from .effect import Hidden
from .joint_effects import joint_effects
from .numbers import WORLDS
from .signal_effects import actuator_effects, sensor_effects
from .structure_effects import structure_effects

LEFT_OUT = {  # places whose effects one world shows well enough
    "panel": ("joint1", "joint3", "link1", "link2", "wheel_y", "wheel_z"),
    "rigid": ("joint1", "link1", "link2", "wheel_x", "wheel_y"),
}


@cache
def hidden_effects(world: str) -> dict[str, Hidden]:
    """Every effect that the world may hide."""
    found = _effects(world, every=False)
    left_out = LEFT_OUT.get(world, ())
    return {name: h for name, h in found.items() if h.location not in left_out}


@cache
def nameable_effects(world: str) -> dict[str, Hidden]:
    """Every effect of the world that a diagnosis may name, hidden or not."""
    return _effects(world, every=True)


def _effects(world: str, *, every: bool) -> dict[str, Hidden]:
    n = WORLDS[world]
    found = [
        *joint_effects(n),
        *body_effects(n),
        *structure_effects(n),
        *actuator_effects(n),
        *sensor_effects(n, every=every),
    ]
    by_name = {h.name: h for h in found}
    if len(by_name) != len(found):
        names = [h.name for h in found]
        raise ValueError(f"names repeat: {sorted({x for x in names if names.count(x) > 1})}")
    return by_name
