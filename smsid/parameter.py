"""A named physical parameter with unit, bounds and prior."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Parameter:
    """One physical parameter.

    ``sigma`` is the standard deviation of the prior, ``None`` when the description states none. Where it
    ``may_vanish``, the other parameters of its effect mean as much at zero.
    """

    name: str
    value: float
    unit: str
    lower: float = -math.inf
    upper: float = math.inf
    sigma: float | None = None
    may_vanish: bool = False
