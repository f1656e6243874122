"""Convergence from a description wrong by 30 % in every mass, inertia and property: rate over random starts.

    python benchmarks/convergence.py 100

Every start draws noise, and signs of 30 % for every body, slosh and panel property; linear method, then
maximum likelihood, on both experiments of the MuJoCo twin. A run has converged when every parameter that the
data see is within half a standard deviation of the fit of the same noise by `benchmarks/likelihood.py`, which
starts next to the maximum. Runs are kept in build/convergence.jsonl and not repeated.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from _common import ROOT, environment, write_result
from _likelihood_cases import bounds, described, recordings, twin, wrong
from _likelihood_cases import runs as study
from _likelihood_summary import SEEN

from smsid.errors import SmsidError
from smsid.identify.paper.pipeline import identify
from smsid.likelihood import refine
from smsid.likelihood.pseudo_inertia import is_body

NAME = "convergence"
RUNS = ROOT / "build" / f"{NAME}.jsonl"
OFF = 0.30
NEAR = 0.5  # standard deviations


def run(seed: int, folder: Path) -> dict[str, Any]:
    """One start: the estimate, or why it failed."""
    noisy = [twin.noisy(r, seed) for r in recordings("joint")]
    description = wrong(described("joint"), seed, OFF, folder)
    begin = time.process_time()
    record: dict[str, Any] = {"seed": seed}
    try:
        start = identify(description, noisy)
        linear = time.process_time() - begin
        found = refine(description, noisy, start)
    except SmsidError as error:
        return {**record, "failed": f"{type(error).__name__}: {error}"}
    return {
        **record,
        "values": {p.name: [p.value, p.sigma] for p in found.estimate.parameters if p.group != "nuisance"},
        "physical": all(is_body(theta) for theta in found.inertias.values()),
        "iterations": found.estimate.conditions["iterations"],
        "cost_per_sample": found.estimate.conditions["sum of squares / samples"],
        "cpu_seconds": {"linear": linear, "refinement": time.process_time() - begin - linear},
    }


def farthest(values: dict[str, list[float]], reference: dict[str, list[float]]) -> float:
    """Largest distance of a seen parameter to the reference, in standard deviations."""
    shares = {name: row[2] for name, row in bounds("joint").items()}
    seen = [n for n in reference if shares.get(n, 1.0) < SEEN]
    if any(n not in values for n in seen):
        return float("inf")
    return max(abs(values[n][0] - reference[n][0]) / reference[n][1] for n in seen)


def summary(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Rate of convergence, with what the runs took."""
    fits = {r["seed"]: r for r in study() if r["case"] == "joint" and r["method"] == "ml"}
    judged = [r for r in runs if "values" in fits.get(r["seed"], {})]
    good = [r for r in judged if "values" in r]
    far = np.array([farthest(r["values"], fits[r["seed"]]["values"]) for r in good])
    return {
        "starts": len(judged),
        "converged": int(np.sum(far < NEAR)),
        "failed": [r["failed"] for r in judged if "failed" in r],
        "farthest [sigma]": {"median": float(np.median(far)), "largest": float(far.max())},
        "unphysical inertias": sum(not r["physical"] for r in good),
        "iterations": {
            "median": float(np.median([r["iterations"] for r in good])),
            "largest": max(r["iterations"] for r in good),
        },
        "cpu seconds, median": {
            k: float(np.median([r["cpu_seconds"][k] for r in good])) for k in ("linear", "refinement")
        },
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("starts", type=int)
    args = parser.parse_args()
    runs = [json.loads(line) for line in RUNS.read_text().splitlines()] if RUNS.is_file() else []
    done = {r["seed"] for r in runs}
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(args.starts):
            if seed in done:
                continue
            runs.append(run(seed, Path(folder)))
            with RUNS.open("a") as file:
                file.write(json.dumps(runs[-1]) + "\n")
            print(seed, runs[-1].get("failed") or runs[-1]["cpu_seconds"], flush=True)
    write_result(NAME, {"environment": environment("pin", "mujoco", "numpy", "scipy"), **summary(runs)})


if __name__ == "__main__":
    main()
