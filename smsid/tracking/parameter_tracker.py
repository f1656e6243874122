"""What every tracker of parameters offers, whatever it estimates them by."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

import numpy as np

from smsid.simulate import Inputs
from smsid.tracking.sample import Sample
from smsid.tracking.sample_buffer import EventLog
from smsid.tracking.update import Update


class ParameterTracker(Protocol):
    """Fed sample by sample, it says what parameters are and how well each is known.

    `smsid.tracking.Tracker` is one by an extended Kalman filter, `smsid.tracking.MomentumTracker` one by
    recursive total least squares.
    """

    log: EventLog

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters (m,)."""
        ...

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the parameters (m,)."""
        ...

    @property
    def time(self) -> float:
        """Time [s] of the last moment taken in; minus infinity before the first."""
        ...

    @property
    def values(self) -> np.ndarray:
        """Values (m,)."""
        ...

    @property
    def sigmas(self) -> np.ndarray:
        """Standard deviations (m,)."""
        ...

    @property
    def parameter_covariance(self) -> np.ndarray:
        """Covariance (m, m), in products of their units."""
        ...

    def update(self, sample: Sample) -> tuple[Update, ...]:
        """Take in a sample; return what the moments told whose time has come."""
        ...

    def update_all(self, samples: Iterable[Sample], inputs: Inputs | None = None) -> tuple[Update, ...]:
        """Take in samples together, and all that waits."""
        ...

    def flush(self, inputs: Inputs | None = None) -> tuple[Update, ...]:
        """Take in all that waits."""
        ...
