"""Welded arms by their motion and by their torques: do intervals hold where torques are not linear?

    python benchmarks/arm_motion.py [--runs 60] [--minutes 20]

MuJoCo's arm of the hidden studies with drawn bodies, and in it a delay, a clock that is off, a rate's scale,
a torque's gain or nothing, of drawn size. The description lists what it is, begun elsewhere: by motion
(``--method filter``) bodies and effect are estimated together. Equations of torques get the description
without it, as they do not take it. Errors are against the drawn truth. Rows are kept in
``build/arm_motion.jsonl`` by the commit of the sources.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from _common import ROOT, commit, environment, rows_by_seed, write_result
from _hidden_summary import interval

import smsid
from smsid.arm import identify_arm
from smsid.description import load_description
from smsid.effects import ActuatorDelay, SensorScale, TimeOffset, TorqueGain
from smsid.effects.base import Effect
from smsid.errors import SmsidError
from smsid.estimation.arm_motion import identify_arm_motion
from smsid.identify.estimate import Estimate
from smsid.identify.momentum_rows import whole_bodies
from smsid.identify.parameter_estimate import parse_combination
from smsid.model.regressor import INERTIAL_NAMES, body_names
from smsid.recording import Recording, load_recording
from tests.hidden.catalogue import hidden_effects
from tests.hidden.description import write_description
from tests.hidden.flight import write_run
from tests.hidden.numbers import JOINTS, WORLDS, draw
from tests.hidden.study import FAST

NAME = "arm_motion"
ROWS = ROOT / "build" / f"{NAME}.jsonl"
CASES = ("nothing", "delay", "clock", "scale", "gain")
LARGEST = {"delay": 0.04, "clock": 0.02, "scale": 0.2, "gain": 0.2}  # sizes are drawn from a tenth of it on
DURATION = 40.0  # [s]
OFF = 3.0  # standard deviations


def hidden_in(case: str, joint: str, value: float) -> tuple[str, Effect, str]:
    """Return what a world hides, the effect as it is listed at first, and its parameter."""
    if case == "delay":
        listed: Effect = ActuatorDelay(name="late", actuator=joint, delay=0.005)
        return f"actuator_delay:delay@{joint}", listed, "late.delay"
    if case == "clock":
        return "time_offset:offset@encoder", TimeOffset(name="clock", sensor="encoder"), "clock.offset"
    if case == "scale":
        where = {"sensor": "encoder", "quantity": "joint_velocity", "component": joint}
        listed = SensorScale(name="scale", error=0.0, **where)
        return f"sensor_scale:scale@encoder.joint_velocity[{joint}]", listed, "scale.error"
    return f"torque_gain:error@{joint}", TorqueGain(name="gain", joint=joint), "gain.error"


def deviations(estimate: Estimate, truth: dict[str, float]) -> list[float]:
    """Return by how many standard deviations identifiable combinations of bodies are off."""
    found = []
    for p in estimate.parameters:
        terms = parse_combination(p.name)
        if p.status == "identifiable" and terms and all(name in truth for name in terms):
            found.append((p.value - sum(x * truth[name] for name, x in terms.items())) / p.sigma)
    return found


def too_fast(recording: Recording) -> bool:
    """Whether the arm flies away, as torques fit it badly."""
    return float(np.abs(recording["encoder.joint_velocity"]).max()) > FAST


def run(seed: int) -> dict[str, Any]:
    """Return what is found of one arm both ways."""
    rng = np.random.default_rng([seed, 191])
    case, joint = CASES[seed % len(CASES)], str(rng.choice(JOINTS))
    value = float(LARGEST.get(case, 0.0) * 10.0 ** rng.uniform(-1.0, 0.0))
    row: dict[str, Any] = {"seed": seed, "case": case, "joint": joint, "value": value}
    with tempfile.TemporaryDirectory() as name:
        folder, draws = Path(name), [seed, 192]
        changes, effects, parameter, hidden = [], [], "", ""
        if case != "nothing":
            hidden, listed, parameter = hidden_in(case, joint, value)
            changes, effects = [hidden_effects("arm")[hidden].make(value, None, rng)], [listed]
        files = write_run("arm", folder, draws, changes, duration=DURATION)
        while too_fast(load_recording(files.recording)):  # nobody would record that
            value /= 2.0
            changes = [hidden_effects("arm")[hidden].make(value, None, rng)]
            files = write_run("arm", folder, draws, changes, duration=DURATION)
        row["value"] = value
        true = folder / "true"
        true.mkdir()
        drawn = draw(WORLDS["arm"], np.random.default_rng(draws))
        model = smsid.build_model(load_description(write_description(drawn, true)))
        names = [f"{body}.{i}" for body in body_names(model.pin) for i in INERTIAL_NAMES]
        truth = dict(zip(names, whole_bodies(model).tolist(), strict=True))
        described, recording = load_description(files.description), load_recording(files.recording)
        began = time.process_time()
        try:
            found = identify_arm_motion(described.with_effects(*effects), [recording], reason="asked for")
        except SmsidError as error:
            row["motion"] = {"error": error.message}
        else:
            own = found.estimate[parameter] if parameter else None
            row["motion"] = {
                "judgement": found.quality.judgement if found.quality else "",
                "bodies": deviations(found.estimate, truth),
                "effect": None if own is None else (own.value - value) / own.sigma,
                "seconds of CPU": round(time.process_time() - began, 2),
            }
        row["torques"] = {"bodies": deviations(identify_arm(described, recording).estimate, truth)}
    return row


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return by case what is within three standard deviations, with exact intervals (95 %)."""

    def within(values: list[float]) -> dict[str, Any]:
        hits = sum(abs(z) < OFF for z in values)
        largest = round(max(map(abs, values), default=0.0), 2)
        return {
            "hits": hits,
            "total": len(values),
            "interval": interval(hits, len(values)),
            "largest": largest,
        }

    out: dict[str, Any] = {}
    for case in (*CASES, "all"):
        own = [r for r in rows if case in ("all", r["case"])]
        told = [r["motion"] for r in own if "error" not in r["motion"]]
        bodies = [z for m in told for z in m["bodies"]]
        effects = [m["effect"] for m in told if m["effect"] is not None]
        out[case] = {
            "runs": len(own),
            "errors": len(own) - len(told),
            "explained": sum(m["judgement"] == "explained" for m in told),
            "motion: bodies": within(bodies),
            "motion: effect": within(effects),
            "torques: bodies": within([z for r in own for z in r["torques"]["bodies"]]),
        }
    seconds = [r["motion"]["seconds of CPU"] for r in rows if "error" not in r["motion"]]
    return out | {"median seconds of CPU": round(float(np.median(seconds)), 1) if seconds else None}


def main() -> None:
    """Run what is not there yet and write the summary."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=60)
    parser.add_argument("--minutes", type=float, default=20.0, help="stop after so many")
    asked = parser.parse_args()
    rows = rows_by_seed(ROWS, run, asked.runs, asked.minutes, lambda r: (r["case"], r["motion"]))
    result = {"commit": commit(ROOT), "seeds": [r["seed"] for r in rows], **summary(rows)}
    write_result(NAME, result | {"environment": environment("pin", "mujoco", "numpy", "scipy")})


if __name__ == "__main__":
    main()
