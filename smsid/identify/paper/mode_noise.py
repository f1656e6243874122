"""How far sensor noise moves identified modes: identified again with more of the same noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from smsid.identify.appendage_modes import PanelModes, panel_modes
from smsid.identify.modes import Mode
from smsid.identify.paper.noise_replicates import small_sample_factor

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


def _spread(modes: tuple[Mode, ...], again: list[tuple[Mode, ...]]) -> tuple[ModeSigma, ...]:
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
