"""Weights of the H-infinity term: what disturbs, what is measured badly, what the model may be off by."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np

from smsid.errors import ControlError

logger = logging.getLogger(__name__)
ROLL_OFF = 4.0
"""Where the weight on the feedback acceleration stops rising, in crossovers, and its size there."""
SLOWEST = 1e-3
"""Decay of the weight on the error relative to its corner: an integrator would not be stable."""


@dataclass(frozen=True)
class DesignWeights:
    """Sizes that the H-infinity design is normalised with, per coordinate (3 + n,) unless said.

    ``disturbance`` d_tot of (45) [rad/s^2]; ``angle_noise`` [rad] and ``rate_noise`` [rad/s] of the measured
    error, in the band of the loop. ``uncertainty`` bounds H^-1 H_hat - I at low frequency (one number); the
    bound rises to one at ``crossover`` [rad/s], where delay and what the model leaves out take over. Below
    ``integral`` [rad/s] the error counts ever more (0: everywhere the same). ``origin`` says where each
    number comes from.

    Raises `ControlError` when a size is not positive or the uncertainty not in [0, 1).
    """

    disturbance: np.ndarray
    angle_noise: np.ndarray
    rate_noise: np.ndarray
    uncertainty: float
    crossover: float
    integral: float = 0.05
    origin: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        n = np.size(self.disturbance)
        for name in ("disturbance", "angle_noise", "rate_noise"):
            value = np.asarray(getattr(self, name), dtype=float)
            if value.shape != (n,) or not (np.isfinite(value) & (value > 0.0)).all():
                raise ControlError(
                    f"`{name}` of shape {value.shape} must be {n} positive numbers.",
                    advice="A design without disturbance or noise is ill-posed: give a small one.",
                    value=value,
                )
            object.__setattr__(self, name, value)
        if not 0.0 <= self.uncertainty < 1.0:
            raise ControlError(
                f"An uncertainty of {self.uncertainty:.3g} is not in [0, 1).",
                advice="With 1 or more not even the sign of the response is known; identify first.",
            )
        if not (0.0 < self.crossover < np.inf and 0.0 <= self.integral < self.crossover):
            raise ControlError(
                f"A crossover of {self.crossover:.3g} rad/s with an integral corner of {self.integral:.3g} "
                "rad/s cannot be met.",
                advice="Both positive and finite, the corner below the crossover.",
            )

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return len(self.disturbance)


def in_band(sigma: float | np.ndarray, rate: float, crossover: float) -> np.ndarray:
    """Return one sigma of white noise, sampled at ``rate`` [Hz], that falls below ``crossover`` [rad/s].

    ``sigma`` of any shape and unit: the noise's density is even up to half the rate (`scipy.signal.welch`).
    """
    return np.asarray(sigma, dtype=float) * np.sqrt(min(1.0, crossover / (np.pi * rate)))


def weights_from_level(
    level: float,
    acceleration: np.ndarray,
    *,
    left_out: float | np.ndarray,
    angle_noise: np.ndarray,
    rate_noise: np.ndarray,
    crossover: float,
    integral: float = 0.05,
    source: str = "stated",
) -> DesignWeights:
    """Return weights for a stated parametric uncertainty.

    A body-wise scaling of masses and inertias within +-level scales H (and every Schur complement of it)
    within the same bounds, so |H^-1 H_hat - I| <= level in the norm of H, and d_u is at most level times the
    wanted acceleration.

    Args:
        level: 0.05 for 5 %.
        acceleration: (3 + n,) largest wanted acceleration of each coordinate [rad/s^2].
        left_out: bound on what slosh, panel and sensors do to the loop, d_d of (45) [rad/s^2], one or
            (3 + n,); see `smsid.control.closed_loop`.
        angle_noise, rate_noise: (3 + n,) in the band of the loop [rad, rad/s]; see `in_band`.
        crossover, integral: see `DesignWeights` [rad/s].
        source: where the level comes from, for ``origin``.

    Raises:
        ControlError: as `DesignWeights`.
    """
    largest = np.abs(np.asarray(acceleration, dtype=float))
    disturbance = level * np.maximum(largest, 0.1 * largest.max(initial=0.0)) + np.asarray(
        left_out, dtype=float
    )
    shares = level * largest.max(initial=0.0), float(np.max(left_out))
    origin = (
        f"uncertainty: {source}, {100 * level:.3g} %",
        f"disturbance: up to {shares[0]:.2e} rad/s^2 from parameters, {shares[1]:.2e} from what is left out",
    )
    logger.info("weights: %s", "; ".join(origin))
    return DesignWeights(
        disturbance, np.asarray(angle_noise), np.asarray(rate_noise), level, crossover, integral, origin
    )
