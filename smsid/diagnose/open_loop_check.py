"""Is a recording of this spacecraft at all? How much of the motion a model leaves when it runs by itself."""

from __future__ import annotations

import numpy as np

from smsid.diagnose.thresholds import THRESHOLDS
from smsid.errors import SimulationError
from smsid.estimation.joint_problem import at_point
from smsid.estimation.kalman import run_filter
from smsid.estimation.map_estimate import Fit
from smsid.estimation.problem import recordings_of

SETTLE = 5.0  # [s] corrected before the model runs by itself
MOVES = THRESHOLDS.moves
QUANTITIES = ("joint_velocity", "angular_rate", "velocity")


def unexplained_fraction(fit: Fit, noise: dict[str, float]) -> float:
    """Return the share of the motion that a model does not follow, open loop: the median of all rates.

    ``noise`` are noise levels over the stated ones by channel, as the fit has them. Not a number where
    nothing moves, or where the model runs away.
    """
    left: list[float] = []
    model = fit.point.model()
    here = at_point(fit.point, fit.problem)
    models = [part.model or model for part in here.parts] or [model]
    for own, problem in zip(models, recordings_of(here), strict=True):
        data = problem.data
        until = float(data.times[0]) + SETTLE
        try:
            run = run_filter(own, problem, until=until)
        except SimulationError:  # it runs away by itself: that says nothing of what it follows when corrected
            return float("nan")
        later = data.times > until
        for block in data.blocks:
            values = data.values[later, block.rows]
            if block.quantity not in QUANTITIES or not np.isfinite(values).any(axis=0).all():
                continue
            moved = np.nanstd(values, axis=0)
            off = np.sqrt(np.nanmean(run.errors[later, block.rows] ** 2, axis=0))
            stated = data.sigma[block.rows] / noise[block.channel]
            left += [o / m for o, m, s in zip(off, moved, stated, strict=True) if m > MOVES * s]
    return float(np.median(left)) if left else float("nan")
