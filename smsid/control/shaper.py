"""Input shapers: impulses whose convolution with a command leaves named modes at rest.

Singer and Seering (1990), ZV and ZVD; Singhose, Seering and Singer (1994), EI: exact for an undamped mode,
here with the damping's decay from impulse to impulse.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from smsid.errors import ControlError

Kind = Literal["zv", "zvd", "ei"]


@dataclass(frozen=True)
class Shaper:
    """Impulses ``amplitudes`` (k,), summing to one, at ``times`` (k,) [s], the first at zero."""

    amplitudes: np.ndarray
    times: np.ndarray

    def residual(self, frequency: float | np.ndarray, damping: float = 0.0) -> np.ndarray:
        """Return the vibration left in a mode over that of one impulse, at frequencies [Hz] of any shape."""
        omega = 2.0 * np.pi * np.asarray(frequency, dtype=float)[..., None]
        decay = damping * omega
        turn = omega * np.sqrt(1.0 - damping**2)
        sums = np.sum(self.amplitudes * np.exp((decay + 1j * turn) * self.times), axis=-1)
        return np.abs(sums) * np.exp(-decay[..., 0] * self.times[-1])


def shaper(
    kind: Kind,
    frequencies: Sequence[float],
    damping: float | Sequence[float] = 0.0,
    *,
    tolerance: float = 0.05,
) -> Shaper:
    """Return the shaper for modes of the given frequencies [Hz] and damping ratios.

    ``zv`` leaves nothing at the frequencies, ``zvd`` nothing and to second order around them, ``ei`` up to
    ``tolerance`` at the frequency, and no more in a wider band around it. Several modes: the shapers
    convolved.

    Raises:
        ControlError: an unknown kind, or frequencies, damping or a tolerance that cannot be.
    """
    f = np.atleast_1d(np.asarray(frequencies, dtype=float))
    if f.size == 0 or not (np.isfinite(f) & (f > 0.0)).all():
        raise ControlError(
            f"A shaper cannot be made for the frequencies {f.tolist()} Hz.", advice="Give positive ones."
        )
    try:
        zeta = np.broadcast_to(np.asarray(damping, dtype=float), f.shape)
    except ValueError as error:
        raise ControlError(f"{np.size(damping)} damping ratios do not fit {f.size} frequencies.") from error
    if not ((zeta >= 0.0) & (zeta < 1.0)).all():
        raise ControlError(
            f"Damping ratios {zeta.tolist()} are not in [0, 1).",
            advice="A mode that does not swing needs no shaper.",
        )
    if not 0.0 < tolerance < 1.0:
        raise ControlError(f"A tolerance of {tolerance} is not between 0 and 1.")
    amplitudes, times = np.ones(1), np.zeros(1)
    for one, ratio in zip(f.tolist(), zeta.tolist(), strict=True):
        a, t = _single(kind, one, ratio, tolerance)
        amplitudes = np.outer(amplitudes, a).ravel()
        times = np.add.outer(times, t).ravel()
    order = np.argsort(times, kind="stable")
    return Shaper(amplitudes[order], times[order])


def _single(kind: str, frequency: float, damping: float, v: float) -> tuple[np.ndarray, np.ndarray]:
    root = np.sqrt(1.0 - damping**2)
    k, half = float(np.exp(-damping * np.pi / root)), 0.5 / (frequency * root)
    weights = {
        "zv": [1.0, k],
        "zvd": [1.0, 2.0 * k, k**2],
        "ei": [(1.0 + v) / 4.0, (1.0 - v) / 2.0 * k, (1.0 + v) / 4.0 * k**2],
    }
    if kind not in weights:
        raise ControlError(f"There is no shaper '{kind}'.", advice=f"Use one of {', '.join(weights)}.")
    amplitudes = np.array(weights[kind])
    return amplitudes / amplitudes.sum(), half * np.arange(len(amplitudes))
