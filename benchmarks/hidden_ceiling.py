"""What the experiments of the hidden effects allow, by the tests' own simulations.

    python benchmarks/hidden_ceiling.py [--worlds arm rigid panel sms] [--seed 5]

For each world: how often effects as drawn for the study at strengths 1, 3 and 10 are found at the level of
the diagnosis and are among the three that explain most, for a likelihood that knows the motion and all but
the nominal parameters; and the squares that an efficient estimate of these leaves on the held-out flight.
Worlds done before with the same sources are kept in ``results/hidden_ceiling.json``.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from _common import RESULTS, ROOT, environment, write_result
from rich.console import Console

from smsid.diagnose import DetectionThresholds
from smsid.diagnose.validation import SETTLE
from tests.hidden.ceiling import held_out, open_loop, recognised, signals
from tests.hidden.flight import write_run
from tests.hidden.numbers import WORLDS
from tests.hidden.plan import draw_effect
from tests.hidden.study import diagnosed

NAME = "hidden_ceiling"
STRENGTHS = (1.0, 3.0, 10.0)
DRAWS = 2000


def sources() -> str:
    """Digest of the tests' sources and limits that these figures come from."""
    found = hashlib.sha256()
    folder = ROOT / "tests" / "hidden"
    for path in sorted([*folder.glob("[!t]*.py"), folder / "limits.json"]):
        found.update(path.name.encode() + path.read_bytes())
    return found.hexdigest()[:16]


def candidates(world: str) -> int:
    """Return how many candidates the diagnosis tries on a flight of a world."""
    with tempfile.TemporaryDirectory(prefix="hidden-") as folder:
        found, _ = diagnosed(write_run(world, Path(folder), [0, 79]), Path(folder))
    return found.search.candidates


def ceiling(world: str, seed: int) -> dict[str, Any]:
    """Return the figures of one world."""
    rng = np.random.default_rng([seed, sorted(WORLDS).index(world)])
    count, level = candidates(world), DetectionThresholds().candidate
    known, shares = signals(world), {}
    for strength in STRENGTHS:
        drawn = [draw_effect(world, rng, strength) for _ in range(DRAWS)]
        shares[f"{strength:g}"] = round(recognised(known, drawn, count, level, rng), 4)
    left = held_out(world)
    ratios = open_loop(world, rng, settle=SETTLE)
    return {
        "sources": sources(),
        "seed": seed,
        "environment": environment("smsid", "pin", "mujoco", "numpy", "scipy"),
        "candidates": count,
        "level": level,
        "recognised": shares,
        "held_out": {
            "expected": float(f"{left.sum():.4g}"),
            "eigenvalues": [float(f"{x:.4g}") for x in left if x > 1e-3],
            "open_loop": {
                "median": round(float(np.median(ratios)), 3),
                "within_1.1": round(float(np.mean(ratios <= 1.1)), 3),
            },
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
        mine = known.get(world, {})
        if (mine.get("sources"), mine.get("seed")) == (sources(), arguments.seed):
            continue
        known[world] = ceiling(world, arguments.seed)
        write_result(NAME, {"worlds": known})
        console.print(world, known[world]["recognised"], known[world]["held_out"]["expected"])


if __name__ == "__main__":
    main()
