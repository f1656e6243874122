"""What seems stuck may rest: a channel that reads in coarse steps repeats itself where nothing moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from smsid.diagnose.sensor_faults import Fault
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.errors import SimulationError
from smsid.estimation.kalman import run_filter
from smsid.estimation.map_estimate import Fit
from smsid.estimation.measurements import Measured

HELD = THRESHOLDS.at_rest


def resting_channels(found: Fit, whole: Measured, faults: Sequence[Fault]) -> list[Fault]:
    """Return the doubtful faults among ``faults`` that are none: the model predicts that the channel rests.

    ``found`` was fitted without their samples, and to some of ``whole`` as they were recorded. The samples of
    each are filtered again, and rest where they fit the motion that all other channels tell.
    """
    return [f for f in faults if f.doubtful and _fits(found, whole, f)]


def _fits(found: Fit, whole: Measured, fault: Fault) -> bool:
    problem = found.problem
    kept = np.searchsorted(whole.times, problem.data.times)
    values = np.where(fault.samples[kept], whole.values[kept], problem.data.values)
    data = replace(problem.data, values=values)
    try:
        run = run_filter(found.point.model(), replace(problem, data=data))
    except SimulationError:
        return False
    more = float((run.innovations**2).sum() - (found.run.innovations**2).sum())
    return more < HELD**2 * (run.samples - found.run.samples)
