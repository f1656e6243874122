"""Frictions that a description lists with a standard deviation: errors within it, and far beyond.

    python benchmarks/listed_effects.py [--runs 40] [--minutes 20]

MuJoCo worlds of the hidden studies with Coulomb friction at two or three joints, which the description lists
with priors of 3 to 20 %. Their errors are drawn from these priors: nothing is to be found. Then the error of
one joint is made 15 standard deviations: it is to be named, at that joint, by what the friction is. Rows are
kept in ``build/listed_effects.jsonl`` by the commit of the sources.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from _common import ROOT, commit, environment, rows_by_seed, write_result
from _hidden_summary import interval

from smsid.description import load_description
from smsid.diagnose import diagnose
from smsid.effects import JointFriction
from smsid.identify.estimate import load_estimate
from smsid.recording import load_recording
from tests.hidden.catalogue import hidden_effects
from tests.hidden.plan import Run, inject
from tests.hidden.study import tamed

NAME = "listed_effects"
ROWS = ROOT / "build" / f"{NAME}.jsonl"
WORLDS = {"arm": 0.5, "rigid": 0.3, "sms": 0.2}
STRENGTHS = (10.0, 30.0, 100.0)  # of the frictions, in limits of detection
KNOWN = (0.03, 0.1, 0.2)  # standard deviation of what is listed, share of the friction
FAR = 15.0  # standard deviations


def run(seed: int) -> dict[str, Any]:
    """Return what is said of one world, with errors of its priors and with one far beyond."""
    rng = np.random.default_rng([seed, 91])
    world = str(rng.choice(list(WORLDS), p=list(WORLDS.values())))
    joints = ("joint1", "joint2", "joint3") if world == "arm" else ("joint2", "joint3")
    effects = [hidden_effects(world)[f"joint_friction:coulomb@{j}"] for j in joints]
    hidden = [inject(world, e, float(rng.choice(STRENGTHS)), rng) for e in effects]
    shares, errors = rng.choice(KNOWN, len(joints)), rng.normal(size=len(joints))
    far = int(rng.integers(len(joints)))
    with tempfile.TemporaryDirectory() as name:
        made, files = tamed(Run(seed, "pair", world, tuple(hidden)), Path(name))
        true = np.array([i.value for i in made.hidden])
        sigma = shares * true
        recording, known = load_recording(files.recording), load_estimate(files.estimate)
        row: dict[str, Any] = {"seed": seed, "world": world, "errors": errors.tolist(), "far": joints[far]}
        off = with_error(errors, far, FAR)
        for case, each in (("within", errors), ("beyond", off)):
            # of one that would be below zero, on the other side
            values = np.where(true + each * sigma > 0.0, true + each * sigma, true - each * sigma)
            listed = [
                JointFriction(name=f"rubs_{j}", joint=j, coulomb=float(x), prior={"coulomb": float(s)})
                for j, x, s in zip(joints, values, sigma, strict=True)
            ]
            given = load_description(files.description).with_effects(*listed)
            found = diagnose(given, [recording], estimate=known).diagnosis
            row[case] = {
                "verdict": found.verdict,
                "causes": [[c.effect, c.location] for c in found.causes],
                "deviation": deviation(found.causes, joints[far], float(true[far])),
            }
    return row


def with_error(values: np.ndarray, place: int, value: float) -> np.ndarray:
    """Return values (n,) with one of them another."""
    out = values.copy()
    out[place] = value
    return out


def deviation(causes: Any, joint: str, true: float) -> float | None:
    """Return how many standard deviations a joint's Coulomb friction, as named, is off; none if it is not."""
    for c in causes:
        for p in c.parameters:
            if c.location == joint and p.name == f"rubs_{joint}.coulomb":
                return abs(p.value - true) / p.sigma
    return None


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return counts with exact intervals (95 %)."""

    def of(hits: list[bool]) -> dict[str, Any]:
        return {"hits": sum(hits), "total": len(hits), "interval": interval(sum(hits), len(hits))}

    named = [r["beyond"] for r in rows]
    told = [n["deviation"] for n in named if n["deviation"] is not None]
    return {
        "adequate within": of([r["within"]["verdict"] == "adequate" for r in rows]),
        "named beyond": of([["joint_friction", r["far"]] in r["beyond"]["causes"] for r in rows]),
        "value within 3 sigma": of([d < 3.0 for d in told]),
    }


def main() -> None:
    """Run what is not there yet and write the summary."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--minutes", type=float, default=20.0, help="stop after so many")
    asked = parser.parse_args()
    rows = rows_by_seed(
        ROWS, run, asked.runs, asked.minutes, lambda r: (r["within"]["verdict"], r["beyond"]["causes"])
    )
    result = {"commit": commit(ROOT), "seeds": [r["seed"] for r in rows], **summary(rows), "rows": rows}
    write_result(NAME, result | {"environment": environment("pin", "mujoco", "numpy", "scipy")})


if __name__ == "__main__":
    main()
