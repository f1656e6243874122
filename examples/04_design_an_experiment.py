# /// script
# dependencies = ["smsid[plot]"]
# ///
"""Design a thrust that tells how much the slosh is damped, and draw it beside the paper's.

python examples/04_design_an_experiment.py [folder]
"""

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from smsid.description import load_description
from smsid.design import Limits, design_experiment
from smsid.experiments import Experiment, save_experiment
from smsid.model import build_model
from smsid.model.spacecraft import SpacecraftModel
from smsid.paths import urdf_folder
from smsid.simulate import simulate

DURATION, STROKE = 60.0, 0.5  # [s], [m]


def draw(axes: np.ndarray, model: SpacecraftModel, experiment: Experiment, label: str) -> None:
    """Draw thrust along x and what the slosh mass does."""
    times = np.linspace(0.0, DURATION, 1201)
    motion = simulate(model, experiment.inputs(), DURATION, q0=experiment.start(model))
    slosh = motion.states(times).q[:, model.slosh[0].q]
    assert experiment.force is not None
    thrust = experiment.force.signal()
    axes[0].plot(times, [thrust(t)[0] for t in times], label=label)
    axes[1].plot(times, slosh[:, 0], label=label)


def main(folder: Path) -> None:
    """Design, print, save and draw."""
    description = load_description(urdf_folder() / "paper_sms.toml")
    design = design_experiment(
        description, ["tank.damping.x"], duration=DURATION, limits=Limits(stroke=STROKE), name="designed"
    )
    before, after = 100 * design.relative_before[0], 100 * design.relative[0]
    print(f"b_s along x in {DURATION:g} s: to {after:.0f} % of itself; by the paper's thrust {before:.0f} %")
    for use in design.limits:
        if use.limit is not None and use.value > 0.9 * use.limit:
            print(f"held back by {use}")
    save_experiment(design.experiment, folder / "experiment.toml")

    model = build_model(description)
    figure, axes = plt.subplots(2, 1, sharex=True, figsize=(8, 5), layout="constrained")
    draw(axes, model, design.reference, f"the paper's, as strong: b_s to {before:.0f} %")
    draw(axes, model, design.experiment, f"designed: b_s to {after:.0f} %")
    for sign in (-1.0, 1.0):
        axes[1].axhline(sign * STROKE, color="0.6", linestyle="--")
    axes[0].set_ylabel("thrust along x [N]")
    axes[1].set_ylabel("slosh mass from its rest [m]")
    axes[1].set_xlabel("time [s]")
    axes[0].legend()
    figure.savefig(folder / "design.png", dpi=120)
    print(f"wrote {folder / 'experiment.toml'} and {folder / 'design.png'}")


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
    target.mkdir(parents=True, exist_ok=True)
    main(target)
