"""How a campaign's figures settled as runs came in, and whether its errors are as intervals say."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.stats import binom, norm

from smsid._statistics import NORMAL95
from smsid.campaign.outcome import RunRecord
from smsid.campaign.summary import Summary
from smsid.report.axes import Axis
from smsid.report.model import Figure
from smsid.report.plot import Band, Curve, Plot, Rule

CURVES = 5


def normalised_errors(records: Sequence[RunRecord]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return run numbers (n,) and errors in predicted standard deviations (n,) by parameter, in order."""
    found: dict[str, list[tuple[int, float]]] = {}
    for record in records:
        for o in record.outcomes if record.ok else ():
            if o.truth is not None and o.sigma and math.isfinite(o.value) and math.isfinite(o.sigma):
                found.setdefault(o.name, []).append((record.run, (o.value - o.truth) / o.sigma))
    out = {}
    for name, pairs in found.items():
        table = np.array(sorted(pairs))
        out[name] = table[:, 0], table[:, 1]
    return out


def convergence_figures(summary: Summary, records: Sequence[RunRecord]) -> tuple[Figure, ...]:
    """Return running coverage, running bias and the distribution of errors; nothing below three runs."""
    errors = {k: v for k, v in normalised_errors(records).items() if len(v[0]) > 2}
    if not errors:
        return ()
    # those whose coverage is farthest off are the ones to look at
    worst = sorted(errors, key=lambda k: -abs(np.mean(np.abs(errors[k][1]) < NORMAL95) - 0.95))[:CURVES]
    return _coverage(errors, worst), _bias(errors, worst), _quantiles(errors)


def _coverage(errors: dict[str, tuple[np.ndarray, np.ndarray]], worst: Sequence[str]) -> Figure:
    n = np.arange(1, max(len(errors[k][0]) for k in worst) + 1)
    low, high = binom.ppf([[0.025], [0.975]], n, 0.95) / n
    marks = [Band("95 % band of one parameter", n, low, high, 2), Rule("", 0.95, False, 2)]
    marks += _running({k: np.abs(errors[k][1]) < NORMAL95 for k in worst})
    y = Axis.over("covered so far", [[0.5, 1.0]], room=0.02, count=5)
    alt = "running coverage of the parameters farthest off"
    plot = Plot(Axis.over("runs", [[1, n[-1]]], room=0.0), y, marks, alt)
    caption = "The parameters whose coverage ends farthest from 95 %."
    return Figure("running-coverage", "Coverage as runs came in", plot, caption)


def _bias(errors: dict[str, tuple[np.ndarray, np.ndarray]], worst: Sequence[str]) -> Figure:
    n = np.arange(1, max(len(errors[k][0]) for k in worst) + 1)
    edge = NORMAL95 / np.sqrt(n)
    means = _running({k: errors[k][1] for k in worst})
    values = [np.array([-1.0, 1.0]), *(c.y[len(c.y) // 10 :] for c in means)]
    y = Axis.over("mean error so far / predicted σ", values, count=5)
    marks = (Band("95 % band without bias", n, -edge, edge, 2), Rule("", 0.0, False, 2), *means)
    alt = "running mean error of the same parameters"
    plot = Plot(Axis.over("runs", [[1, n[-1]]], room=0.0), y, marks, alt)
    return Figure("running-bias", "Bias as runs came in", plot)


def _running(series: dict[str, np.ndarray]) -> list[Curve]:
    """Return the mean so far of every series, run after run."""
    return [
        Curve(k, np.arange(1, len(x) + 1), np.cumsum(x) / np.arange(1, len(x) + 1), COLOURS[i], "thin")
        for i, (k, x) in enumerate(series.items())
    ]


def _quantiles(errors: dict[str, tuple[np.ndarray, np.ndarray]]) -> Figure:
    """All errors in predicted standard deviations against the Gaussian's quantiles."""
    z = np.sort(np.concatenate([e for _, e in errors.values()]))
    expected = norm.ppf((np.arange(len(z)) + 0.5) / len(z))
    keep = np.unique(np.concatenate([np.linspace(0, len(z) - 1, 160).astype(int), np.arange(min(12, len(z))),
                                     np.arange(max(0, len(z) - 12), len(z))]))  # fmt: skip
    ends = np.array([min(expected[0], -2.5), max(expected[-1], 2.5)])
    marks = (
        Curve("as predicted", ends, ends, 2, "dash"),
        Curve("all errors", expected[keep], z[keep], 0, "ticks"),
    )
    y = Axis.over("error / predicted σ", [z[keep], ends], within=(-12.0, 12.0))
    alt = "errors in predicted standard deviations against Gaussian quantiles"
    plot = Plot(Axis.over("quantile of the Gaussian", [ends]), y, marks, alt)
    caption = (
        f"{len(z)} errors of {len(errors)} parameters, divided by the standard deviation predicted for each. "
        "On the line: intervals are right. Steeper: too short."
    )
    return Figure("quantiles", "Errors beside their prediction", plot, caption)


COLOURS = (0, 1, 3, 4, 5)
