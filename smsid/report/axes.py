"""Axes: from data to a unit interval, linear or logarithmic, with round ticks."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from smsid.report.numbers import power, tick_label

STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)


@dataclass(frozen=True)
class Axis:
    """An axis from ``low`` to ``high``; ``ticks`` are values with their labels. ``log``: both above zero."""

    label: str
    low: float
    high: float
    log: bool = False
    ticks: tuple[tuple[float, str], ...] = ()

    @classmethod
    def over(
        cls,
        label: str,
        values: Iterable[object],
        *,
        log: bool = False,
        room: float = 0.04,
        count: int = 6,
        within: tuple[float, float] | None = None,
    ) -> Axis:
        """Return an axis over everything finite (above zero on a logarithmic one) in ``values``.

        Where ticks would read the same, they count from a whole number that the label tells. ``room``: share
        left free at either end; ``count``: about how many ticks; ``within``: farthest ends.
        """
        found = np.concatenate([np.ravel(np.asarray(v, dtype=float)) for v in values] or [np.zeros(0)])
        found = found[np.isfinite(found)]
        found = found[found > 0.0] if log else found
        low, high = (
            (float(found.min()), float(found.max())) if len(found) else ((0.1, 10.0) if log else (0.0, 1.0))
        )
        if within is not None:
            low, high = min(max(low, within[0]), within[1]), max(min(high, within[1]), within[0])
        if log:
            a, b = math.log10(low), math.log10(high)
            pad = room * (b - a) if b - a > 1e-9 else 0.5
            low, high = 10.0 ** (a - pad), 10.0 ** (b + pad)
        else:
            pad = room * (high - low) if high > low else max(0.5 * abs(high), 0.5)
            low, high = low - pad, high + pad
        ticks = ticks_of(low, high, log, count)
        if not log and len({text for _, text in ticks}) < len(ticks):  # as stamps since an epoch
            base = math.floor(low)
            ticks = tuple((base + v, text) for v, text in ticks_of(low - base, high - base, count=count))
            label = f"{label}, from {base} on"
        return cls(label, low, high, log, ticks)

    def at(self, values: object) -> np.ndarray:
        """Return where values stand, of the same shape: 0 at the low end, 1 at the high one."""
        x = np.asarray(values, dtype=float)
        if self.log:
            with np.errstate(divide="ignore", invalid="ignore"):
                return np.log10(x / self.low) / math.log10(self.high / self.low)
        return (x - self.low) / (self.high - self.low)

    def placed_ticks(self) -> tuple[tuple[float, str], ...]:
        """Return ticks as percentages of the axis with their labels."""
        return tuple((round(100.0 * float(self.at(v)), 3), label) for v, label in self.ticks)


def ticks_of(low: float, high: float, log: bool = False, count: int = 6) -> tuple[tuple[float, str], ...]:
    """Return round values within an interval with their labels, about ``count`` of them."""
    if log:
        first, last = math.ceil(math.log10(low) - 1e-9), math.floor(math.log10(high) + 1e-9)
        if last - first >= 1:
            every = max(1, math.ceil((last - first + 1) / count))
            return tuple((10.0**e, power(e)) for e in range(first, last + 1, every))
        base = 10.0 ** math.floor(math.log10(low))
        fine = [m * base * f for f in (1.0, 10.0) for m in (1.0, 2.0, 3.0, 5.0, 7.0)]
        return tuple((v, tick_label(v)) for v in fine if low <= v <= high)
    if not high > low:
        return ()
    first, last, step = 0, -1, 1.0
    while last - first < 2:  # three at least
        raw = (high - low) / max(count - 1, 1)
        base = 10.0 ** math.floor(math.log10(raw))
        step = next(s * base for s in STEPS if s * base >= raw * (1.0 - 1e-9))
        first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
        count += 1
    return tuple((k * step, tick_label(round(k * step, 12))) for k in range(first, last + 1))
