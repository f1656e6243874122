"""Maximum likelihood against the Cramer-Rao bound, on recordings of the MuJoCo twin, seed by seed.

    python benchmarks/likelihood.py 20                    # seeds 0..19 of every case
    python benchmarks/likelihood.py 20 --case exp1 --first 20

Noise of preset `reference`, biases drawn per recording (1e-4 m/s2, 1e-5 rad/s). The description handed in is
wrong by 5 % in every mass, inertia and property (30 % in the cases named so). Runs already in
results/likelihood.json are not repeated; each is written as soon as it is there.
"""

from __future__ import annotations

import argparse
import fcntl
import json
import sys
import tempfile
import time
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
from _common import RESULTS, ROOT, environment, write_result

sys.path.insert(0, str(ROOT / "tests"))

from likelihood import twin

from smsid.description.schema import Description
from smsid.effects.appendage import BeamAppendage
from smsid.effects.slosh import Slosh
from smsid.errors import SmsidError
from smsid.identify.pipeline import identify
from smsid.likelihood import fisher_information, refine
from smsid.recording import Recording

NAME = "likelihood"
SENSORS = {"x, imu": ("imu",), "x, imu and pose": ("imu", "pose")}
CASES = ("joint", "exp1", "exp2", "x, imu", "x, imu and pose", "joint, 30 % off")


def recordings(case: str) -> list[Recording]:
    """The recordings of a case, without noise."""
    if case.startswith("x"):
        return [twin.exp1((1, 0, 0))]
    return {"exp1": [twin.exp1()], "exp2": [twin.exp2()]}.get(case, [twin.exp1(), twin.exp2()])


def described(case: str) -> Description:
    """The true spacecraft with the sensors of the case."""
    d = twin.description()
    names = SENSORS.get(case)
    return d if names is None else d.with_sensors(*(s for s in d.sensor if s.name in names))


def wrong(description: Description, seed: int, off: float, folder: Path) -> Description:
    """Masses with their inertias, slosh and panel properties too high or too low by ``off``, at random."""
    rng = np.random.default_rng([seed, 77])
    tree = ElementTree.parse(description.folder / description.urdf)
    for inertial in tree.getroot().iter("inertial"):
        factor = 1.0 + off * rng.choice([-1.0, 1.0])
        for tag in ("mass", "inertia"):
            node = inertial.find(tag)
            assert node is not None
            for key, text in node.attrib.items():
                node.set(key, repr(float(float(text) * factor)))
    name = f"wrong{seed}.urdf"
    tree.write(folder / name)
    effects = []
    for effect in description.effect:
        values: dict[str, Any] = {}
        if isinstance(effect, Slosh):
            values = {"mass": effect.mass * (1.0 + off * rng.choice([-1.0, 1.0]))}
            for key in ("stiffness", "damping"):
                values[key] = tuple(x * (1.0 + off * rng.choice([-1.0, 1.0])) for x in getattr(effect, key))
        elif isinstance(effect, BeamAppendage):
            for key in ("density", "youngs_modulus", "damping"):
                values[key] = getattr(effect, key) * (1.0 + off * rng.choice([-1.0, 1.0]))
        effects.append(effect.model_copy(update=values))
    return description.model_copy(update={"folder": folder, "urdf": name}).with_effects(*effects)


def run(case: str, seed: int, folder: Path) -> dict[str, Any]:
    """Refine once: values and standard deviations by name, or why it failed."""
    large = case.endswith("30 % off")
    noisy = [twin.noisy(r, seed) for r in recordings(case)]
    description = wrong(described(case), seed, 0.30 if large else 0.05, folder)
    record: dict[str, Any] = {"case": case, "seed": seed}
    begin, cpu = time.perf_counter(), time.process_time()
    try:
        start = identify(description, noisy) if large else None
        found = refine(description, noisy, start)
    except SmsidError as error:
        return {**record, "failed": f"{type(error).__name__}: {error}"}
    kept = [p for p in found.estimate.parameters if p.group != "nuisance"]
    return {
        **record,
        "values": {p.name: [p.value, p.sigma] for p in kept},
        "identifiable": [p.name for p in kept if p.status == "identifiable"],
        "cost_per_sample": found.estimate.conditions["sum of squares / samples"],
        "iterations": found.estimate.conditions["iterations"],
        "seconds": round(time.perf_counter() - begin, 1),
        "cpu_seconds": round(time.process_time() - cpu, 1),
    }


