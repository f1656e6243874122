"""Maximum likelihood against the Cramer-Rao bound, on recordings of the MuJoCo twin, seed by seed.

    python benchmarks/likelihood.py 400                     # seeds 0..399 of every case
    python benchmarks/likelihood.py 400 --case joint --linear 100
    python benchmarks/likelihood.py 0                       # only write the results anew

The twin has the model's three modes as sliding masses, so there is no model error. Noise of preset
`reference` at 100 Hz, biases drawn per recording (1e-4 m/s2, 1e-5 rad/s). The description handed in, around
which the priors are, is wrong by 5 % in every mass, inertia and property, another way for every seed. Fits
start from the refinement of one more noise draw, itself started from the linear method: the maximum does not
depend on the start (`benchmarks/convergence.py`). ``--linear``: for so many seeds the linear method alone,
same data. Runs are kept in build/likelihood.jsonl, one line each, and not repeated.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from _common import RESULTS, ROOT, environment, write_result
from _likelihood_cases import BUILD, CASES, RUNS, bounds, described, recordings, runs, twin, wrong
from _likelihood_summary import markdown, summary

from smsid._files import atomic_write
from smsid.errors import SmsidError
from smsid.identify.paper.pipeline import identify
from smsid.likelihood import Refinement, refine
from smsid.likelihood.pseudo_inertia import is_body

NAME = "likelihood"
LINEAR = ("joint",)
START = 1_000_000  # noise draw of the refinement that the others start from


@cache
def started(case: str, folder: Path) -> Refinement:
    """The refinement of one more noise draw, started from the linear method where that applies."""
    noisy = [twin.noisy(r, START) for r in recordings(case)]
    description = wrong(described(case), START, 0.05, folder)
    return refine(description, noisy, None if case.startswith("x") else identify(description, noisy))


def run(case: str, seed: int, folder: Path, *, linear: bool = False) -> dict[str, Any]:
    """One fit: values and standard deviations by name, or why it failed."""
    noisy = [twin.noisy(r, seed) for r in recordings(case)]
    description = wrong(described(case), seed, 0.05, folder)
    record: dict[str, Any] = {"case": case, "seed": seed, "method": "linear" if linear else "ml"}
    start = None if linear else started(case, folder)
    begin, cpu = time.perf_counter(), time.process_time()
    try:
        if linear:
            estimate = identify(description, noisy).estimate
        else:
            found = refine(description, noisy, start)
            estimate = found.estimate
            record["physical"] = all(is_body(theta) for theta in found.inertias.values())
            record["cost_per_sample"] = estimate.conditions["sum of squares / samples"]
            record["iterations"] = estimate.conditions["iterations"]
    except SmsidError as error:
        return {**record, "failed": f"{type(error).__name__}: {error}"}
    # the linear method gives some twice: Step B comes first, "as printed" after it under the same names
    kept = {p.name: p for p in reversed(estimate.parameters) if p.group != "nuisance"}.values()
    return {
        **record,
        "values": {p.name: [p.value, p.sigma, *p.interval] for p in kept if np.isfinite(p.sigma)},
        "identifiable": [p.name for p in kept if p.status == "identifiable"],
        "seconds": round(time.perf_counter() - begin, 2),
        "cpu_seconds": round(time.process_time() - cpu, 2),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("seeds", type=int)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--linear", type=int, default=0)
    parser.add_argument("--case", action="append", choices=CASES)
    args = parser.parse_args()
    BUILD.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for case in args.case or CASES:
            done = {(r["seed"], r["method"]) for r in runs() if r["case"] == case}
            todo = [(s, False) for s in range(args.first, args.first + args.seeds)]
            if case in LINEAR:
                todo += [(s, True) for s in range(args.first, args.first + args.linear)]
            for seed, linear in todo:
                if (seed, "linear" if linear else "ml") in done:
                    continue
                record = run(case, seed, folder, linear=linear)
                with RUNS.open("a") as file:
                    file.write(json.dumps(record) + "\n")
                print(case, seed, record.get("failed") or f"{record['cpu_seconds']} s", flush=True)
    write()


def write() -> None:
    """Write the summary of all runs so far; what was not run again stays, and is said to be of before."""
    found, file = runs(), RESULTS / f"{NAME}.json"
    before = json.loads(file.read_text())["cases"] if file.is_file() else {}
    table: dict[str, Any] = {}
    kept = []
    for case in CASES:
        own = [r for r in found if r["case"] == case]
        now = summary(own, bounds(case)) if own else {}
        for method in ("ml", "linear"):
            versions = [x[method] for x in (now, before.get(case, {})) if "parameters" in x.get(method, {})]
            if versions:
                table.setdefault(case, {})[method] = versions[0]
                kept += [] if "parameters" in now.get(method, {}) else [f"{case}, {method}"]
    document = {"environment": environment("pin", "mujoco", "numpy", "scipy"), "cases": table}
    document["of_an_earlier_run"] = kept
    write_result(NAME, document)
    atomic_write(ROOT / "benchmarks" / "results" / f"{NAME}.md", markdown(document))


if __name__ == "__main__":
    main()
