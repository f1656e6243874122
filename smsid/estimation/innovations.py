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
