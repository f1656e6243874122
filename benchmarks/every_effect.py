"""Every kind of listed effect is estimated: MuJoCo worlds that hide one each, by `identify_flights`.

    python benchmarks/every_effect.py [draws] [case ...]

Rows are written to ``results/every_effect.json`` as they come; a row that is there is not run again.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from _common import RESULTS, environment, write_result

from smsid.errors import SmsidError
from tests.estimation.effect_cases import by_name, fly, identified

NAME = "every_effect"


def row_of(case, seed: int) -> dict:
    """Return one row: each of the effect's parameters, found and true, or why there is no estimate."""
    began = time.process_time()
    row: dict = {"case": case.name, "kind": case.kind, "world": case.world, "seed": seed}
    with tempfile.TemporaryDirectory() as folder:
        flight = fly(case, seed, Path(folder))
        try:
            found = identified(flight)
        except SmsidError as error:
            return {**row, "error": str(error)}
    estimate = found.estimate
    row["judgement"], row["widening"] = found.quality.judgement, round(found.quality.widening, 3)
    row["held"] = [n for n in estimate.notes if "is not estimated" in n]
    row["parameters"] = {}
    present = {p.name: p for p in estimate.parameters}
    for name, truth in flight.truth.items():
        p = present.get(name)
        if p is None:
            row["parameters"][name] = {"true": truth, "missing": True}
            continue
        off = (p.value - truth) / max(p.sigma, 1e-300)
        row["parameters"][name] = {
            "true": truth, "found": p.value, "sigma": p.sigma, "off": round(off, 3), "status": p.status,
            "inside": bool(p.interval[0] <= truth <= p.interval[1]),
        }  # fmt: skip
    row["seconds"] = round(time.process_time() - began, 1)
    return row


def summary(rows: list[dict]) -> dict:
    """Return coverage, pooled and by case, and what is missing."""
    off: dict[str, list[float]] = {}
    inside: list[bool] = []
    for row in rows:
        for p in row.get("parameters", {}).values():
            if "off" in p:
                off.setdefault(row["case"], []).append(p["off"])
                inside.append(p["inside"])
    return {
        "runs": len(rows),
        "errors": sum("error" in r for r in rows),
        "parameters": len(inside),
        "coverage": round(float(np.mean(inside)), 4) if inside else None,
        "missing": sorted({n for r in rows for n, p in r.get("parameters", {}).items() if "missing" in p}),
        "root_mean_square": {k: round(float(np.sqrt(np.mean(np.square(v)))), 2) for k, v in off.items()},
    }


def main() -> None:
    """Run what is not there yet."""
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    chosen, path = sys.argv[2:], RESULTS / f"{NAME}.json"
    rows = json.loads(path.read_text(encoding="utf-8"))["rows"] if path.is_file() else []
    there = {(r["case"], r["seed"]) for r in rows}
    known = by_name()
    for seed in range(draws):
        for name in chosen or known:
            if (name, seed) in there:
                continue
            row = row_of(known[name], seed)
            print(json.dumps(row), flush=True)
            rows.append(row)
            write_result(
                NAME, {"environment": environment("smsid", "mujoco"), "summary": summary(rows), "rows": rows}
            )
    print(json.dumps(summary(rows), indent=1))


if __name__ == "__main__":
    main()
