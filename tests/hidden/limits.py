"""Strength 1 of every hidden effect, as `fisher` found it; `python -m tests.hidden.limits` finds it again."""

from __future__ import annotations

import json
import math
import sys
from functools import cache
from pathlib import Path

from .catalogue import hidden_effects
from .numbers import WORLDS

TABLE = Path(__file__).resolve().parent / "limits.json"


@cache
def table() -> dict[str, dict[str, float]]:
    """The value of strength 1 by world and effect; effects without a trace are left out."""
    return json.loads(TABLE.read_text(encoding="utf-8"))


def strength_one(world: str, effect: str) -> float | None:
    """The value of strength 1 [unit of the effect], None where the experiment does not show it."""
    return table().get(world, {}).get(effect)


def main() -> None:
    """Find the limits of the worlds named, or of all."""
    from .fisher import experiment

    found = dict(table()) if TABLE.is_file() else {}
    for world in sys.argv[1:] or WORLDS:
        limits = {name: experiment(world).limit(name).value for name in hidden_effects(world)}
        found[world] = {k: float(f"{v:.4g}") for k, v in limits.items() if math.isfinite(v)}
        TABLE.write_text(json.dumps(found, indent=1, sort_keys=True) + "\n")


if __name__ == "__main__":
    main()
