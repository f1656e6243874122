"""All effects a world may hide, by name."""

from __future__ import annotations

from functools import cache

from .effect import Hidden
from .joint_effects import joint_effects
from .numbers import WORLDS
from .signal_effects import actuator_effects, sensor_effects
from .structure_effects import structure_effects


@cache
def hidden_effects(world: str) -> dict[str, Hidden]:
    """Every effect that the world may hide."""
    n = WORLDS[world]
    found = [*joint_effects(n), *structure_effects(n), *actuator_effects(n), *sensor_effects(n)]
    by_name = {h.name: h for h in found}
    if len(by_name) != len(found):
        names = [h.name for h in found]
        raise ValueError(f"names repeat: {sorted({x for x in names if names.count(x) > 1})}")
    return by_name
