"""Two arms, two tanks, two panels: do the intervals hold? ``python benchmarks/two_arms.py --draws 30``.

`urdf/two_arm_sms.toml` flies both experiments of the paper once in smsid's own simulation, and the described
sensors' noise is drawn again and again: what `smsid identify --method paper` prints is held against the
described values, and how many of the 95 % intervals hold them against the binomial band. That shows what the
sensors tell and how honest the intervals are, nothing of the model. Resumable, a draw is a line of
``build/two_arms.jsonl``.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from pathlib import Path
from typing import Any

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import numpy as np  # noqa: E402
from _common import ROOT, environment, write_result  # noqa: E402
from paper_coverage import coverage  # noqa: E402

from smsid.description import load_description  # noqa: E402
from smsid.errors import SmsidError  # noqa: E402
from smsid.experiments import fly, fourier_experiment, thrust_experiment  # noqa: E402
from smsid.identify.paper.pipeline import identify  # noqa: E402
from smsid.model import build_model  # noqa: E402
from smsid.recording import Recording  # noqa: E402
from smsid.sensing import Sensor, add_noise  # noqa: E402

STORE = ROOT / "build" / "two_arms.jsonl"
AXES = "xyz"


def flights() -> tuple[Any, list[Recording]]:
    """Return the description and noise-free recordings of Exp. 1 along each axis and of Exp. 2."""
    description = load_description(ROOT / "urdf" / "two_arm_sms.toml")
    exact = [
        Sensor(name=s.name, kind=s.kind, rate=100.0, position=s.position, appendage=s.appendage)
        for s in description.sensor
    ]
    model = build_model(description.with_sensors(*exact))
    rng = np.random.default_rng(7)
    experiments = [thrust_experiment(AXES), fourier_experiment(model, rng, candidates=1).experiment]
    return description, [fly(model, e, rng).recording for e in experiments]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=30)
    parser.add_argument("--exp1", action="store_true", help="Exp. 1 alone, which is quick")
    parser.add_argument("--minutes", type=float, default=30.0, help="stop starting draws after this long")
    parser.add_argument("--store", type=Path, default=STORE)
    options = parser.parse_args()
    description, exact = flights()
    exact = exact[:1] if options.exp1 else exact
    begin = time.monotonic()
    options.store.parent.mkdir(parents=True, exist_ok=True)
    read = options.store.read_text(encoding="utf-8").splitlines() if options.store.is_file() else []
    lines = [line for line in map(json.loads, read) if line["flights"] == len(exact)]
    true: dict[str, float] = {}
    with options.store.open("a", encoding="utf-8") as file:
        for seed in range(options.draws):
            if seed in {line["seed"] for line in lines} or time.monotonic() - begin > 60.0 * options.minutes:
                continue
            rng = np.random.default_rng(seed)
            line: dict[str, Any] = {"seed": seed, "flights": len(exact)}
            try:
                found = identify(description, [add_noise(r, description.sensor, rng) for r in exact])
            except SmsidError as error:
                line["failed"] = str(error)
            else:
                own = [p for p in found.estimate.parameters if p.nominal is not None]
                own = [p for p in own if np.isfinite(p.sigma)]
                line["values"] = {f"{p.group}|{p.name}": (p.value, p.sigma) for p in own}
                line["true"] = {f"{p.group}|{p.name}": p.nominal for p in own}
                line["identifiable"] = [f"{p.group}|{p.name}" for p in own if p.status == "identifiable"]
            lines.append(line)
            file.write(json.dumps(line) + "\n")
            file.flush()
    good = [line for line in lines if "values" in line]
    for line in good:
        true |= line["true"]
    table = coverage(good, true)
    groups = {}
    for group in sorted({k.split("|")[0] for k in table}):
        own = [row for key, row in table.items() if key.split("|")[0] == group]
        sure = [
            abs(line["values"][k][0] - true[k]) <= 1.959964 * line["values"][k][1]
            for line in good
            for k in line["identifiable"]
            if k.split("|")[0] == group
        ]
        groups[group] = {
            "parameters": len(own),
            "coverage": round(sum(r["hold"] for r in own) / sum(r["draws"] for r in own), 4),
            "coverage_of_identifiable": round(float(np.mean(sure)), 4) if sure else None,
            "too_narrow": sum(r["verdict"] == "too narrow" for r in own),
        }
    result = {
        "environment": environment("pin", "numpy", "scipy"),
        "draws": len(good),
        "failed": [line["failed"] for line in lines if "failed" in line],
        "groups": groups,
        "parameters": table,
    }
    print(write_result("two_arms_exp1" if options.exp1 else "two_arms", result))
    print(json.dumps(groups, indent=1))
    for key, row in table.items():
        if row["verdict"] != "holds" or key.startswith("exp1"):
            told = f"{row['hold']} of {row['draws']}, z {row['mean_z']} +- {row['spread_z']}"
            print(f"{row['verdict']}: {key}: {told}, identifiable {row['identifiable']}")


if __name__ == "__main__":
    main()
