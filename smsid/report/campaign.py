"""The report of ``smsid campaign``: bias, spread, coverage, and how they settled as runs came in."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.stats import binom, norm

from smsid._listing import some_of
from smsid._statistics import NORMAL95
from smsid.campaign.outcome import RunRecord
from smsid.campaign.summary import ParameterSummary, Summary
from smsid.report.axes import Axis
from smsid.report.model import Cell, Figure, Provenance, Report, Section, Table, Tone, cells
from smsid.report.numbers import number, unit
from smsid.report.plot import Band, Curve, Plot, Rule
from smsid.report.rows import Bar, ChartRow, Mark, RowChart


def campaign_report(name: str, summary: Summary, records: Sequence[RunRecord], origin: Provenance) -> Report:
    """Return the report of a campaign, from its summary and its runs."""
    sentence, tone = verdict(summary)
    tested = [p for p in summary.parameters if p.coverage is not None]
    parts = coverage_figures(summary)
    sections = []
    if parts:
        gist = f"bands hold for all at once at {summary.level:g}"
        sections.append(Section("coverage", "Coverage and spread", parts, gist))
    figures = convergence_figures(summary, records)
    if figures:
        sections.append(Section("convergence", "Convergence", figures, f"over {summary.runs} runs"))
    known = [p for p in summary.parameters if p.truth is not None]
    tables = summary_tables(summary)
    if known:
        parts_ = (_errors(known), tables["parameters"])
        sections.append(Section("parameters", "Parameters", parts_, f"{len(known)} with a truth"))
    if "figures" in tables:
        own = (tables["figures"],)
        sections.append(Section("figures", "Figures without a truth", own, open=not known))
    if "failures" in tables:
        sections.append(Section("failures", "Failed runs", (tables["failures"],), f"{summary.failed}"))
    glance = (
        ("runs", str(summary.runs)),
        ("failed", str(summary.failed)),
        ("intervals tested", str(len(tested))),
        ("CPU time", f"{number(summary.seconds, 3)} s"),
    )
    return Report("Monte Carlo campaign", name, sentence, tone, sections, origin, glance)


def verdict(summary: Summary) -> tuple[str, Tone]:
    """Return one sentence on whether a method's intervals hold, and what it is worth."""
    tested = [p for p in summary.parameters if p.coverage_holds is not None]
    runs = f"{summary.runs - summary.failed} of {summary.runs} runs came to a result"
    if not tested:
        return f"{runs}; no interval could be tested.", "neutral"
    out = [p.name for p in tested if not p.coverage_holds]
    off = [p.name for p in summary.parameters if p.ratio_holds is False]
    if not out and not off:
        text = f"The 95 % intervals of all {len(tested)} parameters hold, their spread is as predicted"
        return f"{text}; {runs}.", "good" if not summary.failed else "warn"
    parts = []
    if out:
        parts.append(
            f"the 95 % intervals of {len(out)} of {len(tested)} parameters do not hold ({some_of(out, 3)})"
        )
    if off:
        parts.append(f"the spread of {len(off)} is not as predicted ({some_of(off, 3)})")
    text = " and ".join(parts)
    return f"{text[0].upper()}{text[1:]}; {runs}.", "bad" if out else "warn"


def coverage_figures(summary: Summary) -> list[Figure]:
    """Return how often intervals held and how wide they are, by parameter; none without a tested interval."""
    tested = [p for p in summary.parameters if p.coverage is not None and p.coverage_band is not None]
    if not tested:
        return []
    rows = [
        _verdict_row(p.name, p.coverage, p.coverage_band, p.coverage_holds, f"{100 * p.coverage:.1f} %",
              f"{p.covered} of {p.runs} runs")
        for p in tested if p.coverage is not None
    ]  # fmt: skip
    low = min(min(p.coverage or 0.0, (p.coverage_band or (1.0, 1.0))[0]) for p in tested)
    axis = Axis.over("share of runs whose 95 % interval holds the truth", [[low, 1.0]], room=0.03)
    legend = (("inside the band", 0, "dot"), ("outside", 1, "square"))
    chart = RowChart(axis, rows, "coverage by parameter", legend, ((0.95, "95 %"),))
    caption = "Shaded: where the share lies when intervals hold, for all parameters at once."
    out = [Figure("coverage-chart", "Coverage of the 95 % intervals", chart, caption)]
    ratios = [p for p in summary.parameters if p.ratio is not None and p.ratio_band is not None]
    if ratios:
        rows = [
            _verdict_row(p.name, p.ratio, p.ratio_band, p.ratio_holds, number(p.ratio, 3)) for p in ratios
        ]
        values = [x for p in ratios for x in (p.ratio, *(p.ratio_band or ())) if x]
        axis = Axis.over("spread of the errors / predicted standard deviation", values, log=True)
        alt = "spread relative to prediction by parameter"
        chart = RowChart(axis, rows, alt, legend, ((1.0, "as predicted"),))
        caption = "To the right: intervals are too short; to the left: too long."
        out.append(Figure("ratio-chart", "Spread beside what was predicted", chart, caption))
    return out


