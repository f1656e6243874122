"""A rigid free-flyer fitted by `smsid.likelihood.refine` and by `mujoco.sysid`, from the same recordings.

    pip install "mujoco[sysid]"
    python benchmarks/mujoco_sysid.py 20

One bus, ten inertial parameters. Two recordings of 30 s at 100 Hz: thrust with the attitude held, and torque
steps floating freely, in MuJoCo at 1 ms, then the noise of preset `reference` with biases of 1e-4 m/s2 and
1e-5 rad/s. Both start from the same description, wrong by 30 % in mass and inertia and by 0.1 m in the centre
of mass, and estimate the same: inertial parameters, biases, initial pose.

`mujoco.sysid` at its best: pseudo-inertia parametrisation, its own optimizer, its batched finite differences,
one thread, residuals divided by the true noise levels (refine has to estimate them), attitude errors as
rotation vectors, biases and initial pose as parameters. Its rollout dates sensor readings one step late
(they belong to the beginning of a step, the times to its end); `modify_residual` puts that right. The data
come from the engine that it fits with, which is an advantage for it. Each run is timed in CPU seconds.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from _common import environment, spread, write_result
from _mujoco_sysid import POINT, THETA, TIMES, TRUTH, flown, pseudo_inertia_fit, to_inertial

from smsid.description import load_description
from smsid.description.schema import Description
from smsid.likelihood import fisher_information, refine
from smsid.recording import Recording
from smsid.sensing import add_noise

NAME = "mujoco_sysid"
BIASES = {"acceleration": 1e-4, "angular_rate": 1e-5}  # one sigma [m/s^2, rad/s]

URDF = """<robot name="flyer"><link name="bus"><inertial><origin xyz="{centre}"/><mass value="{mass}"/>
<inertia ixx="{i[0]}" iyy="{i[1]}" izz="{i[2]}" ixy="{i[3]}" ixz="{i[4]}" iyz="{i[5]}"/></inertial></link>
</robot>"""
TOML = """schema = 1
name = "flyer"
urdf = "{urdf}"
[[sensor]]
name = "pose"
kind = "pose"
position = {point}
preset = "reference"
[[sensor]]
name = "imu"
kind = "imu"
position = {point}
preset = "reference"
"""


def described(folder: Path, name: str, mass: float, centre: np.ndarray, inertia: np.ndarray) -> Description:
    """A description of the free-flyer with these values (inertia about the centre: xx yy zz xy xz yz)."""
    (folder / f"{name}.urdf").write_text(
        URDF.format(mass=mass, centre=" ".join(map(str, centre)), i=inertia.tolist())
    )
    (folder / f"{name}.toml").write_text(TOML.format(urdf=f"{name}.urdf", point=list(POINT)))
    return load_description(folder / f"{name}.toml")


def wrong(seed: int) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre and inertia about it, wrong at random."""
    rng = np.random.default_rng([seed, 3])
    mass, centre, inertia = TRUTH
    factor = 1.0 + 0.3 * rng.choice([-1.0, 1.0])
    turned = 1.0 + 0.1 * rng.choice([-1.0, 1.0], 6)  # an inertia that a body can have, on top of 30 %
    return mass * factor, centre + 0.1 * rng.choice([-1.0, 1.0], 3), inertia * factor * turned


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("seeds", type=int)
    args = parser.parse_args()
    clean = [recording(kind) for kind in ("held", "free")]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        true = described(folder, "true", *TRUTH)
        bound = fisher_information(true, clean)
        sensors = [
            s.model_copy(
                update={
                    "errors": {
                        q: e.model_copy(update={"bias_sigma": BIASES[q]}) if q in BIASES else e
                        for q, e in s.errors.items()
                    }
                }
            )
            for s in true.sensor
        ]
        rows: dict[str, list[dict[str, Any]]] = {"smsid": [], "mujoco.sysid": []}
        for seed in range(args.seeds):
            rng = np.random.default_rng(seed)
            noisy = [add_noise(r, sensors, rng) for r in clean]
            start = wrong(seed)
            own = described(folder, f"wrong{seed}", *start)
            for way in rows:
                begin = time.process_time()
                values, more = by_smsid(own, noisy) if way == "smsid" else by_sysid(true, start, noisy)
                taken = time.process_time() - begin
                rows[way].append({"values": values, "cpu_seconds": taken, **more})
                print(seed, way, f"{taken:.2f} s", {k: round(v, 3) for k, v in values.items()}, flush=True)
        sigma = {symbol(n): s for n, s in bound.sigma.items()}
    write_result(NAME, summary(rows, sigma))


def recording(kind: str) -> Recording:
    """A recording without noise."""
    control, channels = flown(kind)
    zero = np.zeros((len(TIMES), 3))
    command = {"command.force": control if kind == "held" else zero}
    if kind == "free":
        command["command.torque"] = control
    return Recording.from_arrays(TIMES, {**channels, **command}, role="estimation", name=kind)


def by_smsid(description: Description, noisy: Sequence[Recording]) -> tuple[dict[str, float], dict[str, Any]]:
    found = refine(description, noisy)
    values = {symbol(p.name): p.value for p in found.estimate.parameters if p.group != "nuisance"}
    return values, {"iterations": found.estimate.conditions["iterations"]}


def symbol(name: str) -> str:
    return "m" if name == "total.mass" else name.removeprefix("bus.")


def by_sysid(
    description: Description, start: tuple[float, np.ndarray, np.ndarray], noisy: Sequence[Recording]
) -> tuple[dict[str, float], dict[str, Any]]:
    sigma = {
        f"{s.name}.{q}": float(np.max(s.error(q).white_sigma(s.rate)))
        for s in description.sensor
        for q in s.quantities
    }
    theta, more = pseudo_inertia_fit(start, {r.name: r for r in noisy}, sigma)
    return dict(zip(THETA, theta, strict=True)), more


def summary(rows: dict[str, list[dict[str, Any]]], sigma: dict[str, float]) -> dict[str, Any]:
    """Error against the bound, and time, of both."""
    truth = dict(zip(THETA, to_inertial(*TRUTH), strict=True))
    document: dict[str, Any] = {
        "environment": environment("pin", "mujoco", "numpy", "scipy"),
        "seeds": len(rows["smsid"]),
        "bound": {k: sigma[k] for k in THETA},
    }
    for way, own in rows.items():
        off = np.array([[(r["values"][k] - truth[k]) / sigma[k] for k in THETA] for r in own])
        document[way] = {
            "rms error over the bound": float(np.sqrt(np.mean(off**2))),
            "by parameter": {
                k: float(x) for k, x in zip(THETA, np.sqrt(np.mean(off**2, axis=0)), strict=True)
            },
            "CPU s": spread(np.array([r["cpu_seconds"] for r in own])),
            "iterations": spread(np.array([r["iterations"] for r in own])),
        }
    document["mujoco.sysid"]["CPU s of its rollouts alone"] = spread(
        np.array([r["rollouts"] for r in rows["mujoco.sysid"]])
    )
    pairs = zip(rows["smsid"], rows["mujoco.sysid"], strict=True)
    document["CPU time, mujoco.sysid over smsid"] = spread(
        np.array([b["cpu_seconds"] / a["cpu_seconds"] for a, b in pairs])
    )
    pairs = zip(rows["smsid"], rows["mujoco.sysid"], strict=True)
    apart = [abs(a["values"][k] - b["values"][k]) / sigma[k] for a, b in pairs for k in THETA]
    document["largest difference of the two, over the bound"] = float(max(apart))
    print(document)
    return document


if __name__ == "__main__":
    main()
