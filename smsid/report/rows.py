"""Rows of a name with a bar, a point with its interval, or several, on one common axis."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from smsid.report.axes import Axis


@dataclass(frozen=True)
class Mark:
    """A point with an interval (``low``, ``high``) on the axis; ``series`` is its place in the legend.

    ``shape``: dot, ring, square or tick; ``tip`` is what a pointer resting on it is told.
    """

    value: float
    low: float | None = None
    high: float | None = None
    series: int = 0
    shape: str = "dot"
    tip: str = ""


@dataclass(frozen=True)
class Bar:
    """A bar from the axis's start, or from ``start``, to ``value``."""

    value: float
    series: int = 0
    start: float | None = None
    tip: str = ""


@dataclass(frozen=True)
class ChartRow:
    """One row: its name, what stands in it, and a value in words at the end; ``band`` is shaded behind."""

    name: str
    items: Sequence[Mark | Bar]
    value: str = ""
    band: tuple[float, float] | None = None
    tone: str = "neutral"


@dataclass(frozen=True)
class RowChart:
    """Rows on one axis. ``legend`` names the series; ``rules`` are values marked across all rows."""

    axis: Axis
    rows: Sequence[ChartRow]
    alt: str
    legend: Sequence[tuple[str, int, str]] = ()
    rules: Sequence[tuple[float, str]] = ()

    def place(self, value: float | None) -> float:
        """Return where a value stands [%], what is beyond the axis at its end."""
        if value is None or math.isnan(value):
            return -1.0
        if self.axis.log and value <= 0.0:
            return 0.0
        return round(100.0 * min(max(float(self.axis.at(value)), 0.0), 1.0), 2)

    def beyond(self, value: float | None) -> str:
        """Return on which side of the axis a value is off: ``low``, ``high`` or nothing."""
        if value is None or math.isnan(value):
            return ""
        return "low" if value < self.axis.low else "high" if value > self.axis.high else ""

    def span(self, low: float | None, high: float | None) -> tuple[float, float]:
        """Return start and width of an interval [%]."""
        a, b = sorted((self.place(low), self.place(high)))
        return a, round(b - a, 2)
