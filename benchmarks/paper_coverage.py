"""Do the intervals of ``--method paper`` hold? ``python benchmarks/paper_coverage.py``, SMSID_ORACLE set.

MuJoCo's noise-free flights of Exp. 1 and Exp. 2 get the noise of the ``reference`` sensors drawn a hundred
times; everything that `smsid identify --method paper` prints with an interval is held against its true value,
and how many of the 95 % intervals hold it against the binomial band. A draw is a line of
``build/paper_coverage.jsonl``; lines of the same code and inputs are not computed again, so it can be
stopped. About 6 s of processor time a draw. ``--store`` keeps the lines elsewhere.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import numpy as np  # noqa: E402
from _accuracy_cases import Case, Data, run, truths  # noqa: E402
from _common import ROOT, environment, write_result  # noqa: E402
from scipy.linalg import eigh  # noqa: E402
from scipy.stats import binom  # noqa: E402

from smsid.description.schema import Description  # noqa: E402
from smsid.model import build_model  # noqa: E402

STORE = ROOT / "build" / "paper_coverage.jsonl"
FLIGHTS = ("exp1_xyz_modal3", "exp2_modal3")
CASE, EXACT = Case("reference", FLIGHTS), Case("noise-free", FLIGHTS, noise=False)
GROUPS = ("exp1", "modes", "exp2.step_a", "exp2.step_b", "exp2.step_b_printed")
BAND = 0.99
"""Of a parameter; of a hundred, one is outside by chance."""


def coupled_frequencies(description: Description) -> dict[str, float]:
    """Return the bending frequencies [Hz] with the attitude held, the bus free to translate."""
    import pinocchio as pin

    model = build_model(description)
    data = model.pin.createData()
    mass = pin.crba(model.pin, data, model.home)
    mass = np.triu(mass) + np.triu(mass, 1).T
    tanks = {j.name: j for j in model.slosh}
    stiffness = np.zeros(model.nv)
    for effect in description.effect:
        if effect.name in tanks:
            stiffness[tanks[effect.name].v] = effect.stiffness
    bending = []
    for panel in model.appendages:
        index = [model.pin.joints[j].idx_v for j in panel.joints]
        omega = 2.0 * np.pi * np.array([m.frequency for m in panel.appendage.modal_data()])
        stiffness[index] = omega**2 * np.diag(mass)[index]
        bending += index
    free = [0, 1, 2, *(i for j in model.slosh for i in range(*j.v.indices(model.nv))), *bending]
    values, shapes = eigh(np.diag(stiffness[free]), mass[np.ix_(free, free)])
    swing = (shapes[-len(bending) :] ** 2 * np.diag(mass)[bending][:, None]).sum(axis=0)
    chosen = sorted(np.argsort(swing)[-len(bending) :], key=lambda i: values[i])
    found = np.sqrt(values[chosen]) / (2.0 * np.pi)
    return {f"modes|panel.coupled{k + 1}.frequency": float(f) for k, f in enumerate(found)}


def coverage(lines: Sequence[Mapping[str, Any]], true: Mapping[str, float]) -> dict[str, dict[str, Any]]:
    """Return by parameter: draws, intervals that hold the true value, band, mean and spread of z, status."""
    out = {}
    for key, value in true.items():
        pairs = [(line, line["values"][key]) for line in lines if key in line["values"]]
        pairs = [(line, p) for line, p in pairs if None not in p and p[1] > 0.0]
        if not pairs:
            continue
        z = np.array([(p[0] - value) / p[1] for _, p in pairs])
        low, high = binom.interval(BAND, len(z), 0.95)
        held = int((np.abs(z) <= 1.959964).sum())
        out[key] = {
            "draws": len(z),
            "hold": held,
            "band": [int(low), int(high)],
            "verdict": "too narrow" if held < low else "wider than needed" if held > high else "holds",
            "mean_z": round(float(z.mean()), 3),
            "spread_z": round(float(z.std(ddof=1)), 3) if len(z) > 1 else None,
            "largest_z": round(float(np.abs(z).max()), 2),
            "identifiable": round(float(np.mean([key in line["identifiable"] for line, _ in pairs])), 2),
        }
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=100)
    parser.add_argument("--seeds-from", type=int, default=0, help="seed of the first draw")
    parser.add_argument("--minutes", type=float, default=90.0, help="stop starting draws after this long")
    parser.add_argument("--store", type=Path, default=STORE)
    options = parser.parse_args()
    data, begin = Data(), time.monotonic()
    code = data.fingerprint()
    options.store.parent.mkdir(parents=True, exist_ok=True)
    read = options.store.read_text(encoding="utf-8").splitlines() if options.store.is_file() else []
    lines = [line for line in map(json.loads, read) if line["code"] == code]
    done = {line["seed"] for line in lines}
    with options.store.open("a", encoding="utf-8") as file, tempfile.TemporaryDirectory() as folder:
        for seed in range(options.seeds_from, options.seeds_from + options.draws):
            if seed in done or time.monotonic() - begin > 60.0 * options.minutes:
                continue
            line = run(CASE, seed, data, Path(folder))[0] | {"code": code}
            lines.append(line)
            file.write(json.dumps(line) + "\n")
            file.flush()
        exact = run(EXACT, 0, data, Path(folder))[1]
    assert exact is not None
    true = {k: t["value"] for k, t in truths(data.description, exact).items() if k.split("|")[0] in GROUPS}
    true |= coupled_frequencies(data.description)
    seeds = range(options.seeds_from, options.seeds_from + options.draws)
    lines = [line for line in lines if line["seed"] in seeds]
    good = [line for line in lines if "values" in line]
    table = coverage(good, true)
    groups = {}
    for group in GROUPS:
        own = [row for key, row in table.items() if key.split("|")[0] == group]
        held, count = sum(r["hold"] for r in own), sum(r["draws"] for r in own)
        groups[group] = {
            "parameters": len(own),
            "coverage": round(held / max(count, 1), 4),
            "too_narrow": sum(r["verdict"] == "too narrow" for r in own),
        }
    result = {
        "environment": environment("pin", "numpy", "scipy"),
        "inputs": data.sums(),
        "code": code,
        "seeds_from": options.seeds_from,
        "draws": len(good),
        "failed": [line["failed"] for line in lines if "failed" in line],
        "groups": groups,
        "parameters": table,
    }
    print(write_result("paper_coverage", result))
    for key, row in table.items():
        if row["verdict"] != "holds":
            told = f"{key}: {row['hold']} of {row['draws']}, z {row['mean_z']} +- {row['spread_z']}"
            print(f"{row['verdict']}: {told}")


if __name__ == "__main__":
    main()