def summary(runs: list[dict[str, Any]], bound: dict[str, Any]) -> dict[str, Any]:
    """Spread over bound, bias over sigma and coverage of every identifiable parameter, and their extremes."""
    good = [r for r in runs if "values" in r]
    out: dict[str, Any] = {"runs": len(runs), "failed": len(runs) - len(good)}
    if len(good) < 3:
        return out
    table = {}
    for name, (truth, sigma) in bound.items():
        if not all(name in r["identifiable"] for r in good) and ".damping" not in name:
            continue
        if any(name not in r["values"] for r in good) or sigma > abs(truth) > 0.0:
            continue
        pairs = np.array([r["values"][name] for r in good])
        error = pairs[:, 0] - truth
        table[name] = {
            "spread / bound": float(np.std(error, ddof=1) / sigma),
            "predicted / bound": float(np.median(pairs[:, 1]) / sigma),
            "bias / bound": float(np.mean(error) / sigma),
            "coverage 95 %": float(np.mean(np.abs(error) < 1.959964 * pairs[:, 1])),
        }
    out["parameters"] = table
    spreads = np.array([x["spread / bound"] for x in table.values()])
    biases = np.array([x["bias / bound"] for x in table.values()])
    out["root mean square of spread / bound"] = float(np.sqrt(np.mean(spreads**2)))
    out["largest spread / bound"] = float(spreads.max())
    out["root mean square of bias / bound"] = float(np.sqrt(np.mean(biases**2)))
    out["largest bias / bound"] = float(np.abs(biases).max())
    out["mean coverage"] = float(np.mean([x["coverage 95 %"] for x in table.values()]))
    # what spreads and biases of this many runs would be with an estimator exactly at the bound
    out["chance: one sigma of a spread / bound"] = float(1.0 / np.sqrt(2.0 * (len(good) - 1)))
    out["chance: one sigma of a bias / bound"] = float(1.0 / np.sqrt(len(good)))
    out["median seconds"] = float(np.median([r["seconds"] for r in good]))
    out["median cpu seconds"] = float(np.median([r["cpu_seconds"] for r in good]))
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("seeds", type=int)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--case", action="append", choices=CASES)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for case in args.case or CASES[:-1]:
            if case not in load()["bounds"]:
                bound = fisher_information(described(case), recordings(case))
                table = {c.name: [c.value, bound.sigma[c.name]] for c in bound.combinations}
                update(lambda d, t=table, c=case: d["bounds"].setdefault(c, t))
            for seed in range(args.first, args.first + args.seeds):
                if any(r["case"] == case and r["seed"] == seed for r in load()["runs"]):
                    continue
                record = run(case, seed, Path(folder))
                update(lambda d, r=record: d["runs"].append(r))
                print(case, seed, record.get("failed") or f"{record['cpu_seconds']} s", flush=True)


def load() -> dict[str, Any]:
    """The results so far."""
    file = RESULTS / f"{NAME}.json"
    return json.loads(file.read_text()) if file.is_file() else {"bounds": {}, "runs": []}


def update(change: Any) -> None:
    """Change the results and write them whole, with summary and environment."""
    RESULTS.mkdir(exist_ok=True)
    with (Path(tempfile.gettempdir()) / f"smsid-{NAME}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # several processes may fill different cases at a time
        _rewrite(change)


def _rewrite(change: Any) -> None:
    document = load()
    change(document)
    cases = [c for c in CASES if c in document["bounds"]]
    head = {
        "environment": environment("pin", "mujoco", "numpy", "scipy"),
        "summary": {
            c: summary([r for r in document["runs"] if r["case"] == c], document["bounds"][c]) for c in cases
        },
    }
    write_result(NAME, {**head, "bounds": document["bounds"], "runs": document["runs"]})


if __name__ == "__main__":
    main()
