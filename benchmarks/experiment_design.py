"""Designed experiments: predicted against achieved on recordings of the MuJoCo twin.

    python benchmarks/experiment_design.py design          # designs, kept in build/design
    python benchmarks/experiment_design.py fly             # estimates, seed by seed, of what is designed
    python benchmarks/experiment_design.py write           # only write the results anew

1. The shortest thrust that gives b_s to 10 % with the slosh stroke below 0.5 m, all sensors; along x for b_s
   along x, and along all axes for b_s along all three. Beside it the bang-bang (48) as strong as that stroke
   allows: how long it takes.
2. Exp. 2 designed for the inertial parameters, the worst relative standard deviation as criterion, against
   the paper-style random Fourier series that `smsid simulate DESC exp2` flies, and against a random series
   that uses the limits as the design does (the first draw of the search).

Flown by MuJoCo (the torques that a prescribed joint motion takes are computed by smsid and given to it open
loop), noise of preset `reference`, biases drawn per recording, estimates by `smsid.likelihood.refine` from a
description wrong by 5 %; fits start from the refinement of one more noise draw. Interrupted, it goes on.
"""

from __future__ import annotations

import argparse
import json
import pickle
import tempfile
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from _common import environment, write_result
from _likelihood_cases import BUILD, twin, wrong
from scipy.interpolate import CubicSpline
from scipy.stats import chi2
from twins.mujoco_twin import Drive, MujocoTwin
from twins.recordings import Q0_ARM
from twins.state import State

from smsid._files import atomic_write
from smsid.design import Design, Limits, design_experiment
from smsid.design._forecast import exact_information
from smsid.design._goal import goal_of
from smsid.errors import SmsidError
from smsid.experiments import Experiment, named_experiment, thrust_experiment
from smsid.likelihood import Refinement, fisher_information, refine
from smsid.likelihood.parameters import Parameters
from smsid.recording import Recording
from smsid.simulate import Tolerance, simulate

FOLDER = BUILD / "design"
RUNS = FOLDER / "runs.jsonl"
NAME = "experiment_design"
START = 1_000_000
STROKE, PRECISION, SEED = 0.5, 0.1, 0
FLOWN = {"b_s x": 40, "exp2 designed": 20, "exp2": 20, "exp2 random": 20, "b_s xyz": 40}


def file_of(name: str) -> Path:
    """Where something is kept."""
    return FOLDER / f"{name.replace(' ', '_')}.json"


