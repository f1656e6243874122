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
import pickle
import sys
import tempfile
import time
import xml.etree.ElementTree as ElementTree
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from _common import ROOT, environment, write_result
from _likelihood_summary import markdown, summary

sys.path.insert(0, str(ROOT / "tests"))

from likelihood import twin

from smsid._files import atomic_write
from smsid.description.schema import Description
from smsid.effects.appendage import BeamAppendage
from smsid.effects.slosh import Slosh
from smsid.errors import SmsidError
from smsid.identify.pipeline import identify
from smsid.likelihood import Refinement, fisher_information, refine
from smsid.likelihood.pseudo_inertia import is_body
from smsid.recording import Recording

NAME = "likelihood"
BUILD = ROOT / "build"
RUNS = BUILD / f"{NAME}.jsonl"
SENSORS = {"x, imu": ("imu",), "x, imu and pose": ("imu", "pose")}
CASES = ("joint", "exp1", "exp2", "x, imu", "x, imu and pose")
LINEAR = ("joint",)
START = 1_000_000  # noise draw of the refinement that the others start from


@cache
def clean(name: str) -> Recording:
    """A recording without noise, simulated once."""
    file = BUILD / f"twin_{name}.pickle"
    if not file.is_file():
        made = {"exp1": twin.exp1, "exp2": twin.exp2, "x": lambda: twin.exp1((1, 0, 0))}[name]()
        atomic_write(file, pickle.dumps(made))
    return pickle.loads(file.read_bytes())


def recordings(case: str) -> list[Recording]:
    """The recordings of a case, without noise."""
    if case.startswith("x"):
        return [clean("x")]
    return [clean(name) for name in ("exp1", "exp2") if case in ("joint", name)]


@cache
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
    kept = [p for p in estimate.parameters if p.group != "nuisance"]
    return {
        **record,
        "values": {p.name: [p.value, p.sigma, *p.interval] for p in kept if np.isfinite(p.sigma)},
        "identifiable": [p.name for p in kept if p.status == "identifiable"],
        "seconds": round(time.perf_counter() - begin, 2),
        "cpu_seconds": round(time.process_time() - cpu, 2),
    }


def bounds(case: str) -> dict[str, Any]:
    """Truth, bound, and the prior's share of every parameter of a case."""
    file = BUILD / f"bound_{case.replace(', ', '_').replace(' ', '_')}.json"
    if not file.is_file():
        bound = fisher_information(described(case), recordings(case))
        rows = zip(bound.combinations, bound.prior_share, strict=True)
        table = {c.name: [c.value, bound.sigma[c.name], float(share)] for c, share in rows}
        atomic_write(file, json.dumps(table))
    return json.loads(file.read_text())


def runs() -> list[dict[str, Any]]:
    """The runs so far."""
    return [json.loads(line) for line in RUNS.read_text().splitlines()] if RUNS.is_file() else []


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
    """Write the summary of all runs so far."""
    found = runs()
    cases = [c for c in CASES if any(r["case"] == c for r in found)]
    table = {c: summary([r for r in found if r["case"] == c], bounds(c)) for c in cases}
    document = {"environment": environment("pin", "mujoco", "numpy", "scipy"), "cases": table}
    write_result(NAME, document)
    atomic_write(ROOT / "benchmarks" / "results" / f"{NAME}.md", markdown(document))


if __name__ == "__main__":
    main()
