"""Centre of mass and momentum over a motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from smsid.model.spacecraft import SpacecraftModel
from smsid.view.motion import Motion
from smsid.view.velocity import slopes

SAMPLED = 200  # frames of a motion that its largest momenta are sought in


@dataclass(frozen=True)
class Momenta:
    """Of the whole spacecraft, in inertial axes, over N frames.

    ``com`` (N, 3) centre of mass [m]; ``linear`` (N, 3) momentum (7) [N s]; ``angular`` (N, 3) momentum about
    the centre of mass [N m s]. ``linear_scale`` and ``angular_scale`` are the largest sums over the bodies of
    the magnitudes of their momenta: what there would be if nothing cancelled.
    """

    com: np.ndarray
    linear: np.ndarray
    angular: np.ndarray
    linear_scale: float
    angular_scale: float


def momenta(model: SpacecraftModel, motion: Motion) -> Momenta:
    """Return centre of mass and momenta; velocities that are not known are differentiated from q."""
    v = slopes(model, motion.time, motion.q) if motion.v is None else motion.v
    data, count = model.pin.createData(), len(motion.q)
    com, linear, angular = (np.empty((count, 3)) for _ in range(3))
    sampled = set(np.unique(np.linspace(0, count - 1, SAMPLED).astype(int)).tolist())
    largest = np.zeros(2)
    for i, (q, rates) in enumerate(zip(motion.q, v, strict=True)):
        h = pin.computeCentroidalMomentum(model.pin, data, q, rates)
        com[i], linear[i], angular[i] = data.com[0], h.linear, h.angular
        if i in sampled:
            largest = np.maximum(largest, _without_cancelling(model, data))
    return Momenta(com, linear, angular, float(largest[0]), float(largest[1]))


def _without_cancelling(model: SpacecraftModel, data: pin.Data) -> np.ndarray:
    """Return the sums (2,) over bodies of |p| and of |h about the centre of mass|."""
    sums = np.zeros(2)
    for j in range(1, model.pin.njoints):
        own = data.oMi[j].act(model.pin.inertias[j] * data.v[j])
        about = own.angular - np.cross(data.com[0], own.linear)
        sums += np.linalg.norm(own.linear), np.linalg.norm(about)
    return sums
