"""How long one controller update takes, PD and with the H-infinity term, for 3, 6 and 7 joints."""

from __future__ import annotations

import os
import time

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import numpy as np  # noqa: E402
from _common import ROOT, environment, interleaved, spread, write_result  # noqa: E402

from smsid.control._sensed import measured_truth  # noqa: E402
from smsid.control.gains import gains  # noqa: E402
from smsid.control.pd import ModelBasedController  # noqa: E402
from smsid.control.reduced import ReducedDynamics  # noqa: E402
from smsid.control.robust_term import design_robust_term  # noqa: E402
from smsid.control.trajectory import Reference, trapezoid  # noqa: E402
from smsid.control.weights import weights_from_level  # noqa: E402
from smsid.description import Arm, load_description  # noqa: E402
from smsid.model import build_model  # noqa: E402

CALLS = 200  # per timing


def models() -> dict:
    paper = load_description(ROOT / "urdf" / "paper_sms.toml")
    two = load_description(ROOT / "urdf" / "two_arm_sms.toml")
    seven = two.model_copy(
        update={
            "arm": (Arm(name="arm", robot="panda", fixed=("panda_finger_joint1", "panda_finger_joint2")),)
        }
    )
    found = {"3 joints (the paper's)": paper, "2 arms of 3, 4 wheels": two, "7 joints (panda)": seven}
    return {name: build_model(d) for name, d in found.items()}


def main() -> None:
    functions, processor = {}, {}
    for label, model in models().items():
        dynamics = ReducedDynamics(model)
        n = dynamics.size
        k = gains(n, 4.0, 4.0)
        noise = np.full(n, 1e-5)
        term = design_robust_term(
            k,
            weights_from_level(
                0.05, np.full(n, 1e-3), left_out=1e-4, angle_noise=noise, rate_noise=noise, crossover=10.0
            ),
        )
        reference = Reference(trapezoid(model.joint_angles(model.home)))
        v = np.zeros(model.nv)
        v[3:6], v[model.arm_joints.v], v[model.wheels.v] = 0.01, 0.02, 10.0
        seen = measured_truth(model, model.home, v)
        for kind, robust in (("PD", None), ("PD + H-infinity", term)):
            law = ModelBasedController(dynamics, k, reference, robust=robust, period=0.01)

            processor[f"{label}, {kind}"] = []

            def run(law=law, seen=seen, spent=processor[f"{label}, {kind}"]):
                begin = time.process_time()
                for _ in range(CALLS):
                    law.command(10.0, seen)
                spent.append(time.process_time() - begin)

            functions[f"{label}, {kind}"] = run
    seconds = interleaved(functions, 30)
    result = {
        "environment": environment("pin", "numpy", "smsid"),
        "unit": "microseconds per update, wall clock and processor; share of a 100 Hz period in percent",
        "updates": {
            name: {
                **spread(1e6 * s / CALLS),
                "processor_time": spread(1e6 * np.array(processor[name]) / CALLS),
                "share_percent": float(f"{100.0 * np.median(s) / CALLS / 0.01:.3g}"),
            }
            for name, s in seconds.items()
        },
    }
    print(write_result("controller_time", result))
    for name, row in result["updates"].items():
        print(name, row)


if __name__ == "__main__":
    main()
