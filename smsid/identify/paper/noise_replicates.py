"""A recording with its sensors' own noise once more: what that moves shows how large errors are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import stdtrit

from smsid._statistics import NORMAL95
from smsid.identify.robust import white_sigma
from smsid.recording import Recording
from smsid.sensing import Sensor


def add_noise_replicate(
    recording: Recording, sensors: tuple[Sensor, ...], rng: np.random.Generator
) -> Recording:
    """Return the recording with as much white noise added as the sensors' channels have already.

    The level is `white_sigma` of the channel itself; for an attitude, of the rotation, the same about all
    axes. Channels that the recording lacks are passed over.
    """
    channels = {}
    for name in [c for s in sensors for c in s.channels if c in recording]:
        own = recording.time(name)
        values = np.asarray(recording[name], dtype=float)
        if name.endswith(".attitude"):
            signs = np.where(np.sum(values[1:] * values[:-1], axis=1) < 0.0, -1.0, 1.0)
            values = values * np.concatenate([[1.0], np.cumprod(signs)])[:, None]
            # each component of a quaternion turns half as far, and there are three angles
            sigma = 2.0 * np.sqrt(np.sum(white_sigma(values) ** 2) / 3.0)
            turn = Rotation.from_rotvec(sigma * rng.standard_normal((len(values), 3)))
            values = (Rotation.from_quat(values) * turn).as_quat()
        else:
            values = values + white_sigma(values) * rng.standard_normal(values.shape)
        channels[name] = (own, values)
    return recording.with_channels(channels)


def small_sample_factor(replicates: int) -> float:
    """Return the factor on a standard deviation that so many replicates gave, for 95 % intervals to hold.

    A Gaussian interval with a standard deviation from ``replicates`` draws holds too rarely (91 % with 8);
    Student's t with as many degrees of freedom says by how much it has to be wider.
    """
    return float(stdtrit(replicates, 0.975) / NORMAL95)


def covariance_of_moves(own: np.ndarray, moves: Sequence[np.ndarray]) -> np.ndarray:
    """Return a covariance (b, b) with the variance and the squared bias that ``moves`` (each (b,)) show.

    ``own`` (b, b) is what is predicted: no variance comes out below it. The mean move scatters by a share of
    the variance itself: that much of its square is no bias.
    """
    if not len(own):
        return own
    x = np.array(moves)
    mean, count = x.mean(axis=0), len(x)
    scatter = x.var(axis=0, ddof=1)
    bias = np.maximum(mean**2 - scatter / count, 0.0)
    seen = scatter * small_sample_factor(count - 1) ** 2
    factor = np.sqrt(np.maximum(np.diag(own), seen) / np.diag(own))
    return own * np.outer(factor, factor) + np.diag(bias)
