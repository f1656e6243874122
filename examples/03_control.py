# /// script
# dependencies = ["smsid[plot]"]
# ///
"""What identification is worth in control: tune on an estimate, examine, fly the true spacecraft.

python examples/03_control.py [folder]
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib
import numpy as np

from smsid.control.closed_loop import track
from smsid.control.design import DesignRequest, design
from smsid.control.pd import ModelBasedController
from smsid.control.reduced import ReducedDynamics, perturb_bodies
from smsid.control.trajectory import Reference, minimum_jerk
from smsid.description import load_description
from smsid.experiments import fly, named_experiment
from smsid.identify.paper.pipeline import identify
from smsid.model import build_model
from smsid.paths import urdf_folder

matplotlib.use("Agg")
from matplotlib import pyplot as plt

RATE = 20.0  # [Hz] of the controller


def main(folder: Path) -> None:
    description = load_description(urdf_folder() / "paper_sms.toml")
    truth = build_model(description)
    rng = np.random.default_rng(1)
    recordings = [fly(truth, named_experiment(name, truth), rng).recording for name in ("exp1", "exp2")]
    estimate = identify(description, recordings).estimate

    made = design(description, estimate, DesignRequest(gains=None, rate=RATE, samples=200), rng)
    assert made.tuning is not None and made.robustness is not None
    print(f"gains at {made.tuning.attitude:.3g} rad/s (attitude) and {made.tuning.joints:.3g} rad/s (joints)")
    for mode in made.tuning.modes:
        print(f"  keep clear of {mode.name:12s} {mode.low:.4f} to {mode.high:.4f} rad/s")
    r = made.robustness
    print(f"mu {r.mu_lower:.2f} to {r.mu_upper:.2f}; {r.unstable} of {r.samples} sampled plants unstable")

    home = truth.joint_angles(truth.home)
    reference = Reference(minimum_jerk(home, home + 0.2, 20.0))
    wrong = perturb_bodies(ReducedDynamics(truth), 0.20, np.random.default_rng(3))
    figure, (base, joints) = plt.subplots(2, sharex=True, figsize=(8, 5), layout="constrained")
    for name, dynamics in (("identified", made.dynamics), ("20 % off", wrong)):
        law = ModelBasedController(dynamics, made.term.gains, reference, robust=made.term, period=1.0 / RATE)
        run = track(truth, law, rate=RATE, sensors=description.sensor, rng=np.random.default_rng(5))
        print(f"{name:12s} largest errors: base {run.base:.2e} rad, joints {run.joints:.2e} rad")
        base.plot(run.time, 1e6 * np.abs(run.error[:, :3]).max(axis=1), label=name)
        joints.plot(run.time, 1e6 * np.abs(run.error[:, 3:]).max(axis=1))
    base.set_ylabel("base [urad]")
    joints.set_ylabel("joints [urad]")
    joints.set_xlabel("time [s]")
    base.legend(title="tracking error, model of the controller")
    figure.savefig(folder / "control.png", dpi=120)


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
    target.mkdir(parents=True, exist_ok=True)
    main(target)
