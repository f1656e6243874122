"""A recording with its sensors' own noise once more: what that moves shows how large errors are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import stdtrit

from smsid._statistics import NORMAL95
from smsid.identify.appendage_modes import PanelModes, panel_modes
from smsid.identify.modes import IdentifiedMode
from smsid.identify.robust import white_sigma
from smsid.recording import Recording
from smsid.recording.attitude import continuous
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
            values = continuous(values)
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


REPLICATES = 8


@dataclass(frozen=True)
class ModeSigma:
    """Standard deviations of frequency [Hz] and damping ratio of one mode; not-a-number when it got lost."""

    frequency: float
    damping: float


def mode_sigmas(
    time: np.ndarray,
    panel: np.ndarray,
    base: np.ndarray,
    found: PanelModes,
    *,
    panel_noise: np.ndarray,
    base_noise: float,
    free_from: float | None,
    rng: np.random.Generator,
    replicates: int = REPLICATES,
) -> tuple[tuple[ModeSigma, ...], tuple[ModeSigma, ...]]:
    """Return standard deviations of the clamped and the coupled modes.

    Noise of the sensors' own level (``panel_noise`` (stations,), ``base_noise`` [m/s^2]) is added once more
    to the measured ``panel`` (N, stations) and ``base`` (N,) accelerations at ``time`` (N,) [s]; where
    estimates answer noise linearly they scatter about the estimate as it does about the truth. With 8
    replicates a standard deviation is itself known to about a quarter: it is widened by what Student's t asks
    for (`smsid.identify.paper.noise_replicates.small_sample_factor`). With no ``replicates`` all are zero.
    """
    highest = 1.5 * max((m.frequency for m in (*found.clamped, *found.coupled)), default=1.0)
    again = [
        panel_modes(
            time,
            panel + panel_noise * rng.normal(size=panel.shape),
            base + base_noise * rng.normal(size=base.shape),
            free_from=free_from,
            highest_frequency=highest,
        )
        for _ in range(replicates)
    ]
    return (
        _spread(found.clamped, [r.clamped for r in again]),
        _spread(found.coupled, [r.coupled for r in again]),
    )


def _spread(
    modes: tuple[IdentifiedMode, ...], again: list[tuple[IdentifiedMode, ...]]
) -> tuple[ModeSigma, ...]:
    if not again:
        return (ModeSigma(0.0, 0.0),) * len(modes)
    out = []
    for mode in modes:
        near = [min(r, key=lambda m: abs(m.frequency - mode.frequency)) for r in again if r]
        near = [m for m in near if abs(m.frequency / mode.frequency - 1.0) < 0.05]
        if 2 * len(near) < len(again):
            out.append(ModeSigma(float("nan"), float("nan")))
            continue
        moved = np.array([(m.frequency - mode.frequency, m.damping - mode.damping) for m in near])
        frequency, damping = small_sample_factor(len(near)) * np.sqrt(np.mean(moved**2, axis=0))
        out.append(ModeSigma(float(frequency), float(damping)))
    return tuple(out)
