"""What no diagnosis of the hidden effects can do better, by the tests' own Fisher information.

    python benchmarks/hidden_ceiling.py [--worlds arm rigid panel sms] [--seed 5]

For each world: the power of the best test at the level of the diagnosis and at that of strength 1, the share
of effects drawn at strengths 1, 3 and 10 that this experiment tells from all but two others, and the squares
an efficient estimate of the nominal parameters leaves on the held-out flight. Worlds done before are kept in
``results/hidden_ceiling.json`` (delete it to start anew).
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from _common import RESULTS, environment, write_result
from rich.console import Console

from smsid.diagnose import Levels
from tests.hidden.ceiling import distances, held_out, power, separable
from tests.hidden.flight import write_run
from tests.hidden.numbers import WORLDS
from tests.hidden.study import diagnosed

NAME = "hidden_ceiling"
STRENGTHS = (1.0, 3.0, 10.0)


def candidates(world: str) -> int:
    """Return how many candidates the diagnosis tries on a flight of a world."""
    with tempfile.TemporaryDirectory(prefix="hidden-") as folder:
        found, _ = diagnosed(write_run(world, Path(folder), [0, 79]), Path(folder))
    return found.search.candidates


def ceiling(world: str, rng: np.random.Generator) -> dict[str, Any]:
    """Return the figures of one world."""
    count, level = candidates(world), Levels().candidate
    apart = distances(world)
    left = held_out(world)
    return {
        "candidates": count,
        "power": {"diagnosis": round(power(count, level), 4), "strength 1": round(power(60, 0.01), 4)},
        "told_from_all_but_two": {f"{s:g}": round(separable(apart, world, s, rng), 4) for s in STRENGTHS},
        "held_out": {
            "expected": float(f"{left.sum():.4g}"),
            "eigenvalues": [float(f"{x:.4g}") for x in left if x > 1e-3],
        },
    }


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--worlds", nargs="+", default=list(WORLDS), choices=list(WORLDS))
    parser.add_argument("--seed", type=int, default=5)
    arguments = parser.parse_args()
    console = Console()
    path = RESULTS / f"{NAME}.json"
    known = json.loads(path.read_text(encoding="utf-8"))["worlds"] if path.is_file() else {}
    for world in arguments.worlds:
        if world in known:
            continue
        known[world] = ceiling(world, np.random.default_rng([arguments.seed, len(world)]))
        made = environment("smsid", "pin", "mujoco", "numpy", "scipy")
        write_result(NAME, {"environment": made, "seed": arguments.seed, "worlds": known})
        console.print(world, known[world]["power"], known[world]["told_from_all_but_two"])


if __name__ == "__main__":
    main()
