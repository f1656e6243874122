"""By how much the angles of a recording are late against its torques: found with all else from the torques.

A drive takes time to give the torque it was told, filters and buses take time to hand on an angle: a torque
signal runs ahead of the motion by a fraction of a millisecond to a few. Pulses show it, and viscous friction
takes it up where nothing else does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from smsid._statistics import NORMAL95
from smsid.arm.smooth_motion import SmoothMotion

EXPECTED = 0.01
"""Standard deviation of the lateness before the torques are looked at [s]."""


@dataclass(frozen=True)
class AngleDelay:
    """``value`` by which angles are late against torques, and its standard deviation ``sigma`` [s]."""

    value: float
    sigma: float


IN_STEP = AngleDelay(0.0, 0.0)


def torque_means(motion: SmoothMotion, starts: np.ndarray, late: float) -> np.ndarray:
    """Return the mean torques (B, nv) [N m | N] of the motion of blocks, which begin at ``starts`` (B,).

    A sample stands for the step around it; a window that is ``late`` [s] earlier holds shares of its first
    and last one. Beyond either end of a stretch its outermost samples stand.
    """
    ends = np.append(starts[1:], len(motion.time))
    out = np.empty((len(starts), motion.torque.shape[1]))
    for first, last in motion.bounds:
        own = (starts >= first) & (starts < last)
        torque = motion.torque[first:last]
        shift = late / motion.step
        more = int(np.ceil(abs(shift))) + 1
        torque = np.concatenate([np.repeat(torque[:1], more, 0), torque, np.repeat(torque[-1:], more, 0)])
        total = np.vstack([np.zeros((1, torque.shape[1])), np.cumsum(torque, axis=0)])
        places = np.arange(len(total)) - more + first
        begin, end = starts[own] - shift, ends[own] - shift
        for k in range(torque.shape[1]):
            area = np.interp(end, places, total[:, k]) - np.interp(begin, places, total[:, k])
            out[own, k] = area / (end - begin)
    return out


def delay_column(motion: SmoothMotion, starts: np.ndarray, predicted: np.ndarray) -> np.ndarray:
    """Return what a torque signal (B, nv) changes by per second that the angles are later [N m/s | N/s].

    ``predicted`` (B, nv) are the torques of the blocks that begin at ``starts`` (B,): what is measured has
    noise.
    """
    at = np.asarray(motion.time)[starts]
    out = np.zeros_like(predicted)
    for first, last in motion.bounds:
        own = np.flatnonzero((starts >= first) & (starts < last))
        if own.size > 1:
            out[own] = np.gradient(predicted[own], at[own], axis=0)
    return out


def delay_note(delay: AngleDelay) -> list[str]:
    """Return a sentence on the lateness, if there is any."""
    if not abs(delay.value) > 3.0 * delay.sigma:
        return []
    ms = f"{1e3 * abs(delay.value):.3g} +- {1e3 * NORMAL95 * delay.sigma:.2g} ms"
    ahead = "ahead of" if delay.value > 0.0 else "behind"
    return [f"the torque signal is {ms} {ahead} the motion: found, and taken into account"]
