"""What slosh, panel and sensors do to the loop: d_d of (45), as a bound the weights can use."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from smsid.control.closed_loop import Tracking, track
from smsid.control.gains import Gains
from smsid.control.pd import ModelBasedController
from smsid.control.reduced import ReducedDynamics
from smsid.control.trajectory import Motion
from smsid.control.weights import in_band
from smsid.errors import ControlError
from smsid.model.spacecraft import SpacecraftModel
from smsid.sensing.sensor import Sensor


def disturbance(run: Tracking, gains: Gains) -> np.ndarray:
    """Return d_tot = dde + K_D de + K_P e (N, 3 + n) [rad/s^2] of a run, (45); dde by central differences."""
    second = np.gradient(run.error_rate, run.time, axis=0)
    return second + run.error_rate @ gains.derivative + run.error @ gains.proportional


def left_out(model: SpacecraftModel, gains: Gains, reference: Motion, *, rate: float = 100.0) -> np.ndarray:
    """Return the bound (3 + n,) [rad/s^2] on what slosh and panel do along a reference: the largest |d_d|.

    The complete spacecraft flies the reference under PD with its own parameters and exact measurements, so
    all that is left of (45) is d_d (and the hold of the sampled torques, which the loop sees as well).
    """
    run = track(
        model, ModelBasedController(ReducedDynamics(model), gains, reference), rate=rate, limits=False
    )
    return np.abs(disturbance(run, gains)).max(axis=0)


def sensor_noise(
    sensors: Sequence[Sensor], joints: int, rate: float, crossover: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return one sigma of noise on angles and rates, (3 + n,) each [rad, rad/s], in the band of the loop.

    As `sensor_sigma`, sampled at ``rate`` [Hz], below ``crossover`` [rad/s].
    """
    angle, speed = sensor_sigma(sensors, joints)
    return in_band(angle, rate, crossover), in_band(speed, rate, crossover)


def sensor_sigma(sensors: Sequence[Sensor], joints: int) -> tuple[np.ndarray, np.ndarray]:
    """Return one sigma of a sample's noise on angles and rates, (3 + n,) each [rad, rad/s].

    White noise of the first sensor that measures the quantity; biases are no noise and not counted. Raises
    `ControlError` when a quantity is not measured, or without noise.
    """
    sizes = {"attitude": 3, "joint_position": joints, "angular_rate": 3, "joint_velocity": joints}
    sigma = {}
    for quantity, size in sizes.items():
        owner = next((s for s in sensors if quantity in s.quantities), None)
        if owner is None:
            raise ControlError(
                f"No sensor measures {quantity.replace('_', ' ')}, so its noise is not known.",
                advice="Add a sensor to the description.",
            )
        sigma[quantity] = np.broadcast_to(owner.error(quantity).white_sigma(owner.rate), size)
        if not (sigma[quantity] > 0.0).all():
            raise ControlError(
                f"No noise is stated of {quantity.replace('_', ' ')}, measured by '{owner.name}'; a design "
                "without noise is ill-posed.",
                advice=f"State it in the description: errors.{quantity} = {{ noise_sigma = ... }}, or let "
                "another sensor measure it.",
                sensor=owner.name,
            )
    return (
        np.concatenate([sigma["attitude"], sigma["joint_position"]]),
        np.concatenate([sigma["angular_rate"], sigma["joint_velocity"]]),
    )
