"""What the innovations of a filter say of a fit: their size and whether they are white."""

from __future__ import annotations

import numpy as np

from smsid.estimation.filter_run import FilterRun


def normalised_rmse(run: FilterRun, factors: np.ndarray | float = 1.0) -> float:
    """Return the root mean square of the prediction errors over their noise, outliers left out.

    ``factors`` (rows,) on the noise, or one for all.
    """
    x = np.where(run.used, run.normalised * factors, np.nan)
    return float(np.sqrt(np.nanmean(np.minimum(x**2, np.nanquantile(x**2, 0.99)))))


def squared_distance(run: FilterRun, other: FilterRun) -> float:
    """Return the largest share that the accelerations of two runs differ by, in squares; 1 at least where
    they are of other coordinates.
    """
    one, two = run.states.a, other.states.a
    if one.shape != two.shape:
        return 1.0
    size = np.square(one).mean(axis=0)
    return float((np.square(two - one).mean(axis=0) / np.where(size > 0.0, size, np.inf)).max(initial=0.0))
