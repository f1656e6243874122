"""Table 4 over draws of uncertainty and noise: ``python benchmarks/table4.py --draws 100 --minutes 60``.

Resumable: every flight is a line of ``build/table4_runs.jsonl``; what is there is not flown again. Draws go
round all cases in blocks, so a run cut short still compares like with like. Case D flies with
models identified from another engine's recordings (``results/table4_identified.jsonl``; to make it again,
delete it and set SMSID_ORACLE).
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from functools import cache

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import numpy as np  # noqa: E402
from _common import RESULTS, ROOT, environment, spread, write_result  # noqa: E402
from _table4_identified import identified, identify_up_to, stored  # noqa: E402
from _table4_text import markdown  # noqa: E402

from smsid._files import atomic_write  # noqa: E402
from smsid.control.reduced import ReducedDynamics  # noqa: E402
from smsid.description import load_description  # noqa: E402
from smsid.kernel.jit import SWITCH  # noqa: E402
from smsid.model import build_model  # noqa: E402
from smsid.paper.table4 import CONTROLLERS, INTEGRATED_GYRO, Run, Study, Table4Row, Variant, cases  # noqa: E402
from smsid.paper.table4_study import improvements, orderings, printed_errors, summarise  # noqa: E402

LINES = ROOT / "build" / "table4_runs.jsonl"
MAIN, QUIET, GYRO = Variant(), "no noise", INTEGRATED_GYRO.name
VARIANTS = {
    v.name: v
    for v in (
        MAIN,
        Variant(QUIET, noise=0.0),
        Variant("noise / 10", noise=0.1),
        Variant("noise x 10", noise=10.0),
        Variant("arm stretched", start=(0.0, 0.0, 0.0)),
        Variant("no noise, signs", noise=0.0, draw="signs"),
        Variant("no noise, common factor", noise=0.0, draw="common"),
        Variant("a call late", delay=1),
        Variant("50 Hz", rate=50.0),
        INTEGRATED_GYRO,
    )
}
IDENTIFIED = 100  # models
TOGETHER = 20  # flights in a job


@cache
def study(variant: str) -> Study:
    model = build_model(load_description(ROOT / "urdf" / "paper_sms.toml"))
    return Study(model, VARIANTS[variant], identified=identified(ReducedDynamics(model)))


def fly(variant: str, case: str, controller: str, draws: list[int]) -> list[Run]:
    chosen = next(c for c in cases() if c.name == case)
    return study(variant).fly_many(chosen, controller, draws)


def measure_speed(draws: int) -> None:
    """Fly ``draws`` of case D both ways in one run, compiled and plain, and write seconds and their ratio."""
    chosen = next(c for c in cases() if c.name == "D")
    seconds: dict[str, dict[str, float]] = {}
    for way, switch in (("compiled", "1"), ("plain", "0")):
        os.environ[SWITCH] = switch
        study(MAIN.name).fly_many(chosen, "hinf", [0])  # what is compiled or read from the disk once
        wall, cpu = time.perf_counter(), time.process_time()
        study(MAIN.name).fly_many(chosen, "hinf", list(range(draws)))
        seconds[way] = {"wall": time.perf_counter() - wall, "cpu": time.process_time() - cpu}
    result = {
        "environment": environment("pin", "numpy", "scipy", "numba"),
        "what": "case D under the H-infinity controller, draws side by side in threads, seconds for all",
        "draws": draws,
        "seconds": seconds,
        "plain over compiled": {k: seconds["plain"][k] / seconds["compiled"][k] for k in ("wall", "cpu")},
    }
    print(result, write_result("table4_speed", result))


def known() -> list[Run]:
    if not LINES.is_file():
        return []
    return [Run(**json.loads(line)) for line in LINES.read_text(encoding="utf-8").splitlines() if line]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=100, help="of main, no noise and integrated gyro")
    parser.add_argument("--other-draws", type=int, default=20, help="of every other variant")
    parser.add_argument("--minutes", type=float, default=30.0, help="stop starting flights after this long")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--summary-only", action="store_true")
    parser.add_argument("--speed", type=int, metavar="DRAWS", help="only time so many, compiled and plain")
    parser.add_argument(
        "--variant",
        action="append",
        choices=list(VARIANTS),
        help="fly this one; what stands in table4.json of the others stays (again for more)",
    )
    options = parser.parse_args()
    if options.speed:
        measure_speed(options.speed)
        return
    LINES.parent.mkdir(exist_ok=True)
    if not options.summary_only:
        model = build_model(load_description(ROOT / "urdf" / "paper_sms.toml"))
        exact = ReducedDynamics(model)
        identify_up_to(IDENTIFIED, exact, model.joint_angles(model.home), options.minutes)
    done = {(r.variant, r.case, r.controller, r.draw) for r in known()}
    draws = {v: options.draws if v in (MAIN.name, QUIET, GYRO) else options.other_draws for v in VARIANTS}
    in_print = [c for c in cases() if c.paper]

    def flights(variants: Sequence[str], wanted: Sequence[Table4Row], begin: int) -> list[tuple]:
        found = []
        for v, c, k in itertools.product(variants, wanted, CONTROLLERS):
            left = [d for d in range(begin, min(begin + TOGETHER, draws[v])) if (v, c.name, k, d) not in done]
            if left:
                found.append((v, c.name, k, left))
        return found

    asked = options.variant or list(VARIANTS)
    jobs = []
    for begin in range(0, draws[MAIN.name], TOGETHER):
        jobs += flights([MAIN.name], cases(), begin)
    jobs += flights(list(VARIANTS), in_print, 0)
    for many in (QUIET, GYRO):
        for begin in range(0, draws[many], TOGETHER):
            jobs += flights([many], in_print, begin)
    jobs = [job for job in jobs if job[0] in asked]
    jobs = list({(v, c, k, d[0]): (v, c, k, d) for v, c, k, d in jobs}.values())
    jobs = [] if options.summary_only else jobs
    begin = time.monotonic()
    with ProcessPoolExecutor(options.workers) as pool, LINES.open("a", encoding="utf-8") as file:
        for at in range(0, len(jobs), options.workers):
            if time.monotonic() - begin > 60.0 * options.minutes:
                break
            for job in as_completed([pool.submit(fly, *w) for w in jobs[at : at + options.workers]]):
                file.writelines(json.dumps(asdict(run)) + "\n" for run in job.result())
                file.flush()
            done_jobs = min(at + options.workers, len(jobs))
            print(f"{done_jobs}/{len(jobs)} jobs, {time.monotonic() - begin:.0f} s", flush=True)
    runs, before = known(), {}
    if (RESULTS / "table4.json").is_file():
        before = json.loads((RESULTS / "table4.json").read_text(encoding="utf-8"))["variants"]
    of = {c.name: c for c in cases()}
    for row in (row for variant in before.values() for row in variant["rows"]):
        row |= printed_errors(of[row["case"]], row["controller"])
    result = {
        "environment": environment("pin", "numpy", "scipy"),
        "identified_models": {
            "count": len(stored()),
            "error_of_H": spread(np.array([x["error_of_H"] for x in stored()])),
            "level_from_intervals": spread(np.array([x["level"] for x in stored()])),
        },
        "settings": {name: vars(v) for name, v in VARIANTS.items()},
        "variants": {
            name: {
                "rows": summarise(chosen, cases()),
                "orderings": orderings(chosen),
                "improvements": improvements(chosen),
            }
            if (chosen := [r for r in runs if r.variant == name])
            else before[name]
            for name in VARIANTS
            if name in before or any(r.variant == name for r in runs)
        },
    }
    print(write_result("table4", result))
    atomic_write(RESULTS / "table4.md", markdown(result))


if __name__ == "__main__":
    main()
