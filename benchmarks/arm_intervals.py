"""Coverage of a six-axis arm's intervals: a UR5 of example-robot-data in plain Pinocchio inverse dynamics.

Payload of 1.5 kg that the description does not know, viscous and Coulomb friction, rotors, torque noise;
every combination of encoder noise, rate and sharpness of friction in turn, with seeds of motion, and noise
drawn anew for each: what all share would look like a bias. A draw is a line of ``build/arm_intervals.jsonl``,
so it can be stopped. Lines are kept where the first draw of their setting, made again, comes out the same to
a twentieth of a standard deviation.

The mean of a parameter's z over S seeds scatters by 1/sqrt(S) where nothing is biased, so that the largest of
all K means says little by itself: 0.73 is usual for 20 seeds, 0.37 for 80. Beside it stands the chance that K
unbiased means have a larger one, 1 - (1 - 2 Phi(-|mean z| sqrt(S)))^K (Sidak): a bias makes it small. A mean
can be held to 0.5 with 80 seeds.

    python benchmarks/arm_intervals.py [SEEDS]
"""

from __future__ import annotations

import json
import sys
import time
from itertools import product
from typing import Any

import numpy as np
import pinocchio as pin
from _common import ROOT, environment, write_result
from scipy.stats import binom, norm

from smsid._statistics import NORMAL95
from smsid.arm import identify_arm, with_joint_effects
from smsid.arm.identify import rigid_arm
from smsid.arm.setup import arm_description
from smsid.model.regressor import Regressor
from smsid.recording import Recording

NOISES = (1e-5, 2e-4)
RATES = (500.0, 100.0)
WIDTHS = (0.005, 0.05)
SETTINGS = tuple(product(RATES, NOISES, WIDTHS))
STORE = ROOT / "build" / "arm_intervals.jsonl"
SECONDS = 40.0
VISCOUS = np.array([5.0, 6.0, 4.0, 1.0, 1.0, 0.8])
COULOMB = np.array([8.0, 9.0, 6.0, 1.5, 1.5, 1.2])
ROTOR = np.array([0.5, 0.5, 0.4, 0.1, 0.1, 0.1])
TORQUE = np.array([1.0, 1.0, 0.7, 0.15, 0.15, 0.1])
PAYLOAD = pin.Inertia(1.5, np.array([0.0, 0.05, 0.06]), np.diag([2e-3] * 3))