def _verdict_row(
    name: str, x: float | None, band: tuple[float, float] | None, holds: bool | None, text: str, tip: str = ""
) -> ChartRow:
    bad = holds is False
    mark = Mark(x or 0.0, series=int(bad), shape="square" if bad else "dot", tip=tip)
    return ChartRow(name, (mark,), text, band, _tone(holds))


def _errors(known: Sequence[ParameterSummary]) -> Figure:
    rows, values = [], []
    for p in known:
        size = abs(p.truth or 0.0)
        if size == 0.0 or p.spread is None or p.mean_error is None:
            continue
        spread, bias = p.spread / size, abs(p.mean_error) / size
        mark = Mark(max(bias, 1e-9), series=1, tip=f"bias {number(bias, 2)}")
        values += [spread, mark.value]
        items = (Bar(spread, 0, tip=f"spread {number(spread, 2)}"), mark)
        rows.append(ChartRow(p.name, items, f"{number(100 * spread, 2)} %"))
    axis = Axis.over("relative to the true value", values or [1e-3, 1.0], log=True)
    legend = (("spread (standard deviation)", 0, "bar"), ("bias (mean error)", 1, "dot"))
    chart = RowChart(axis, rows, "spread and bias of every parameter", legend)
    return Figure("error-chart", "Spread and bias", chart, "Left is better.")


def summary_tables(summary: Summary) -> dict[str, Table]:
    """Return the tables of parameters, of figures without a truth, and of failures, if there are any."""
    known = [p for p in summary.parameters if p.truth is not None]
    found = {"parameters": _table(known)} if known or not summary.runs else {}
    if figures := [p for p in summary.parameters if p.truth is None and p.runs]:
        rows = [cells(p.name, unit(p.unit), (p.mean, 6), (p.spread, 3), p.runs) for p in figures]
        found["figures"] = Table("Figures", ("figure", "unit", "#mean", "#spread", "#runs"), rows)
    if summary.failures:
        rows = [cells(f.type, f.count, f.run, f.message) for f in summary.failures]
        found["failures"] = Table("Errors", ("error", "#runs", "#first", "its message"), rows)
    return found


def _table(known: Sequence[ParameterSummary]) -> Table:
    rows = []
    for p in known:
        known_ = ((x, 5) for x in (p.truth, p.mean_error, p.spread, p.mean_sigma))
        ratio, coverage = _tone(p.ratio_holds), _tone(p.coverage_holds)
        lost = p.missing + p.not_finite
        runs = Cell(f"{p.runs}−{lost}" if lost else str(p.runs), float(p.runs))
        held = cells((p.ratio, 3, ratio), (p.coverage, 4, coverage), runs)
        rows.append((*cells(p.name, unit(p.unit), *known_), *held))
    columns = ("parameter", "unit", "#truth", "#mean error", "#spread", "#predicted σ", "#ratio", "#coverage",
               "#runs")  # fmt: skip
    note = "Truth: the mean over runs where it was varied. Red: outside its band."
    return Table("Every parameter", columns, rows, note)


def _tone(holds: bool | None) -> Tone:
    return "bad" if holds is False else "neutral"


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
    return _running_coverage(errors, worst), _bias(errors, worst), _quantiles(errors)


def _running_coverage(errors: dict[str, tuple[np.ndarray, np.ndarray]], worst: Sequence[str]) -> Figure:
    n = np.arange(1, max(len(errors[k][0]) for k in worst) + 1)
    low, high = binom.ppf([[0.025], [0.975]], n, 0.95) / n
    marks = [Band("95 % band of one parameter", n, low, high, 2), Rule("", 0.95, False, 2)]
    marks += _running_means({k: np.abs(errors[k][1]) < NORMAL95 for k in worst})
    y = Axis.over("covered so far", [[0.5, 1.0]], room=0.02, count=5)
    alt = "running coverage of the parameters farthest off"
    plot = Plot(Axis.over("runs", [[1, n[-1]]], room=0.0), y, marks, alt)
    caption = "The parameters whose coverage ends farthest from 95 %."
    return Figure("running-coverage", "Coverage as runs came in", plot, caption)


def _bias(errors: dict[str, tuple[np.ndarray, np.ndarray]], worst: Sequence[str]) -> Figure:
    n = np.arange(1, max(len(errors[k][0]) for k in worst) + 1)
    edge = NORMAL95 / np.sqrt(n)
    means = _running_means({k: errors[k][1] for k in worst})
    values = [np.array([-1.0, 1.0]), *(c.y[len(c.y) // 10 :] for c in means)]
    y = Axis.over("mean error so far / predicted σ", values, count=5)
    marks = (Band("95 % band without bias", n, -edge, edge, 2), Rule("", 0.0, False, 2), *means)
    alt = "running mean error of the same parameters"
    plot = Plot(Axis.over("runs", [[1, n[-1]]], room=0.0), y, marks, alt)
    return Figure("running-bias", "Bias as runs came in", plot)


def _running_means(series: dict[str, np.ndarray]) -> list[Curve]:
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
