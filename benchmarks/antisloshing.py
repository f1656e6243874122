"""Slosh of water carried by a robot: frequency, damping, mass and sensor lag, against linear theory.

Motion comes from the joint stamps and the arm's kinematics, force from the sensor at the hand. The record
is one move of 0.8 s and 11 s of ring-down; models are compared by likelihood, and the named one's
frequency and mass are judged by theory (Abramson 1966), which takes no part in the fit.

    python benchmarks/antisloshing.py
"""

from __future__ import annotations

import json
import time
from typing import Any

import numpy as np
import pinocchio as pin
from _common import environment, write_result

from smsid.datasets import antisloshing
from smsid.lab import compare_tank_models, cylinder_slosh, tank_test
from smsid.lab.tank_models import tank_diagnosis
from smsid.model import build_model

RADIUS, FILL = 0.049, 0.080  # [m]


def hand_positions() -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Force along the move and position of the hand along it, each with its times."""
    description, log = antisloshing()
    model = build_model(description)
    frame = model.pin.getFrameId("axes_6")
    places = []
    for angles in log["encoder.joint_position"]:
        pin.framesForwardKinematics(model.pin, model.data, model.set_joint_angles(model.home, angles))
        places.append(model.data.oMf[frame].translation[1])
    return (
        (log.time("hand.force"), log["hand.force"][:, 1]),
        (log.time("encoder.joint_position"), np.array(places)),
    )


def main() -> None:
    force, motion = hand_positions()
    test = tank_test(force, motion)
    before = test.time < test.time[~test.at_rest][0]
    theory = cylinder_slosh(RADIUS, FILL)
    models: dict[str, Any] = {}
    begin = time.perf_counter()
    compared = compare_tank_models(test)
    seconds = time.perf_counter() - begin
    for kind, found in compared.fits.items():
        models[kind] = {
            "ring_down_residual_N": round(found.ring_down, 4),
            "moving_residual_N": round(found.moving, 4),
            "before_move_residual_N": round(float(np.sqrt(np.mean(found.residual[before] ** 2))), 4),
            "notes": list(found.estimate.notes),
            "log_likelihood": round(found.log_likelihood, 1),
            "parameters": {
                p.name.removeprefix("tank."): {
                    "value": p.value,
                    "interval_95": list(p.interval),
                    "unit": p.unit,
                }
                for p in found.estimate.parameters
            },
        }
    values = models[compared.named]["parameters"]
    diagnosis = json.loads(tank_diagnosis(test, compared, "antisloshing").to_json())
    result = {
        "claim": "slosh from a tank test, within theory, with intervals",
        "command": "python benchmarks/antisloshing.py",
        "environment": environment("pin", "numpy", "scipy", "rosbags"),
        "theory": {"frequency_Hz": theory[0], "mass_kg": theory[1]},
        "lag_by_cross_correlation_s": {"value": test.lag.value, "interval_95": list(test.lag.interval)},
        "models": models,
        "named": compared.named,
        "twofold_log_likelihood_gained_in_independent_samples": {
            k: round(x, 1) for k, x in compared.gains.items()
        },
        "seconds": round(seconds, 1),
        "frequency_over_theory": values["frequency"]["value"] / theory[0],
        "mass_over_theory": values["slosh_mass"]["value"] / theory[1],
        "amplitude_dependence_significant": compared.amplitude,
        "diagnosis": {k: diagnosis[k] for k in ("verdict", "sentence", "causes", "remaining", "notes")},
        "left": "after the move hardly more than before it (no slosh); during it the arm's vibration",
    }
    print(write_result("antisloshing", result))
    for key in (
        "theory",
        "named",
        "frequency_over_theory",
        "mass_over_theory",
        "amplitude_dependence_significant",
    ):
        print(key, result[key])
    for kind, row in models.items():
        print(kind, row["ring_down_residual_N"], row["moving_residual_N"], row["log_likelihood"])


if __name__ == "__main__":
    main()