def kept(name: str, made: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """What was made once: its ``document``, and the ``cpu seconds`` it took."""
    file = file_of(name)
    if not file.is_file():
        begin = time.process_time()
        document = made()
        whole = {"document": document, "cpu seconds": round(time.process_time() - begin, 1)}
        atomic_write(file, json.dumps(whole))
    return json.loads(file.read_text())


def designed(found: Design) -> dict[str, Any]:
    """A design with its reference and scales, as JSON."""
    reference = found.reference.model_dump(mode="json", by_alias=True, exclude_none=True)
    return {**found.document(), "reference": reference, "scales": found.goal.scales.tolist()}


def thrust_design(axis: str) -> dict[str, Any]:
    """The shortest experiment for b_s along x, or along all axes."""
    wanted = ["tank.damping.x"] if axis == "x" else ["b_s"]
    limits = Limits(stroke=STROKE)
    return designed(design_experiment(twin.description(), wanted, limits=limits, to=PRECISION, seed=SEED))


def motion_design() -> dict[str, Any]:
    """Exp. 2 for the inertial parameters."""
    return designed(design_experiment(twin.description(), ["inertia"], duration=80.0, seed=SEED))


def bang_bang(duration: float) -> dict[str, float]:
    """The paper's thrust along x of the full stroke: its size and what it tells of b_s."""
    unit = thrust_experiment("x", force=1.0, duration=duration)
    motion = simulate(twin.model(), unit.inputs(), duration, q0=unit.start(twin.model()))
    tank = twin.model().slosh[0]
    stroke = np.abs(motion.states(np.linspace(0.0, duration, 4000)).q[:, tank.q]).max()
    force = STROKE / float(stroke)
    flown = thrust_experiment("x", force=force, duration=duration)
    at = Parameters.of(twin.model())
    goal = goal_of(at, ["tank.damping.x"], "worst", None)
    relative = goal.relative_of(exact_information(twin.description(), flown))
    return {"duration": duration, "force": force, "relative": float(relative[0])}


def bang_bangs() -> dict[str, Any]:
    """Bang-bang: what it tells in some durations, and by interpolation when it reaches the precision."""
    rows = [bang_bang(t) for t in (105.0, 180.0, 200.0, 220.0, 240.0)]
    logs = np.log([r["relative"] for r in rows])
    needed = np.interp(-np.log(PRECISION), -logs, [r["duration"] for r in rows])
    return {"rows": rows, "seconds needed": float(needed)}


def paper_style() -> dict[str, Any]:
    """The random Fourier series of `smsid simulate DESC exp2`."""
    found = named_experiment("exp2", twin.model())
    return {"experiment": found.model_dump(mode="json", by_alias=True, exclude_none=True)}


MAKERS: dict[str, Callable[[], dict[str, Any]]] = {
    "b_s x": lambda: thrust_design("x"),
    "exp2 designed": motion_design,
    "exp2": paper_style,
    "b_s xyz": lambda: thrust_design("xyz"),
    "bang-bang": bang_bangs,
}


def made(name: str) -> dict[str, Any]:
    """What was designed or compared with, made once."""
    return kept(name, MAKERS[name])


def experiment_of(name: str) -> Experiment:
    """What is flown under a name."""
    if name == "exp2 random":
        return Experiment.model_validate(made("exp2 designed")["document"]["reference"])
    return Experiment.model_validate(made(name)["document"]["experiment"])


@cache
def clean(name: str) -> tuple[Recording, float]:
    """The twin's recording without noise, and the largest stroke of its slosh mass [m]."""
    file = FOLDER / f"{name.replace(' ', '_')}.pickle"
    if not file.is_file():
        atomic_write(file, pickle.dumps(flown_by_mujoco(experiment_of(name), name)))
    return pickle.loads(file.read_bytes())


def flown_by_mujoco(experiment: Experiment, name: str) -> tuple[Recording, float]:
    """Fly an experiment in MuJoCo."""
    inputs = experiment.inputs()
    start = State(q=Q0_ARM.copy())
    if inputs.force is not None:
        drive = Drive(force_body=inputs.force)
        data = MujocoTwin().simulate(drive, experiment.duration, initial=start, hold=True, dt=1e-2)
    else:
        model = twin.model()
        motion = simulate(
            model,
            inputs,
            experiment.duration,
            q0=experiment.start(model),
            tolerance=Tolerance(1e-10, 1e-12),
        )
        times = np.linspace(0.0, experiment.duration, int(100 * experiment.duration) + 1)
        states = motion.states(times)
        torque = CubicSpline(times, (states.tau + states.reaction)[:, model.arm_joints.v])
        start.qd[:] = states.v[0, model.arm_joints.v]
        assert inputs.wheel_torque is not None
        drive = Drive(wheel_torque=inputs.wheel_torque, joint_torque=torque)
        data = MujocoTwin().simulate(drive, experiment.duration, initial=start, dt=5e-3)
    stroke = float(np.linalg.norm(data["truth_slosh"], axis=1).max())
    return twin.recording(data, name), stroke


@cache
def started(name: str) -> Refinement:
    """The refinement of one more noise draw, from the true description."""
    return refine(twin.description(), [twin.noisy(clean(name)[0], START)])


def run(name: str, seed: int, folder: Path) -> dict[str, Any]:
    """One estimate: values and standard deviations by name."""
    record: dict[str, Any] = {"experiment": name, "seed": seed}
    begin = time.process_time()
    try:
        description = wrong(twin.description(), seed, 0.05, folder)
        found = refine(description, [twin.noisy(clean(name)[0], seed)], started(name)).estimate
    except SmsidError as error:
        return {**record, "failed": f"{type(error).__name__}: {error}"}
    kept_ = [p for p in found.parameters if p.group != "nuisance" and np.isfinite(p.sigma)]
    values = {p.name: [p.value, p.sigma, *p.interval] for p in kept_}
    return {**record, "values": values, "cpu seconds": round(time.process_time() - begin, 2)}


def runs() -> list[dict[str, Any]]:
    """The runs so far."""
    return [json.loads(line) for line in RUNS.read_text().splitlines()] if RUNS.is_file() else []


def bound(name: str) -> dict[str, list[float]]:
    """Truth, bound and scale of every parameter, of the recording the twin made."""

    def made() -> dict[str, Any]:
        found = fisher_information(twin.description(), clean(name)[0])
        rows = zip(found.combinations, found.prior_share, strict=True)
        return {c.name: [c.value, found.sigma[c.name], float(share)] for c, share in rows}

    return kept(f"bound {name}", made)["document"]


def spread_of(name: str, wanted: list[str]) -> dict[str, Any]:
    """Spread of some parameters over the runs, beside the bound."""
    good = [r for r in runs() if r["experiment"] == name and "values" in r]
    out: dict[str, Any] = {
        "runs": len(good),
        "failed": [r["failed"] for r in runs() if r["experiment"] == name and "failed" in r],
        "stroke on the twin": clean(name)[1],
    }
    parameters = {}
    for key in wanted:
        truth, sigma, share = bound(name)[key]
        row: dict[str, float] = {"truth": truth, "bound": sigma, "prior share": share}
        if len(good) > 2:
            values = np.array([r["values"][key] for r in good])
            low, high = np.sqrt(chi2.ppf([0.025, 0.975], len(good) - 1) / (len(good) - 1))
            row |= {
                "spread": float(values[:, 0].std(ddof=1)),
                "spread / bound": float(values[:, 0].std(ddof=1) / sigma),
                "95 % band of spread / bound low": float(low),
                "95 % band of spread / bound high": float(high),
                "bias / bound": float((values[:, 0].mean() - truth) / sigma),
                "coverage 95 %": float(np.mean((values[:, 2] <= truth) & (truth <= values[:, 3]))),
            }
        parameters[key] = row
    return {**out, "parameters": parameters}


def improvement(goal: dict[str, Any], by: str) -> dict[str, Any]:
    """How much better the designed Exp. 2 is than another, predicted and achieved."""
    scales = dict(zip([p["name"] for p in goal["parameters"]], goal["scales"], strict=True))
    new, old = (spread_of(n, list(scales))["parameters"] for n in ("exp2 designed", by))
    out: dict[str, Any] = {}
    for key, label in (("bound", "predicted"), ("spread", "achieved")):
        if any(key not in row for row in (*new.values(), *old.values())):
            continue
        after, before = ({n: rows[n][key] / scales[n] for n in scales} for rows in (new, old))
        worst = max(before, key=lambda n: before[n])
        ratios = [before[n] / after[n] for n in scales]
        out[label] = {
            "worst parameter before": worst,
            "its relative sigma before": before[worst],
            "its relative sigma after": after[worst],
            "worst parameter after": max(after, key=lambda n: after[n]),
            "relative sigma of the worst after": max(after.values()),
            "worst before / worst after": before[worst] / max(after.values()),
            "median of the ratios of all parameters": float(np.median(ratios)),
            "least ratio of a parameter": float(min(ratios)),
        }
    return out


def write() -> None:
    """Write the results of all that was made so far."""
    there = {n for n in MAKERS if file_of(n).is_file()}
    thrusts: dict[str, Any] = {}
    for name in sorted(there & {"b_s x", "b_s xyz"}):
        whole = made(name)
        document = whole["document"]
        thrusts[name] = {
            "seconds needed": document["experiment"]["duration"],
            "predicted relative sigma": document["relative"],
            "limits": document["limits"],
            "notes": document["notes"],
            "experiments tried": document["evaluations"],
            "cpu seconds": whole["cpu seconds"],
            "on the twin": spread_of(name, [p["name"] for p in document["parameters"]]),
            "experiment": document["experiment"],
        }
    if "bang-bang" in there:
        thrusts["bang-bang (48) of full stroke"] = made("bang-bang")["document"]
    result: dict[str, Any] = {
        "environment": environment("pin", "mujoco", "numpy", "scipy"),
        "how": __doc__,
        "seed": SEED,
        "b_s to 10 %, stroke below 0.5 m": thrusts,
    }
    if {"exp2 designed", "exp2"} <= there:
        whole = made("exp2 designed")
        goal = whole["document"]
        wanted = [p["name"] for p in goal["parameters"]]
        result["Exp. 2 for inertia"] = {
            "cpu seconds of the design": whole["cpu seconds"],
            "experiments tried": goal["evaluations"],
            "limits": goal["limits"],
            "notes": goal["notes"],
            "against exp2": improvement(goal, "exp2"),
            "against a random series within the same limits": improvement(goal, "exp2 random"),
            "on the twin": {n: spread_of(n, wanted) for n in ("exp2 designed", "exp2 random", "exp2")},
        }
    write_result(NAME, result)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("what", choices=("design", "fly", "write"))
    parser.add_argument("seeds", type=int, nargs="?", default=40)
    parser.add_argument("--case", action="append", choices=tuple(FLOWN))
    args = parser.parse_args()
    FOLDER.mkdir(parents=True, exist_ok=True)
    if args.what == "design":
        for name in MAKERS:
            made(name)
    if args.what == "fly":
        with tempfile.TemporaryDirectory() as name:
            for case in args.case or FLOWN:
                done = {r["seed"] for r in runs() if r["experiment"] == case}
                for seed in sorted(set(range(min(args.seeds, FLOWN[case]))) - done):
                    record = run(case, seed, Path(name))
                    with RUNS.open("a") as file:
                        file.write(json.dumps(record) + "\n")
                    print(case, seed, record.get("failed") or record["cpu seconds"], flush=True)
    write()


if __name__ == "__main__":
    main()
