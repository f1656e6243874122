"""Exp. 2 from recordings of minutes to hours, by the paper's method and by the default one: time and memory.

    python benchmarks/long_recordings.py 10000 100000 1000000
    python benchmarks/long_recordings.py 10000 100000 --method ml

Each length is flown and written to a file first; then a process of its own reads it and identifies, of
which the CPU time and the largest resident memory are taken. One that only imports is the offset. Lengths
measured before are kept. Of the default method, which starts from the paper's, the seconds of the
refinement are told too. The rigid spacecraft (no slosh, no panel) goes to and fro along one free-floating
motion of 80 s. What floats at zero momentum follows the same path at any pace, so this is exact however
long it lasts. Noise is that of preset `reference`, `--seed` gives another draw. Errors of the estimate should
be of size one in standard deviations: their rms, which is 0.7 to 1.5 in single draws of 29 that go together,
and chi-squared per parameter by their covariance, 1.0 +- 0.26. Nothing moves above 0.3 Hz: the motion is
low-passed at 1 Hz and taken at 5 Hz.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from typing import Any

import numpy as np
from _common import ROOT, environment, write_result
from scipy.interpolate import CubicSpline

sys.path.insert(0, str(ROOT / "tests"))

from likelihood import twin

from smsid.description.schema import Description
from smsid.estimation.identify import identify_spacecraft
from smsid.identify.momentum_rows import carried_by_bus
from smsid.identify.paper._exp2 import identify_momentum
from smsid.inputs.signals import Fourier
from smsid.model import SpacecraftModel, build_model
from smsid.model.regressor import Regressor
from smsid.recording import Recording, load_recording, save_recording
from smsid.simulate import Inputs, simulate

NAME = "long_recordings"
RATE, PATH, PERIOD = 100.0, 80.0, 160.0
CHANNELS = (
    "pose.position",
    "pose.attitude",
    "pose.velocity",
    "imu.angular_rate",
    "imu.acceleration",
    "encoder.joint_position",
    "encoder.joint_velocity",
    "tachometer.wheel_rate",
)


def rigid() -> Description:
    """The paper's spacecraft without slosh and panel."""
    d = twin.description()
    sensors = tuple(s for s in d.sensor if s.name != "panel")
    return d.model_copy(update={"effect": (), "sensor": sensors})


def to_and_fro(model: SpacecraftModel, samples: int, seed: int = 9) -> Recording:
    """So many samples of the motion, with the sensors' noise."""
    sensors = {s.name: s for s in model.description.sensor}
    inputs = Inputs(
        wheel_torque=Fourier(1 / 40.0, twin.WHEEL_COS, twin.WHEEL_SIN, np.zeros(3)),
        joint_torque=Fourier(1 / 40.0, twin.JOINT_COS, twin.JOINT_SIN, np.zeros(3)),
    )
    times = np.arange(round(PATH * RATE) + 1) / RATE
    states = simulate(model, inputs, PATH).states(times)
    quaternions = states.q[:, 3:7]
    signs = np.where(np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0, -1.0, 1.0)
    quaternions = quaternions * np.concatenate([[1.0], np.cumprod(signs)])[:, None]
    arm, wheels = model.arm_joints, model.wheels
    columns = [states.q[:, :3], quaternions, states.v[:, :6], states.q[:, arm.q], states.v[:, arm.v]]
    path = CubicSpline(times, np.hstack([*columns, states.v[:, wheels.v]]))
    once = period(path, np.array(sensors["pose"].position))
    count, rng = np.arange(samples), np.random.default_rng(seed)
    channels = {}
    for name in CHANNELS:
        source, quantity = name.split(".")
        exact = once[name][count % round(PERIOD * RATE)]
        noise = sensors[source].error(quantity).white_sigma(RATE) * rng.standard_normal((samples, 3))
        if quantity == "attitude":
            half = np.column_stack([0.5 * noise, np.ones(samples)])
            channels[name] = product(exact, half / np.linalg.norm(half, axis=1, keepdims=True))
        else:
            channels[name] = exact + noise
    return Recording.from_arrays(count / RATE, channels, role="estimation", name="to and fro")


