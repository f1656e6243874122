"""A named physical parameter with unit, bounds and prior."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Parameter:
    """One physical parameter.

    ``sigma`` is the standard deviation of the prior, ``None`` when the description states none.
    """

    name: str
    value: float
    unit: str
    lower: float = -math.inf
    upper: float = math.inf
    sigma: float | None = None

    def with_value(self, value: float) -> Parameter:
        """Return the same parameter at another value."""
        return replace(self, value=float(value))

    def prefixed(self, prefix: str) -> Parameter:
        """Return the same parameter named ``<prefix>.<name>``."""
        return replace(self, name=f"{prefix}.{self.name}")
