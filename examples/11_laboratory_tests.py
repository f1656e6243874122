# /// script
# dependencies = ["smsid[data,bags]"]
# ///
"""Tests in the laboratory, on recordings of others: slosh in a tank, close modes of a slab.

Needs SMSID_DATA with the folders antisloshing and cessipy_slab, or the network to download them.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from smsid.datasets import antisloshing, cessipy_slab
from smsid.identify.estimate import ParameterEstimate
from smsid.lab import ambient_modes, compare_tank_models, cylinder_slosh, tank_test
from smsid.model import build_model


def show(p: ParameterEstimate) -> None:
    """Print a parameter with its interval."""
    print(f"  {p.name:36s} {p.value:9.4f} +- {1.96 * p.sigma:.4f} {p.unit}")


def tank() -> None:
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


def main() -> None:
    """Run both."""
    tank()
    slab()


if __name__ == "__main__":
    main()
