"""What a tracker tells: what each moment did to its belief, and what it believes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from smsid._short_repr import short_repr
from smsid.kernel.filter_arrays import Record


@short_repr
@dataclass(frozen=True, eq=False)
class Update:
    """What one moment [s] told: parameters (m,) and standard deviations after it, and its innovations.

    ``rows`` name what was read; ``normalised`` are its errors in their own standard deviations,
    ``innovations`` the same decorrelated; both are white with variance one while the model is right.
    `record` is the filter's pass over the ``passed`` seconds since the moment before, which ends with it: of
    ``within``, between two samples; total least squares have none.
    """

    time: float
    values: np.ndarray
    sigmas: np.ndarray
    rows: tuple[str, ...]
    innovations: np.ndarray
    normalised: np.ndarray
    log_likelihood: float
    passed: float = 0.0
    within: tuple[Record, int, int] | None = None

    @property
    def record(self) -> Record | None:
        """What the filter made of it; looked up only where somebody asks."""
        if self.within is None:
            return None
        record, first, last = self.within
        return record if (first, last) == (0, len(record.values) - 1) else record.part(first, last)


@short_repr
@dataclass(frozen=True, eq=False)
class TrackedState:
    """What is believed at a time [s]: q (nq,), v (nv,), unknown inputs (k,), and parameters by name."""

    time: float
    q: np.ndarray
    v: np.ndarray
    unknown_inputs: np.ndarray
    parameters: Mapping[str, float]
