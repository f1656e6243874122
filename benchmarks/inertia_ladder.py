"""The inertia of a rigid satellite from gyro and wheels reaches the Cramer-Rao bound, rung by rung.

    python benchmarks/inertia_ladder.py [draws] [profile ...]

A satellite by Euler's equations alone (`_rigid_satellite`): 60 s at 10 Hz, gyro 1e-4 rad/s. *torque*: the
torque on the body is recorded (rungs 1 to 3); *wheels*: wheels give it and saturate, their speeds are
measured (rung 4); *disturbed*: a constant torque besides, unknown (rung 5); *designed*: phases, frequencies
and shares chosen by the bound (rung 6). Errors are norms over the norm of the six elements. Rows are written
as they come; a row that is there is not run again.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from _common import RESULTS, environment, write_result
from _rigid_satellite import (
    DISTURBANCE,
    ELEMENTS,
    GYRO,
    INERTIA,
    RATE,
    TIMES,
    Motion,
    covariance_bound,
    elements,
    move,
    profiles,
    scaled,
)
from scipy.optimize import minimize

from smsid._statistics import NORMAL95
from smsid.description.schema import Description
from smsid.effects import ExternalWrench
from smsid.errors import SmsidError
from smsid.estimation.identify_flights import identify_flights
from smsid.recording import Recording
from smsid.sensing import Sensor

NAME = "inertia_ladder"
RUNGS = ("torque", "wheels", "disturbed")
WHEEL = 1e-3  # [kg m^2]
TACHOMETER = 0.01  # [rad/s]: a hundredth of what the gyro's noise is in momentum
OFF = 0.85  # the first guess: share of the truth
TOLD = 0.5  # relative error from which a profile is useless
NORM = float(np.linalg.norm(elements(INERTIA)))
URDF = """<robot name="rigid"><link name="bus"><inertial><mass value="100"/>
<inertia ixx="{0}" iyy="{1}" izz="{2}" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""


def bound(rung: str, torque: np.ndarray) -> np.ndarray:
    """Return the Cramer-Rao bound (6, 6) of the elements [kg^2 m^4]."""
    wheels = rung != "torque"

    def rates(inertia: np.ndarray, start: np.ndarray, external: np.ndarray) -> np.ndarray:
        return move(torque, inertia, wheels=wheels, external=external, start=start).rate

    return covariance_bound(rates, disturbed=rung == "disturbed")


def flown(rung: str, torque: np.ndarray) -> Motion:
    """Return the true motion."""
    external = DISTURBANCE if rung == "disturbed" else None
    return move(torque, wheels=rung != "torque", external=external)


def described(folder: Path, rung: str) -> Description:
    """Return the first guess: diagonal, `OFF` of the truth."""
    (folder / "rigid.urdf").write_text(URDF.format(*(OFF * np.diag(INERTIA))), encoding="utf-8")
    quiet = {"noise_sigma": GYRO, "bias_sigma": 1e-9}
    rate = {"rate": RATE}
    gyro = {"kind": "imu", "quantities": ("angular_rate",), "errors": {"angular_rate": quiet}, **rate}
    sensors = [Sensor(name="gyro", **gyro)]
    axes = np.eye(3)
    wheels = [{"name": f"rw{i}", "axis": tuple(axes[i]), "inertia": WHEEL} for i in range(3)]
    if rung == "torque":
        wheels = []
    else:
        tacho = {"wheel_rate": {"noise_sigma": TACHOMETER}}
        sensors.append(Sensor(name="tacho", kind="tachometer", errors=tacho, **rate))
    effects = []
    if rung == "disturbed":
        prior = {f"torque.{a}": 0.05 for a in "xyz"}
        effects.append(ExternalWrench(name="push", known=("force",), prior=prior))
    return Description.model_validate(
        {
            "schema": 1, "name": "rigid", "urdf": "rigid.urdf", "folder": folder, "wheel": wheels,
            "effect": effects, "sensor": tuple(sensors), "thrust": {"point": (0.0, 0.0, 0.0)},
        }
    )  # fmt: skip


def recorded(rung: str, torque: np.ndarray, motion: Motion, rng: np.random.Generator) -> Recording:
    """Return what gyro and tachometers read."""
    channels = {"gyro.angular_rate": motion.rate + GYRO * rng.standard_normal(motion.rate.shape)}
    labels = {}
    if rung == "torque":
        channels["command.torque"] = torque
    else:
        rate = motion.wheels / WHEEL
        channels["tacho.wheel_rate"] = rate + TACHOMETER * rng.standard_normal(rate.shape)
        labels = {"wheel": ("rw0", "rw1", "rw2")}
    return Recording.from_arrays(TIMES, channels, labels=labels, name=rung)


