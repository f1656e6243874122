"""Long records to zoom into: measured, simulated and residual, thinned to extremes of each stretch."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid._short_repr import short_repr
from smsid.report.axes import Axis
from smsid.report.numbers import unit
from smsid.report.plot import Band, Curve, Plot

BUDGET = 250_000  # stretches kept in all series of a figure together
LEVELS = 32766  # of a sixteen-bit number; -32768 stands for none
FEWEST = 200
FIRST = 1200  # points of the drawing that is there before any script runs


@short_repr
@dataclass(frozen=True)
class Trace:
    """One component: ``measured``, ``simulated`` and ``residual`` (N,) at ``time`` (N,) [s].

    ``sigma`` is the standard deviation of its noise; ``before`` (N,) is the residual of the model before,
    if any. A channel may have no simulation of its own.
    """

    name: str
    unit: str
    time: np.ndarray
    measured: np.ndarray
    simulated: np.ndarray | None
    residual: np.ndarray | None
    sigma: float | None = None
    before: np.ndarray | None = None

    def alone(self) -> Trace:
        """Return it without the residual of the model before."""
        return replace(self, before=None)

    @property
    def whitened_rms(self) -> float:
        """Root mean square of the residual in standard deviations of its noise."""
        if self.residual is None or not self.sigma:
            return float("nan")
        return float(np.sqrt(np.nanmean((self.residual / self.sigma) ** 2)))


@short_repr
@dataclass(frozen=True)
class Traces:
    """Traces to choose from, the one at ``first`` shown at once. ``labels`` name what is drawn.

    ``along`` names the axis they run along.
    """

    traces: Sequence[Trace]
    alt: str
    first: int = 0
    labels: tuple[str, str, str, str] = ("measured", "simulated", "residual", "residual before")
    band: str = "± 2 σ of the noise"
    along: str = "time [s]"
    budget: int = BUDGET

    @property
    def upper(self) -> Plot:
        """The trace shown at first, measured and simulated."""
        t = self.traces[self.first]
        x, (m, s) = _thin_series(t.time, (t.measured, t.simulated), FIRST)
        drawn = m if m is not None else np.full(len(x), np.nan)
        curves = [Curve(self.labels[0], x, drawn, 2, "line")]
        if s is not None:
            curves.append(Curve(self.labels[1], x, s, 0, "thin"))
        y = Axis.over(_axis(t, "value"), [c.y for c in curves], count=5)
        return Plot(Axis.over(self.along, [t.time], room=0.0, count=7), y, curves, self.alt, 220)

    @property
    def lower(self) -> Plot | None:
        """Its residual with the band of two standard deviations of the noise."""
        t = self.traces[self.first]
        if t.residual is None:
            return None
        x, (r, b) = _thin_series(t.time, (t.residual, t.before), FIRST)
        width = 2.0 * (t.sigma or 0.0)
        marks: list[Curve | Band] = []
        if t.sigma:
            edge = np.array([t.time[0], t.time[-1]])
            marks.append(Band(self.band, edge, np.full(2, -width), np.full(2, width), 0))
        if b is not None:
            marks.append(Curve(self.labels[3], x, b, 1, "thin"))
        if r is not None:
            marks.append(Curve(self.labels[2], x, r, 0, "thin"))
        shown = [x for x in (r, b) if x is not None]
        axis = Axis.over(_axis(t, self.labels[2]), [*shown, [-width, width]], count=4)
        return Plot(Axis.over(self.along, [t.time], room=0.0, count=7), axis, marks, self.alt, 150)

    def data(self) -> str:
        """Return everything that zooming needs as JSON without any ``<``."""
        kept = sum(1 + (t.simulated is not None) + (t.residual is not None) + (t.before is not None)
                   for t in self.traces)  # fmt: skip
        most = max(FEWEST, self.budget // max(kept, 1))
        clocks: list[np.ndarray] = []
        packed: list[str] = []
        series = []
        for t in self.traces:
            place = next((i for i, c in enumerate(clocks) if c is t.time or np.array_equal(c, t.time)), None)
            if place is None:
                place = len(clocks)
                clocks.append(t.time)
                packed.append(_floats(t.time[_starts(len(t.time), most)]))
            entry: dict[str, object] = {"name": t.name, "unit": unit(t.unit), "clock": place}
            entry |= {"sigma": t.sigma, "end": float(t.time[-1])}
            for key, values in zip("mspb", (t.measured, t.simulated, t.residual, t.before), strict=True):
                if values is not None:
                    entry[key] = _pack_series(values, most)
            series.append(entry)
        document = {"clocks": packed, "series": series, "labels": list(self.labels), "first": self.first}
        return json.dumps(document, separators=(",", ":")).replace("<", "\\u003c")


def spark(values: np.ndarray) -> str:
    """Return the path of a small curve (N,) in a box of 100 by 24: least and largest of each stretch."""
    x = np.asarray(values, dtype=float)
    x = x[np.isfinite(x)]
    if len(x) < 2:
        return ""
    parts = np.array_split(x, min(60, len(x)))
    size = max(float(np.abs(x).max()), 1e-300)
    out = []
    for i, p in enumerate(parts):
        at = 100.0 * (i + 0.5) / len(parts)
        top, bottom = 12.0 - 11.0 * float(p.max()) / size, 12.0 - 11.0 * float(p.min()) / size
        out.append(f"{'L' if out else 'M'}{at:.1f} {top:.1f}L{at:.1f} {bottom:.1f}")
    return "".join(out)


def rotation_vectors(samples: np.ndarray, error: np.ndarray | None = None) -> np.ndarray:
    """Return attitudes as rotation vectors (N, 3) [rad] from the first.

    ``samples`` (N, 4) are the attitudes, ``error`` (N, 3) [rad] is taken off them.
    """
    from scipy.spatial.transform import Rotation  # takes time to load: tables alone do without

    there = np.isfinite(samples).all(axis=1)
    turned = Rotation.from_quat(samples[there])
    out = np.full((len(samples), 3), np.nan)
    off = np.zeros((len(turned), 3)) if error is None else np.nan_to_num(error[there])
    out[there] = (turned[0].inv() * turned * Rotation.from_rotvec(-off)).as_rotvec()
    return out


def _axis(t: Trace, what: str) -> str:
    return f"{what} [{unit(t.unit)}]" if unit(t.unit) else what


def _starts(n: int, most: int) -> np.ndarray:
    """First sample of every stretch."""
    return np.linspace(0, n, min(n, most) + 1).astype(int)[:-1]


def _extremes(values: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest value of every stretch (k,); not-a-number where there is none."""
    x = np.asarray(values, dtype=float)
    starts = _starts(len(x), most)
    low = np.minimum.reduceat(np.where(np.isfinite(x), x, np.inf), starts)
    high = np.maximum.reduceat(np.where(np.isfinite(x), x, -np.inf), starts)
    low[~np.isfinite(low)] = high[~np.isfinite(high)] = np.nan
    return low, high


