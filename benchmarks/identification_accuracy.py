"""Accuracy of the paper's method on recordings of another engine, over noise seeds, beside Tables 2 and 3.

    SMSID_ORACLE=<recordings> python benchmarks/identification_accuracy.py [--seeds 40] [--beside 20]

Runs are kept in ``build/identification_accuracy.jsonl`` and reused as long as code and inputs are the same,
so the script can be stopped and started again. It writes ``results/identification_accuracy.json`` and
``.md``; with ``--quick`` (3 seeds) it only prints the tables. ``--beside``: seeds of the cases beside the
reference sensors, half as many by default.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from pathlib import Path
from typing import Any

from _accuracy_cases import CASES, NOISE_FREE, Case, Data, run, truths
from _accuracy_summary import summary
from _accuracy_text import markdown
from _common import RESULTS, ROOT, environment, write_result
from rich.console import Console
from rich.markdown import Markdown
from rich.progress import MofNCompleteColumn, Progress, TimeRemainingColumn

from smsid._files import atomic_write

NAME = "identification_accuracy"
STORE = ROOT / "build" / f"{NAME}.jsonl"


def stored(fingerprint: str) -> dict[tuple[str, int], dict[str, Any]]:
    """Return the runs made with the same code and inputs, by case and seed."""
    if not STORE.is_file():
        return {}
    records = []
    for line in STORE.read_text(encoding="utf-8").splitlines():
        try:
            records.append(json.loads(line))
        except json.JSONDecodeError:  # cut short by an interruption
            continue
    return {(r["case"], r["seed"]): r for r in records if r["fingerprint"] == fingerprint}


def seeds_of(case: Case, seeds: int, beside: int) -> int:
    """Return how many seeds a case gets: ``beside`` without the reference sensors."""
    return seeds if case.name.startswith("reference") else beside


def collect(
    data: Data, seeds: int, beside: int
) -> tuple[dict[str, list[dict[str, Any]]], dict[str, dict[str, Any]]]:
    """Return the runs of every case, made or reused, and the true values."""
    fingerprint = data.fingerprint()
    have = stored(fingerprint)
    STORE.parent.mkdir(exist_ok=True)
    wanted: list[tuple[Case, int]] = [(case, 0) for case in NOISE_FREE]
    for seed in range(seeds):
        wanted += [(case, seed) for case in CASES if seed < seeds_of(case, seeds, beside)]
    runs: dict[str, list[dict[str, Any]]] = {}
    columns = (*Progress.get_default_columns()[:2], MofNCompleteColumn(), TimeRemainingColumn())
    with tempfile.TemporaryDirectory() as folder, STORE.open("a", encoding="utf-8") as file:
        # the first one is always made: true values follow from it
        first, found = run(NOISE_FREE[0], 0, data, Path(folder))
        if found is None:
            raise SystemExit(f"The noise-free identification failed: {first['failed']}")
        true = truths(data.description, found)
        with Progress(*columns, console=Console(stderr=True)) as progress:
            task = progress.add_task("identifying", total=len(wanted))
            for case, seed in wanted:
                progress.update(task, description=f"{case.name}, seed {seed}")
                record = have.get((case.name, seed))
                if record is None:
                    record, _ = run(case, seed, data, Path(folder))
                    record["fingerprint"] = fingerprint
                    file.write(json.dumps(record) + "\n")
                    file.flush()
                runs.setdefault(case.name, []).append(record)
                progress.advance(task)
    return runs, true


def main() -> None:
    """Run every case and write the result."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=40, help="noise realisations")
    parser.add_argument("--beside", type=int, help="those of cases beside the reference sensors")
    parser.add_argument("--repeats", type=int, default=11, help="runs that are timed")
    parser.add_argument("--quick", action="store_true", help="3 seeds, print only")
    options = parser.parse_args()
    seeds = 3 if options.quick else options.seeds
    beside = min(seeds, options.beside or (seeds + 1) // 2)
    data = Data()
    runs, true = collect(data, seeds, beside)
    load, repeats = [os.getloadavg()[0]], 3 if options.quick else options.repeats
    begin = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        timed = [run(CASES[0], seed, data, Path(folder))[0] for seed in range(repeats)]
    processor = (time.process_time() - begin) / repeats
    load.append(os.getloadavg()[0])
    result = {
        "what": "accuracy of smsid's linear (paper's) method on recordings of MuJoCo, noise added per seed",
        "seeds": list(range(seeds)),
        "seeds_of_cases_beside_the_reference": list(range(beside)),
        "environment": environment("pin", "numpy", "scipy"),
        "blas_threads": os.environ.get("OPENBLAS_NUM_THREADS", "not set; smsid limits itself to 1"),
        "inputs_sha256": data.sums(),
        "code_and_inputs": data.fingerprint(),
        "timed_runs": repeats,
        "processor_seconds_of_a_run_with_adding_noise": round(processor, 2),
        **summary(runs, true, timed, load),
    }
    text = markdown(result)
    Console().print(Markdown(text))
    if not options.quick:
        write_result(NAME, result)
        atomic_write(RESULTS / f"{NAME}.md", text)


if __name__ == "__main__":
    main()
