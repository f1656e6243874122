"""Constants of statistics."""

NORMAL95 = 1.959964
"""Standard deviations about the mean of a Gaussian that hold 95 %."""
