"""Servo joints from encoders alone: coverage of gains, friction and rotors on a MuJoCo twin.

Two joints with position actuators, 20 seeds of motion and of encoder noise. An interval of 95 % must hold the
truth in 95 % of the cases, within the binomial band.

    python benchmarks/servo_twin.py
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from _common import ROOT, environment, write_result

from smsid.arm import identify_servos, with_joint_effects
from smsid.description import Description

sys.path.insert(0, str(ROOT))
from tests.arm.servo_twin import TRUTH, URDF, recorded

SEEDS = 20
NOISES = (2e-5, 2e-4)
KINDS = ("joint_friction", "motor_inertia", "torque_offset")


def main() -> None:
    results = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "two.urdf").write_text(URDF)
        bare = Description(
            name="two", urdf="two.urdf", folder=folder, root="fixed", gravity=(0.0, 0.0, -9.81)
        )
        arm = with_joint_effects(bare, ("j1", "j2"), *KINDS, "servo")
        for noise in NOISES:
            scores, widths, begin = [], [], time.process_time()
            for seed in range(SEEDS):
                found = identify_servos(arm, recorded(seed, noise=noise)).estimate
                scores.append([(found[n].value - x) / found[n].sigma for n, x in TRUTH.items()])
                widths.append([found[n].sigma / x for n, x in TRUTH.items()])
            z = np.array(scores)
            results[f"encoder noise {noise:g} rad"] = {
                "inside_95_percent": round(float(np.mean(np.abs(z) < 1.959964)), 4),
                "by_parameter": {
                    n: {
                        "inside": int(np.sum(np.abs(z[:, k]) < 1.959964)),
                        "mean_z": round(float(z[:, k].mean()), 2),
                        "rms_z": round(float(np.sqrt(np.mean(z[:, k] ** 2))), 2),
                        "relative_sigma": round(float(np.median(np.array(widths)[:, k])), 5),
                    }
                    for k, n in enumerate(TRUTH)
                },
                "seconds_of_cpu_with_simulation": round(time.process_time() - begin, 1),
            }
    result = {
        "claim": "gains, friction and rotors of servos from encoders alone, inside 95 % intervals",
        "command": "python benchmarks/servo_twin.py",
        "environment": environment("pin", "numpy", "scipy", "mujoco"),
        "seeds": SEEDS,
        "results": results,
    }
    print(write_result("servo_twin", result))
    for key, value in results.items():
        print(key, value["inside_95_percent"], {n: p["mean_z"] for n, p in value["by_parameter"].items()})


if __name__ == "__main__":
    main()