def motion(seed: int, rate: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    draw, t = np.random.default_rng(seed), np.arange(0.0, SECONDS, 1.0 / rate)
    omega = 2.0 * np.pi / 20.0 * np.arange(1, 6)
    a, b = draw.normal(size=(2, 6, 5)) * 0.35 / np.sqrt(np.arange(1, 6))
    sin, cos = np.sin(np.outer(t, omega)), np.cos(np.outer(t, omega))
    q = sin @ (a / omega).T - cos @ (b / omega).T + [0.0, -1.2, 1.0, 0.3, 0.6, 0.0]
    return t, q, cos @ a.T + sin @ b.T, cos @ (b * omega).T - sin @ (a * omega).T


class Twin:
    """The arm as described, and as it is: links with a payload, friction and rotors."""

    def __init__(self) -> None:
        bare = arm_description(robot="ur5")
        model = rigid_arm(bare)
        self.joints = model.arm_joints.names
        self.arm = with_joint_effects(bare, self.joints, "joint_friction", "motor_inertia", "torque_offset")
        self.pin = model.pin.copy()
        self.pin.inertias[6] = self.pin.inertias[6] + PAYLOAD
        self.data = self.pin.createData()
        self.links = Regressor(model).parameters.copy()
        self.links[-10:] += PAYLOAD.toDynamicParameters()
        own = {"friction_{}.viscous": VISCOUS, "friction_{}.coulomb": COULOMB, "rotor_{}.inertia": ROTOR}
        self.values = {
            name.format(j): x for name, xs in own.items() for j, x in zip(self.joints, xs, strict=True)
        }

    def draw(self, place: int, seed: int) -> dict[str, Any]:
        """Return z of all parameters for a setting and a seed, and the processor time."""
        rate, noise, width = SETTINGS[place]
        t, q, v, a = motion(seed, rate)
        draw = np.random.default_rng((1000 + seed, place))
        rigid = np.array([pin.rnea(self.pin, self.data, *x) for x in zip(q, v, a, strict=True)])
        torque = rigid + VISCOUS * v + COULOMB * np.tanh(v / width) + ROTOR * a
        torque += TORQUE * draw.normal(size=v.shape)
        channels = {"e.joint_position": q + noise * draw.normal(size=q.shape), "d.joint_torque": torque}
        log = Recording.from_arrays(t, channels, labels={"joint": self.joints}, role="estimation")
        begin = time.process_time()
        found = identify_arm(self.arm, log)
        seconds = time.process_time() - begin
        names = found.torques.names[self.links.size :]
        beta = found.base.values(np.concatenate([self.links, [self.values.get(n, 0.0) for n in names]]))
        own = found.estimate.parameters[: len(beta)]
        z = {p.name: (p.value - x) / p.sigma for p, x in zip(own, beta, strict=True)}
        return {"place": place, "seed": seed, "seconds": round(seconds, 2), "z": z}


def stored(twin: Twin) -> dict[tuple[int, int], dict[str, Any]]:
    """Return the draws of earlier runs by setting and seed, where a setting's first is still the same."""
    if not STORE.is_file():
        return {}
    found = {(d["place"], d["seed"]): d for d in map(json.loads, STORE.read_text("utf-8").splitlines())}
    kept = {}
    for place in range(len(SETTINGS)):
        if (place, 0) not in found:
            continue
        before, now = found[place, 0]["z"], twin.draw(place, 0)["z"]
        if before.keys() == now.keys() and np.allclose(
            [*before.values()], [*now.values()], rtol=0.0, atol=0.05
        ):
            kept |= {key: d for key, d in found.items() if key[0] == place}
    return kept


def main() -> None:
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 80
    twin = Twin()
    draws = stored(twin)
    STORE.parent.mkdir(exist_ok=True)
    with STORE.open("a", encoding="utf-8") as file:
        for seed, place in product(range(seeds), range(len(SETTINGS))):
            if (place, seed) not in draws:
                draws[place, seed] = twin.draw(place, seed)
                file.write(json.dumps(draws[place, seed]) + "\n")
                file.flush()
    print(write_result("arm_intervals", summary(seeds, draws)))


def summary(seeds: int, draws: dict[tuple[int, int], dict[str, Any]]) -> dict[str, Any]:
    """Return coverage and means of z, of every setting and of all."""
    names = [*draws[0, 0]["z"]]
    z = np.array([[[draws[p, s]["z"][n] for n in names] for s in range(seeds)] for p in range(len(SETTINGS))])
    seconds = [d["seconds"] for d in draws.values() if SETTINGS[d["place"]][0] == 500.0]
    results = {}
    for (rate, noise, width), own in zip(SETTINGS, z, strict=True):
        mean = own.mean(axis=0)
        worst = int(np.abs(mean).argmax())
        results[f"encoder {noise:g} rad, {rate:g} Hz, friction turns over at {width:g} rad/s"] = {
            "inside_95_percent": round(float(np.mean(np.abs(own) < NORMAL95)), 4),
            "rms_z": round(float(np.sqrt(np.mean(own**2))), 3),
            "largest_mean_z": round(float(abs(mean[worst])), 2),
            "of": names[worst],
        }
    low, high = binom.interval(0.99, z[0].size, 0.95) / np.array(z[0].size)
    pooled = z.mean(axis=(0, 1))
    means = z.mean(axis=1)
    largest = float(np.abs(means).max())
    beyond = 2.0 * norm.sf(largest * np.sqrt(seeds))  # of one mean, without bias
    return {
        "claim": "intervals of a six-axis arm hold the truth at any rate, noise and sharpness of friction",
        "command": f"python benchmarks/arm_intervals.py {seeds}",
        "environment": environment("pin", "numpy", "scipy"),
        "seeds": seeds,
        "parameters": len(names),
        "inside_95_percent": round(float(np.mean(np.abs(z) < NORMAL95)), 4),
        "band_of_a_setting": [round(float(low), 4), round(float(high), 4)],
        "largest_mean_z": round(largest, 2),
        "largest_mean_z_by_chance": round(float(norm.ppf(1.0 - 0.25 / means.size) / np.sqrt(seeds)), 2),
        "chance_of_a_larger_mean_z_without_bias": round(float(-np.expm1(means.size * np.log1p(-beyond))), 3),
        "largest_mean_z_over_all_settings": {
            names[int(np.abs(pooled).argmax())]: round(float(pooled[np.abs(pooled).argmax()]), 2)
        },
        "results": results,
        "seconds_of_cpu_for_40_s_at_500_Hz": round(float(np.median(seconds)), 2),
    }


if __name__ == "__main__":
    main()