def row_of(rung: str, profile: str, torque: np.ndarray, motion: Motion, limit: np.ndarray, seed: int) -> dict:
    """Return one row: the error of the elements, what it may be, what the estimate says of itself."""
    began = time.process_time()
    row = {"rung": rung, "profile": profile, "seed": seed, "saturated": round(motion.saturated, 3)}
    row["bound"] = float(np.sqrt(np.trace(limit))) / NORM
    with tempfile.TemporaryDirectory() as folder:
        recording = recorded(rung, torque, motion, np.random.default_rng([seed, 7]))
        try:
            found = identify_flights(described(Path(folder), rung), [recording])
        except SmsidError as error:
            return {**row, "error_raised": str(error)}
    # wheels belong to the bus: what is reported is the inertia of all, as in the truth
    values = {p.name: p for p in found.estimate.parameters}
    names = [f"bus.Ic{'xyz'[i]}{'xyz'[k]}" for i, k in ELEMENTS]
    names = [n if n in values else n.replace("Ic", "I") for n in names]
    row["missing"] = [n for n in names if n not in values]
    row["not_identifiable"] = [n for n in names if n in values and values[n].status == "not_identifiable"]
    row["judgement"] = found.quality.judgement
    row["seconds"] = round(time.process_time() - began, 1)
    if row["missing"]:
        row["told"] = [p.name for p in values.values() if p.name.startswith("bus")]
        return row
    off = np.array([values[n].value for n in names]) - elements(INERTIA)
    row["error"] = float(np.linalg.norm(off)) / NORM
    row["sigma"] = float(np.linalg.norm([values[n].sigma for n in names])) / NORM
    ends = np.array([values[n].interval for n in names]) - np.array([[values[n].value] for n in names])
    half = np.where(off > 0.0, -ends[:, 0], ends[:, 1]) / NORMAL95  # on the side of the truth
    row["off"] = [round(float(x), 2) for x in off / half]
    whitened = np.linalg.solve(np.linalg.cholesky(limit), off)
    row["squared"] = float(whitened @ whitened)  # chi-squared with 6 degrees of freedom at the bound
    return row


def designed(rung: str) -> np.ndarray:
    """Return the torque of three sines an axis with the smallest trace of the bound."""
    base = np.array([0.01, 0.03, 0.07])

    def torque(x: np.ndarray) -> np.ndarray:
        share, phase = x[:9].reshape(3, 3), x[9:18].reshape(3, 3)
        angle = 2 * np.pi * TIMES[:, None, None] * base * np.exp(x[18:21]) + phase
        return scaled(np.sum(share * np.sin(angle), axis=2))

    def cost(x: np.ndarray) -> float:
        return float(np.log(np.trace(bound(rung, torque(x)))))

    start = np.concatenate([np.ones(9), np.random.default_rng(1).uniform(0, 6, 9), np.zeros(3)])
    best = minimize(cost, start, method="Powell", options={"maxfev": 60})
    return torque(best.x)


def summary(rows: list[dict]) -> list[dict]:
    """Return one line for every rung and profile."""
    out = []
    for rung, profile in dict.fromkeys((r["rung"], r["profile"]) for r in rows):
        own = [r for r in rows if (r["rung"], r["profile"]) == (rung, profile)]
        there = [r for r in own if "error" in r]
        line = {"rung": rung, "profile": profile, "draws": len(own), "bound_percent": 100 * own[0]["bound"]}
        line["saturated"] = own[0]["saturated"]
        line["useless"] = own[0]["bound"] > TOLD
        line["said_to_be_so"] = sum(
            bool(r.get("missing") or r.get("not_identifiable") or "error_raised" in r) for r in own
        )
        if there:
            rms = float(np.sqrt(np.mean([r["error"] ** 2 for r in there])))
            line["error_percent"] = 100 * rms
            line["ratio"] = rms / own[0]["bound"]
            line["whitened_ratio"] = float(np.sqrt(np.mean([r["squared"] for r in there]) / 6.0))
            line["coverage"] = float(np.mean(np.abs([x for r in there for x in r["off"]]) < 1.96))
        out.append(line)
    return out


def main() -> None:
    """Run what is not there yet."""
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    path = RESULTS / f"{NAME}.json"
    rows = json.loads(path.read_text(encoding="utf-8"))["rows"] if path.is_file() else []
    there = {(r["rung"], r["profile"], r["seed"]) for r in rows}
    torques = profiles()
    plan = [(rung, name, torques[name]) for rung in RUNGS for name in sys.argv[2:] or torques]
    if not sys.argv[2:]:
        plan.append(("wheels", "designed", designed("wheels")))
    made = [(rung, name, torque, flown(rung, torque), bound(rung, torque)) for rung, name, torque in plan]
    for seed in range(draws):
        for rung, name, torque, motion, limit in made:
            if (rung, name, seed) in there:
                continue
            rows.append(row_of(rung, name, torque, motion, limit, seed))
            print(json.dumps(rows[-1]), flush=True)
            write_result(NAME, {"environment": environment("smsid"), "summary": summary(rows), "rows": rows})
    for line in summary(rows):
        print(json.dumps(line))


if __name__ == "__main__":
    main()
