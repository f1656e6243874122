"""Centre of mass and momentum over a motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.ndimage import uniform_filter1d

from smsid.model.spacecraft import SpacecraftModel
from smsid.view._motion import DrawnMotion
from smsid.view._recorded import slopes

SAMPLED = 200  # frames of a motion that its largest momenta are sought in
NOISY = 0.2  # share of noise in a momentum above which it tells of the sensors and not of the motion


@dataclass(frozen=True)
class Momenta:
    """Of the whole spacecraft, in inertial axes, over N frames.

    ``com`` (N, 3) centre of mass [m]; ``linear`` (N, 3) momentum (7) [N s]; ``angular`` (N, 3) momentum about
    the centre of mass [N m s]. ``linear_scale`` and ``angular_scale`` are the largest sums over the bodies of
    the magnitudes of their momenta: what there would be if nothing cancelled. ``linear_noise`` and
    ``angular_noise`` are the shares of white noise in what is left after averaging: mass times the noise of
    measured rates.
    """

    com: np.ndarray
    linear: np.ndarray
    angular: np.ndarray
    linear_scale: float
    angular_scale: float
    linear_noise: float = 0.0
    angular_noise: float = 0.0

    @property
    def telling(self) -> tuple[bool, bool]:
        """Whether momentum, and angular momentum, are more than the noise of the sensors."""
        return self.linear_noise <= NOISY, self.angular_noise <= NOISY


def momenta(model: SpacecraftModel, motion: DrawnMotion) -> Momenta:
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
    step = float(np.median(np.diff(motion.time))) if count > 1 else 0.0
    width = max(1, round(motion.smoothed / step)) if step > 0.0 else 1
    noise = [_noise_share(x, width) if motion.smoothed > 0.0 else 0.0 for x in (linear, angular)]
    if width > 1:
        linear, angular = (uniform_filter1d(x, width, axis=0, mode="nearest") for x in (linear, angular))
    return Momenta(com, linear, angular, float(largest[0]), float(largest[1]), *noise)


def _noise_share(x: np.ndarray, width: int) -> float:
    """Return the share of white noise in vectors (N, 3) averaged over ``width`` samples, by differences."""
    if len(x) < 8:
        return 0.0
    white = np.sqrt(np.mean(np.diff(x, 3, axis=0) ** 2) / 20.0 / width)
    size = np.sqrt(np.mean(uniform_filter1d(x, width, axis=0, mode="nearest") ** 2))
    return float(white / size) if size > 0.0 else 0.0


def _without_cancelling(model: SpacecraftModel, data: pin.Data) -> np.ndarray:
    """Return the sums (2,) over bodies of |p| and of |h about the centre of mass|."""
    sums = np.zeros(2)
    for j in range(1, model.pin.njoints):
        own = data.oMi[j].act(model.pin.inertias[j] * data.v[j])
        about = own.angular - np.cross(data.com[0], own.linear)
        sums += np.linalg.norm(own.linear), np.linalg.norm(about)
    return sums
