"""Coverage of a six-axis arm's intervals: a UR5 of example-robot-data in plain Pinocchio inverse dynamics.

Payload of 1.5 kg that the description does not know, viscous and Coulomb friction, rotors, torque noise;
every combination of encoder noise, rate and sharpness of friction in turn, with seeds of motion, and noise
drawn anew for each: what all share would look like a bias. The result is written after every combination.

    python benchmarks/arm_intervals.py [SEEDS]
"""

from __future__ import annotations

import sys
import time
from itertools import product

import numpy as np
import pinocchio as pin
from _common import environment, write_result

from smsid.arm import identify_arm, with_joint_effects
from smsid.arm.identify import rigid_arm
from smsid.arm.setup import arm_description
from smsid.model.regressor import Regressor
from smsid.recording import Recording

NOISES = (1e-5, 2e-4)
RATES = (500.0, 100.0)
WIDTHS = (0.005, 0.05)
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


def main() -> None:
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    bare = arm_description(robot="ur5")
    model = rigid_arm(bare)
    joints = model.arm_joints.names
    arm = with_joint_effects(bare, joints, "joint_friction", "motor_inertia", "torque_offset")
    twin = model.pin.copy()
    twin.inertias[6] = twin.inertias[6] + PAYLOAD
    data = twin.createData()
    links = Regressor(model).parameters.copy()
    links[-10:] += PAYLOAD.toDynamicParameters()
    values = {f"friction_{j}.viscous": x for j, x in zip(joints, VISCOUS, strict=True)}
    values |= {f"friction_{j}.coulomb": x for j, x in zip(joints, COULOMB, strict=True)}
    values |= {f"rotor_{j}.inertia": x for j, x in zip(joints, ROTOR, strict=True)}
    results: dict[str, dict[str, float]] = {}
    every: list[np.ndarray] = []
    seconds: list[tuple[float, float]] = []
    for place, (rate, noise, width) in enumerate(product(RATES, NOISES, WIDTHS)):
        scores: list[list[float]] = []
        for seed in range(seeds):
            t, q, v, a = motion(seed, rate)
            draw = np.random.default_rng((1000 + seed, place))
            rigid = np.array([pin.rnea(twin, data, *x) for x in zip(q, v, a, strict=True)])
            torque = rigid + VISCOUS * v + COULOMB * np.tanh(v / width) + ROTOR * a
            torque += TORQUE * draw.normal(size=v.shape)
            channels = {"e.joint_position": q + noise * draw.normal(size=q.shape), "d.joint_torque": torque}
            log = Recording.from_arrays(t, channels, labels={"joint": joints}, role="estimation")
            begin = time.process_time()
            found = identify_arm(arm, log)
            seconds.append((rate, time.process_time() - begin))
            truth = np.concatenate([links, [values.get(n, 0.0) for n in found.torques.names[links.size :]]])
            beta = found.base.values(truth)
            own = found.estimate.parameters[: len(beta)]
            scores.append([(p.value - x) / p.sigma for p, x in zip(own, beta, strict=True)])
        z = np.array(scores)
        every.append(z)
        results[f"encoder {noise:g} rad, {rate:g} Hz, friction turns over at {width:g} rad/s"] = {
            "inside_95_percent": round(float(np.mean(np.abs(z) < 1.959964)), 4),
            "rms_z": round(float(np.sqrt(np.mean(z**2))), 3),
            "largest_mean_z": round(float(np.abs(z.mean(axis=0)).max()), 2),
        }
        print(*list(results.items())[-1], flush=True)
        write(seeds, results, every, seconds)


def write(
    seeds: int,
    results: dict[str, dict[str, float]],
    every: list[np.ndarray],
    seconds: list[tuple[float, float]],
) -> None:
    """Write what is there: deviations (seeds, parameters) of every combination, and CPU seconds by rate."""
    z = np.concatenate(every)
    at_500 = [s for rate, s in seconds if rate == 500.0]
    result = {
        "claim": "intervals of a six-axis arm hold the truth at any rate, noise and sharpness of friction",
        "command": f"python benchmarks/arm_intervals.py {seeds}",
        "environment": environment("pin", "numpy", "scipy"),
        "seeds": seeds,
        "parameters": z.shape[1],
        "inside_95_percent": round(float(np.mean(np.abs(z) < 1.959964)), 4),
        "largest_mean_z": round(float(np.abs(z.mean(axis=0)).max()), 2),
        "results": results,
        "seconds_of_cpu_for_40_s_at_500_Hz": round(float(np.median(at_500)), 2) if at_500 else None,
    }
    print(write_result("arm_intervals", result))


if __name__ == "__main__":
    main()
