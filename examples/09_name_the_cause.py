# /// script
# dependencies = ["smsid[plot]"]
# ///
"""Hide friction in a simulated flight, ask what the simulation without it gets wrong, and measure the gain.

python examples/09_name_the_cause.py [folder]
"""

import sys
from pathlib import Path

import matplotlib
import numpy as np

from smsid.description import load_description, save_description
from smsid.diagnose import Gain, diagnose, save_diagnosis
from smsid.effects import JointFriction
from smsid.experiments import fly, named_experiment
from smsid.model import build_model
from smsid.paths import urdf_folder

matplotlib.use("Agg")
from matplotlib import pyplot as plt


def draw(gain: Gain, file: Path) -> None:
    """Draw what an open-loop simulation leaves of every channel, over its noise, before and after."""
    figure, axes = plt.subplots(figsize=(8, 4.5), layout="constrained")
    rows = np.arange(len(gain.channels))
    axes.barh(rows - 0.2, [c.given / c.noise for c in gain.channels], 0.4, label="as described")
    axes.barh(rows + 0.2, [c.extended / c.noise for c in gain.channels], 0.4, label="with the cause found")
    axes.axvline(1.0, color="0.4", linewidth=1)
    axes.set_yticks(rows, [c.channel for c in gain.channels])
    axes.set_xscale("log")
    axes.set_xlabel(f"measured minus simulated on {gain.recording}, rms over noise")
    axes.legend()
    figure.savefig(file, dpi=120)


def main(folder: Path) -> None:
    """Fly, diagnose, print and save."""
    described = load_description(urdf_folder() / "paper_sms.toml")
    friction = JointFriction(name="seal", joint="joint2", viscous=0.05)
    world = build_model(described.with_effects(friction))
    flights = []
    for name, role in (("exp2", "estimation"), ("exp2val", "validation")):
        plan = named_experiment(name, world).model_copy(update={"duration": 30.0})
        flights.append(fly(world, plan, np.random.default_rng(len(flights)), role=role).recording)
    found = diagnose(described, flights[:1], validation=flights[1:], rate=10.0)
    print(found.diagnosis.verdict + ":", found.diagnosis.sentence)
    gain = found.diagnosis.gain
    if gain is not None:
        print(f"whitened rms on {gain.recording}: {gain.whitened_given:.2f} -> {gain.whitened_extended:.2f}")
        draw(gain, folder / "gain.png")
    save_diagnosis(found.diagnosis, folder / "diagnosis.json")
    save_description(found.extended, folder / "extended.toml")
    print(f"wrote {folder / 'diagnosis.json'} and {folder / 'extended.toml'}")


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
    target.mkdir(parents=True, exist_ok=True)
    main(target)
