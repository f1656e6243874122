"""Is a recording of this spacecraft at all? How much of the motion a model leaves when it runs by itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from smsid.diagnose.thresholds import THRESHOLDS
from smsid.errors import SimulationError
from smsid.estimation.kalman import run_filter
from smsid.estimation.map_estimate import Fit

SETTLE = 5.0  # [s] corrected before the model runs by itself
MOVES = THRESHOLDS.moves
QUANTITIES = ("joint_velocity", "angular_rate", "velocity")


def motion_left(fit: Fit, noise: dict[str, float]) -> float:
    """Return the share of the motion that a model does not follow, open loop: the median of all rates.

    ``noise`` are noise levels over the stated ones by channel, as the fit has them. Not a number where
    nothing moves, or where the model runs away.
    """
    problem, data = fit.problem, fit.problem.data
    until = float(data.times[0]) + SETTLE
    here = replace(problem, data=data.with_blocks(fit.point.sensors()))
    try:
        run = run_filter(fit.point.model(), here, until=until)
    except SimulationError:  # it runs away by itself: that says nothing of what it follows when corrected
        return float("nan")
    later = data.times > until
    left: list[float] = []
    for block in data.blocks:
        if block.quantity not in QUANTITIES or not later.any():
            continue
        moved = np.nanstd(data.values[later, block.rows], axis=0)
        off = np.sqrt(np.nanmean(run.errors[later, block.rows] ** 2, axis=0))
        stated = data.sigma[block.rows] / noise[block.channel]
        left += [o / m for o, m, s in zip(off, moved, stated, strict=True) if m > MOVES * s]
    return float(np.median(left)) if left else float("nan")
