"""Spectra of residuals before and after, relative to white noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.signal import welch
from scipy.stats import chi2

from smsid.report._traces import Trace
from smsid.report.axes import Axis
from smsid.report.model import Figure, Grid
from smsid.report.plot import Band, Curve, Plot, Rule

SEGMENTS = 8
LONGEST = 2048
MOST_POINTS = 220


def spectrum_grid(
    name: str, groups: Mapping[str, Sequence[Trace]], *, labels: tuple[str, str] = ("before", "after")
) -> Grid:
    """Return a spectrum for every group of traces (the components of a channel), pooled.

    Residuals are divided by their noise, so that white noise alone is one at all frequencies.
    """
    figures = []
    for k, (title, traces) in enumerate(groups.items()):
        body = _spectrum(title, traces, labels)
        if body is not None:
            figures.append(Figure(f"{name}-{k}", title, body))
    caption = (
        "Power spectral density of what is left, pooled over components, relative to white noise of the same "
        "channel: the shaded band holds 95 % of the values when nothing but white noise is left."
    )
    return Grid("Spectra of the residuals", figures, caption)


def _spectrum(title: str, traces: Sequence[Trace], labels: tuple[str, str]) -> Plot | None:
    marks: list[Curve | Band | Rule] = []
    after = _pool_spectra(traces, "residual")
    if after is None:
        return None
    f, density, averages = after
    low, high = chi2.ppf([0.025, 0.975], 2 * averages) / (2 * averages)
    ends = np.array([f[0], f[-1]])
    marks.append(Band("", ends, np.full(2, low), np.full(2, high), 2))
    before = _pool_spectra(traces, "before")
    if before is not None:
        marks.append(Curve(labels[0], before[0], before[1], 1, "thin"))
    marks.append(Curve(labels[1], f, density, 0, "line"))
    values = [density, [0.5, 2.0]] + ([before[1]] if before is not None else [])
    x = Axis.over("frequency [Hz]", [f], log=True, room=0.0, count=4)
    y = Axis.over("density / white noise", values, log=True, count=4)
    return Plot(x, y, marks, f"spectrum of the residual of {title}, before and after", 170)


def _pool_spectra(traces: Sequence[Trace], which: str) -> tuple[np.ndarray, np.ndarray, int] | None:
    """Return frequencies, mean density relative to white noise, and how many periodograms were averaged."""
    found, f, averages = [], np.zeros(0), 0
    for t in traces:
        x = getattr(t, which)
        if x is None or not t.sigma or len(x) < 4 * SEGMENTS:
            continue
        x = np.where(np.isfinite(x), x, 0.0) / t.sigma
        rate = 1.0 / float(np.median(np.diff(t.time)))
        size = min(len(x) // SEGMENTS * 2, LONGEST)
        f, density = welch(x, rate, nperseg=size, detrend="constant")
        found.append(density * rate / 2.0)
        averages += max(1, int(11 / 9 * len(x) / size))  # half-overlapping Hann windows
    if not found:
        return None
    mean = np.mean(found, axis=0)[1:-1]
    return *_thin_spectrum(f[1:-1], mean), averages


def _thin_spectrum(f: np.ndarray, density: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Average neighbours that a logarithmic axis would draw on top of each other."""
    edges = np.geomspace(f[0], f[-1] * (1 + 1e-9), MOST_POINTS)
    place = np.searchsorted(edges, f, side="right")
    _, start, count = np.unique(place, return_index=True, return_counts=True)
    return np.add.reduceat(f, start) / count, np.add.reduceat(density, start) / count
