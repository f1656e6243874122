"""Constants of statistics, and a distance."""

from __future__ import annotations

import numpy as np

NORMAL95 = 1.959964
"""Standard deviations about the mean of a Gaussian that hold 95 %."""


def squared_length(shift: np.ndarray, covariance: np.ndarray) -> float:
    """Return the squared length of a shift (d,) in units of a covariance (d, d), of what has a variance."""
    told = np.diag(covariance) > 0.0
    if not told.any():
        return 0.0
    covariance, shift = covariance[np.ix_(told, told)], shift[told]
    sigma = np.sqrt(np.diag(covariance))  # units differ by more than pinv takes for nothing
    return float((shift / sigma) @ np.linalg.pinv(covariance / np.outer(sigma, sigma)) @ (shift / sigma))