def _thin_series(
    time: np.ndarray, series: Sequence[np.ndarray | None], most: int
) -> tuple[np.ndarray, list[np.ndarray | None]]:
    """Return times and series with least and largest of each stretch in turn, for a first drawing."""
    if len(time) <= most:
        return time, list(series)
    x = np.repeat(time[_starts(len(time), most // 2)], 2)
    return x, [None if s is None else np.column_stack(_extremes(s, most // 2)).ravel() for s in series]


def _pack_series(values: np.ndarray, most: int) -> dict[str, object]:
    """Sixteen bits a value over the series's own span: to 2e-5 of it."""
    low, high = _extremes(values, most)
    found = np.isfinite(low)
    least = float(low[found].min()) if found.any() else 0.0
    span = (float(high[found].max()) - least if found.any() else 0.0) or 1.0

    def code(x: np.ndarray) -> str:
        steps = np.full(len(x), -32768, dtype="<i2")
        steps[found] = np.round((x[found] - least) / span * 2 * LEVELS - LEVELS).astype("<i2")
        return base64.b64encode(steps.tobytes()).decode("ascii")

    out: dict[str, object] = {"low": least, "span": span, "a": code(low)}
    if len(values) > most:
        out["b"] = code(high)
    return out


def _floats(x: np.ndarray) -> str:
    return base64.b64encode(np.asarray(x, dtype="<f4").tobytes()).decode("ascii")