def period(path: CubicSpline, point: np.ndarray) -> dict[str, np.ndarray]:
    """One time there and back, without noise."""
    phase = 2 * np.pi * np.arange(round(PERIOD * RATE)) / round(PERIOD * RATE)
    at = 0.5 * PATH * (1.0 - np.cos(phase))
    pace = (0.5 * PATH * 2 * np.pi / PERIOD * np.sin(phase))[:, None]
    change = (0.5 * PATH * (2 * np.pi / PERIOD) ** 2 * np.cos(phase))[:, None]
    x, slope = path(at), path(at, 1)
    position, quaternion, velocity, rate = x[:, :3], x[:, 3:7], x[:, 7:10], x[:, 10:13]
    quaternion = quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
    own = velocity + np.cross(rate, point)
    own_slope = slope[:, 7:10] + np.cross(slope[:, 10:13], point)
    acceleration = own_slope * pace**2 + own * change + np.cross(rate * pace, own * pace)
    return {
        "pose.position": position + turned(quaternion, np.broadcast_to(point, position.shape)),
        "pose.attitude": quaternion,
        "pose.velocity": turned(quaternion, own * pace),
        "imu.angular_rate": rate * pace,
        "imu.acceleration": acceleration,
        "encoder.joint_position": x[:, 13:16],
        "encoder.joint_velocity": x[:, 16:19] * pace,
        "tachometer.wheel_rate": x[:, 19:22] * pace,
    }


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Products (N, 4) of quaternions x y z w."""
    v = a[:, 3:] * b[:, :3] + b[:, 3:] * a[:, :3] + np.cross(a[:, :3], b[:, :3])
    return np.column_stack([v, a[:, 3] * b[:, 3] - np.sum(a[:, :3] * b[:, :3], axis=1)])


def turned(q: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Vectors (N, 3) turned by quaternions x y z w (N, 4)."""
    t = 2.0 * np.cross(q[:, :3], x)
    return x + q[:, 3:] * t + np.cross(q[:, :3], t)


def one(file: str, method: str) -> dict[str, Any]:
    """Time, memory and errors of a recording; without one, what there is before anything is read."""
    model = build_model(rigid())
    begin = time.process_time()
    recording = load_recording(file) if file else None
    result: dict[str, Any] = {"samples": len(recording.time()) if recording else 0}
    if recording is not None and method == "ml":
        made = identify_spacecraft(model.description, [recording]).estimate
        told = [p for p in made.parameters if p.status == "identifiable" and p.nominal is not None]
        assert made.covariance is not None
        places = [made.parameters.index(p) for p in told]
        off = np.array([p.value - p.nominal for p in told if p.nominal is not None])
        squared = float(off @ np.linalg.solve(made.covariance[np.ix_(places, places)], off))
        off = off / [p.sigma for p in told]
        sigma = [p.sigma / max(abs(p.value), 1.0) for p in told]
        result |= {
            "parameters": len(off),
            "rms error / sigma": float(np.sqrt(np.mean(off**2))),
            "chi-squared / parameters": squared / len(off),
            "median sigma, relative": float(np.median(sigma)),
            "refinement [s]": made.timing["total"],
        }
    elif recording is not None:
        found = identify_momentum(model, recording, model.mass, cutoff=1.0, rate=5.0)
        regressor = Regressor(model)
        theta = regressor.parameters + carried_by_bus(model, regressor)
        chosen = [regressor.names.index(n) for n in found.b.theta_names]
        off = (found.b.values - found.b.base.values(theta[chosen])) / found.b.sigma
        result |= {
            "rows": 9 * len(found.motion),
            "parameters": len(off),
            "rms error / sigma": float(np.sqrt(np.mean(off**2))),
            "median sigma, relative": float(
                np.median(found.b.sigma / np.maximum(np.abs(found.b.values), 1.0))
            ),
        }
    result["cpu_seconds"] = time.process_time() - begin
    result["load average"] = round(os.getloadavg()[0], 1)
    result["peak_mib"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("samples", type=int, nargs="*")
    parser.add_argument("--method", choices=("paper", "ml"), default="paper", help="ml: the default one")
    parser.add_argument("--seed", type=int, default=9, help="of the sensors' noise")
    parser.add_argument("--one", metavar="FILE", help="run one recording here and print it")
    parser.add_argument("--write", metavar="FILE", help="fly one length here and write it")
    args = parser.parse_args()
    if args.one is not None:
        print(json.dumps(one(args.one, args.method)))
        return
    if args.write:
        save_recording(to_and_fro(build_model(rigid()), args.samples[0], args.seed), args.write)
        return
    file = ROOT / "benchmarks" / "results" / f"{NAME}.json"
    known = json.loads(file.read_text()) if file.is_file() else {}
    by_length = {r["samples"]: r for r in known.get(args.method, {}).get("runs", [])}
    for samples in [0, *args.samples]:
        with tempfile.TemporaryDirectory(prefix="long-") as folder:
            flown, command = f"{folder}/flown.nc" if samples else "", [sys.executable, __file__]
            if flown:
                how = [str(samples), "--write", flown, "--seed", str(args.seed)]
                subprocess.run([*command, *how], check=True)
            command += ["--one", flown, "--method", args.method]
            out = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        by_length[samples] = json.loads(out.splitlines()[-1])
        print(by_length[samples], flush=True)
        rows = [by_length[n] for n in sorted(by_length)]
        used = [r for r in rows if r["samples"]]
        result: dict[str, Any] = {"environment": environment("pin", "numpy", "scipy"), "runs": rows}
        if used:
            first, last = used[0], used[-1]
            result["seconds per 1e5 samples"] = [1e5 * r["cpu_seconds"] / r["samples"] for r in used]
            result["peak memory, longest over shortest"] = last["peak_mib"] / first["peak_mib"]
        write_result(NAME, {**known, args.method: result})


if __name__ == "__main__":
    main()
