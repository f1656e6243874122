"""Processor time of a whole diagnosis, against checkouts of other commits: same recordings, turn by turn.

    python benchmarks/diagnosis_speed.py --beside ../before [--seeds-from 970000] [--runs 24]

Worlds and what they hide are those of `hidden_effects`. Every diagnosis runs in a process of its own; the
time from files to document counts, without imports and compilation. It also says where verdict, causes or
their values (by more than a tenth of their standard deviation) are others.
"""

from __future__ import annotations

import argparse
import json
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from _common import ROOT, commit, environment, write_result
from rich.console import Console

from tests.hidden.plan import draw_run
from tests.hidden.study import tamed

ONE = """
import json, pickle, sys, time
from pathlib import Path
from tests.hidden.study import diagnosed
folder = Path(sys.argv[1])
files = pickle.loads((folder / "files").read_bytes())
began = time.process_time()
document = diagnosed(files, folder)[1]
print(json.dumps({"seconds": time.process_time() - began, "document": document}))
"""


def diagnosis(tree: Path, folder: Path) -> dict[str, Any]:
    """Return processor time [s] and document of a diagnosis by the sources in a folder."""
    own = {
        "PYTHONPATH": str(tree),
        "SMSID_COMPILED": "1",
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
    }
    command = [sys.executable, "-c", "import smsid.diagnose\n" + ONE, str(folder)]
    done = subprocess.run(
        command, cwd=tree, env={**os.environ, **own}, stdout=subprocess.PIPE, check=True, text=True
    )
    return json.loads(done.stdout.splitlines()[-1])


def differences(one: dict[str, Any], other: dict[str, Any]) -> list[str]:
    """Return what two documents say differently."""
    if one["verdict"] != other["verdict"]:
        return [f"{one['verdict']}, not {other['verdict']}"]
    found = []
    for part in ("causes", "partial"):
        mine, theirs = ([(c["effect"], c["location"]) for c in d[part]] for d in (one, other))
        if mine != theirs:
            found.append(f"{part} {mine}, not {theirs}")
            continue
        for a, b in zip(one[part], other[part], strict=True):
            for x, y in zip(a["parameters"], b["parameters"], strict=True):
                away = abs(x["value"] - y["value"]) / (y["sigma"] or np.inf)
                if away > 0.1:
                    found.append(f"{x['name']} by {away:.2g} standard deviations")
    return found


def summed_up(rows: Sequence[dict[str, Any]], trees: Sequence[str]) -> dict[str, Any]:
    """Return seconds by world and tree: median, 95 % and the most."""
    worlds = {"all": list(rows)}
    for row in rows:
        worlds.setdefault(row["world"], []).append(row)
    out: dict[str, Any] = {}
    for world, own in worlds.items():
        seconds = {tree: np.array([r["seconds"][tree] for r in own]) for tree in trees}
        out[world] = {"runs": len(own)} | {
            tree: {
                "median": float(np.median(x)),
                "at 95 %": float(np.quantile(x, 0.95)),
                "most": float(x.max()),
            }
            for tree, x in seconds.items()
        }
        out[world]["ratio"] = {
            t: float(np.median(seconds["now"] / x)) for t, x in seconds.items() if t != "now"
        }
    return out


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--beside", type=Path, nargs="+", required=True, help="checkouts of other commits")
    parser.add_argument("--seeds-from", type=int, default=970000, help="first seed; one run a seed")
    parser.add_argument("--runs", type=int, default=24)
    parser.add_argument("--seeds", type=int, nargs="+", help="these seeds and no others")
    arguments = parser.parse_args()
    console = Console()
    trees = {commit(tree): tree.resolve() for tree in arguments.beside} | {"now": ROOT}
    rows = []
    for seed in arguments.seeds or range(arguments.seeds_from, arguments.seeds_from + arguments.runs):
        with tempfile.TemporaryDirectory(prefix="speed-") as name:
            folder = Path(name)
            run, files = tamed(draw_run(seed), folder)
            (folder / "files").write_bytes(pickle.dumps(files))
            made = {label: diagnosis(tree, folder) for label, tree in trees.items()}
        row = {
            "seed": seed,
            "world": run.world,
            "hidden": [f"{i.effect.name} x{i.strength:g}" for i in run.hidden],
            "verdict": made["now"]["document"]["verdict"],
            "seconds": {label: m["seconds"] for label, m in made.items()},
            "differs": {
                label: differences(made["now"]["document"], m["document"])
                for label, m in made.items()
                if label != "now"
            },
        }
        rows.append(row)
        times = ", ".join(f"{label} {x:.2f} s" for label, x in row["seconds"].items())
        console.print(f"{run.key}: {times} {row['differs']}")
        result = {
            "environment": environment("smsid", "pin", "numpy", "scipy", "numba"),
            "commit": commit(ROOT),
            "worlds": summed_up(rows, list(trees)),
            "runs": rows,
        }
        write_result("diagnosis_speed", result)


if __name__ == "__main__":
    main()
