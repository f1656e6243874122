# /// script
# dependencies = ["smsid[data,plot]"]
# ///
"""Identify a real industrial arm, a Staubli TX40, from six seconds of motor torques and predict three more.

Needs SMSID_DATA with a folder staubli_tx40, or the network to download it.

python examples/10_real_arm.py [folder]
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib

from smsid.arm import identify_arm, with_joint_effects
from smsid.datasets import tx40
from smsid.effects import MotorCoupling

matplotlib.use("Agg")
from matplotlib import pyplot as plt


def main(folder: Path) -> None:
    """Print the held-out error of three models, and what the best one found."""
    bare, log = tx40()
    joints = log.labels["joint"]
    train = log.window(0.0, 5.9999).with_role("estimation")
    held = log.window(6.0, 9.0).with_role("validation")
    friction = with_joint_effects(bare, joints, "joint_friction", "motor_inertia", "torque_offset")
    wrist = friction.with_effects(MotorCoupling(name="wrist", joints=("joint_5", "joint_6")))
    figure, axes = plt.subplots(figsize=(9, 4), layout="constrained")
    for label, description in (("rigid links", bare), ("friction and rotors", friction), ("wrist", wrist)):
        found = identify_arm(description, train)
        print(f"{label:20s} held-out relative torque RMSE {found.judge(held).relative:.3f}")
        both = found.compare(held)
        axes.plot(both.time, (both.measured - both.predicted)[:, 1], linewidth=0.7, label=label)
    axes.set_xlabel("time [s], not used in the fit")
    axes.set_ylabel("joint 2, measured minus predicted [N m]")
    axes.legend()
    figure.savefig(folder / "tx40.png", dpi=120)
    for p in found.estimate.parameters:
        if p.status == "identifiable":
            print(f"{p.name[:60]:60s} {p.value:9.4f} +- {1.96 * p.sigma:.4f} {p.unit}")


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
    target.mkdir(parents=True, exist_ok=True)
    main(target)
