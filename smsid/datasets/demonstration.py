"""The bundled craft of ``smsid demo``: a description, two flights of MuJoCo, and what was hidden in them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent / "bundled"


@dataclass(frozen=True)
class Demonstration:
    """Files of the demonstration, and the truth.

    ``estimation`` is identified and diagnosed, ``validation`` judges. ``hidden`` is what the description
    lacks (effect, location, parameter, value, unit), ``parameters`` the world's true values by name; neither
    is for anything but the comparison at the end. ``engine`` made the flights.
    """

    description: Path
    estimation: Path
    validation: Path
    engine: str
    hidden: Mapping[str, Any]
    parameters: Mapping[str, float]


def demonstration() -> Demonstration:
    """Return the bundled demonstration; it is part of the installed package and needs no network."""
    truth = json.loads((FOLDER / "truth.json").read_text(encoding="utf-8"))
    return Demonstration(
        FOLDER / "demo_craft.toml",
        FOLDER / "estimation.nc",
        FOLDER / "validation.nc",
        truth["engine"],
        truth["hidden"],
        truth["parameters"],
    )
