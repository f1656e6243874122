# /// script
# dependencies = ["smsid[data,bags,plot]"]
# ///
"""Tests in the laboratory, on recordings of others: slosh in a tank, close modes of a slab.

Needs SMSID_DATA with the folders antisloshing and cessipy_slab, or the network to download them.

python examples/11_laboratory_tests.py [folder]
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib
import numpy as np
import pinocchio as pin

from smsid.datasets import antisloshing, cessipy_slab
from smsid.identify.estimate import ParameterEstimate
from smsid.lab import ambient_modes, compare_tank_models, cylinder_slosh, tank_test
from smsid.model import build_model

matplotlib.use("Agg")
from matplotlib import pyplot as plt


def show(p: ParameterEstimate) -> None:
    """Print a parameter with its interval."""
    print(f"  {p.name:36s} {p.value:9.4f} +- {1.96 * p.sigma:.4f} {p.unit}")


def tank(axes: plt.Axes) -> None:
    """Water in a cylinder that a robot moves along y: the motion comes from the arm's kinematics."""
    description, log = antisloshing()
    model = build_model(description)
    hand = model.pin.getFrameId("axes_6")
    place = []
    for angles in log["encoder.joint_position"]:
        pin.framesForwardKinematics(model.pin, model.data, model.set_joint_angles(model.home, angles))
        place.append(model.data.oMf[hand].translation[1])
    force = log.time("hand.force"), log["hand.force"][:, 1]
    test = tank_test(force, (log.time("encoder.joint_position"), np.array(place)))
    found = compare_tank_models(test, ("rigid", "slosh"))  # more: see benchmarks/antisloshing.py
    for name, fit in found.fits.items():
        print(f"{name}: {fit.ring_down:.3f} N are left when the container is at rest again")
        axes.plot(test.time, fit.residual, linewidth=0.7, label=name)
    for p in found.fits[found.named].estimate.parameters:
        show(p)
    for note in found.fits[found.named].estimate.notes:
        print(f"  note: {note}")
    frequency, mass = cylinder_slosh(radius=0.049, depth=0.080)
    print(f"theory: {frequency:.3f} Hz, {mass:.3f} kg")


def slab() -> None:
    """Vibration of a slab under people's steps, by a phone."""
    log = cessipy_slab()
    times = log.time()
    rate = (times.size - 1) / (times[-1] - times[0])
    found = ambient_modes(log.resampled(rate)["phone.acceleration"], rate, highest_frequency=24.0)
    for p in found.estimate("slab").parameters:
        show(p)


def main(folder: Path) -> None:
    """Run both, and draw what is left of the tank's force."""
    figure, axes = plt.subplots(figsize=(9, 4), layout="constrained")
    tank(axes)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("measured minus modelled force [N]")
    axes.legend()
    figure.savefig(folder / "tank.png", dpi=120)
    slab()


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
    target.mkdir(parents=True, exist_ok=True)
    main(target)
