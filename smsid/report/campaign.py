"""The report of ``smsid campaign``: bias, spread, coverage, and how they settled as runs came in."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from smsid._listing import some_of
from smsid.campaign.outcome import RunRecord
from smsid.campaign.summary import ParameterSummary, Summary
from smsid.report.axes import Axis
from smsid.report.convergence import convergence_figures
from smsid.report.model import Cell, Figure, Provenance, Report, Section, Table, Text, Tone
from smsid.report.numbers import number, unit
from smsid.report.rows import Bar, Mark, Row, RowChart


def campaign_report(name: str, summary: Summary, records: Sequence[RunRecord], origin: Provenance) -> Report:
    """Return the report of a campaign, from its summary and its runs."""
    sentence, tone = verdict(summary)
    tested = [p for p in summary.parameters if p.coverage is not None]
    parts = _coverage(summary, tested)
    sections = []
    if parts:
        gist = f"bands hold for all at once at {summary.level:g}"
        sections.append(Section("coverage", "Coverage and spread", parts, gist))
    figures = convergence_figures(summary, records)
    if figures:
        sections.append(Section("convergence", "Convergence", figures, f"over {summary.runs} runs"))
    known = [p for p in summary.parameters if p.truth is not None]
    if known:
        parts_ = (_errors(known), _table(known))
        sections.append(Section("parameters", "Parameters", parts_, f"{len(known)} with a truth"))
    figures_ = [p for p in summary.parameters if p.truth is None and p.runs]
    if figures_:
        sections.append(Section("figures", "Figures without a truth", (_figures(figures_),), open=not known))
    if summary.failures:
        sections.append(Section("failures", "Failed runs", (_failures(summary),), f"{summary.failed}"))
    glance = (
        ("runs", str(summary.runs)),
        ("failed", str(summary.failed)),
        ("intervals tested", str(len(tested))),
        ("CPU time", f"{number(summary.seconds, 3)} s"),
    )
    return Report("Monte Carlo campaign", name, sentence, tone, tuple(sections), origin, glance)


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


def _coverage(summary: Summary, tested: Sequence[ParameterSummary]) -> tuple[Figure | Text, ...]:
    if not tested:
        return ()
    rows = []
    for p in tested:
        assert p.coverage is not None
        holds = p.coverage_holds is not False
        mark = Mark(
            p.coverage,
            series=0 if holds else 1,
            shape="dot" if holds else "square",
            tip=f"{p.covered} of {p.runs} runs",
        )
        tone: Tone = "neutral" if holds else "bad"
        rows.append(Row(p.name, (mark,), f"{100 * p.coverage:.1f} %", p.coverage_band, tone))
    low = min(min(p.coverage or 0.0, (p.coverage_band or (1.0, 1.0))[0]) for p in tested)
    axis = Axis.over("share of runs whose 95 % interval holds the truth", [[low, 1.0]], room=0.03)
    legend = (("inside the band", 0, "dot"), ("outside", 1, "square"))
    coverage = RowChart(axis, tuple(rows), "coverage by parameter", legend, ((0.95, "95 %"),))
    out: list[Figure | Text] = [
        Figure(
            "coverage-chart",
            "Coverage of the 95 % intervals",
            coverage,
            "Shaded: where the share lies when intervals hold, for all parameters at once.",
        )
    ]
    ratios = [p for p in summary.parameters if p.ratio is not None and p.ratio_band is not None]
    if ratios:
        rows = []
        for p in ratios:
            assert p.ratio is not None and p.ratio_band is not None
            holds = p.ratio_holds is not False
            mark = Mark(p.ratio, series=0 if holds else 1, shape="dot" if holds else "square")
            rows.append(Row(p.name, (mark,), number(p.ratio, 3), p.ratio_band, "neutral" if holds else "bad"))
        values = [x for p in ratios for x in (p.ratio, *(p.ratio_band or ())) if x]
        chart = RowChart(
            Axis.over("spread of the errors / predicted standard deviation", values, log=True),
            tuple(rows),
            "spread relative to prediction by parameter",
            legend,
            ((1.0, "as predicted"),),
        )
        out.append(
            Figure(
                "ratio-chart",
                "Spread beside what was predicted",
                chart,
                "To the right: intervals are too short; to the left: too long.",
            )
        )
    return tuple(out)


def _errors(known: Sequence[ParameterSummary]) -> Figure:
    rows, values = [], []
    for p in known:
        size = abs(p.truth or 0.0)
        if size == 0.0 or p.spread is None or p.mean_error is None:
            continue
        spread, bias = p.spread / size, abs(p.mean_error) / size
        items: list[Bar | Mark] = [Bar(spread, 0, tip=f"spread {number(spread, 2)}")]
        items.append(Mark(max(bias, 1e-9), series=1, tip=f"bias {number(bias, 2)}"))
        values += [spread, max(bias, 1e-9)]
        rows.append(Row(p.name, tuple(items), f"{number(100 * spread, 2)} %"))
    chart = RowChart(
        Axis.over("relative to the true value", values or [1e-3, 1.0], log=True),
        tuple(rows),
        "spread and bias of every parameter",
        (("spread (standard deviation)", 0, "bar"), ("bias (mean error)", 1, "dot")),
    )
    return Figure("error-chart", "Spread and bias", chart, "Left is better.")


def _table(known: Sequence[ParameterSummary]) -> Table:
    rows = []
    for p in known:
        cells = [Cell(p.name), Cell(unit(p.unit))]
        cells += [_cell(x, 5) for x in (p.truth, p.mean_error, p.spread, p.mean_sigma)]
        bad: Tone = "bad"
        cells.append(_cell(p.ratio, 3, bad if p.ratio_holds is False else "neutral"))
        cells.append(_cell(p.coverage, 4, bad if p.coverage_holds is False else "neutral"))
        lost = p.missing + p.not_finite
        cells.append(Cell(f"{p.runs}−{lost}" if lost else str(p.runs), float(p.runs)))
        rows.append(tuple(cells))
    columns = (
        "parameter",
        "unit",
        "#truth",
        "#mean error",
        "#spread",
        "#predicted σ",
        "#ratio",
        "#coverage",
        "#runs",
    )
    note = "Truth: the mean over runs where it was varied. Red: outside its band."
    return Table("Every parameter", columns, tuple(rows), note)


def _figures(found: Sequence[ParameterSummary]) -> Table:
    rows = tuple(
        (
            Cell(p.name),
            Cell(unit(p.unit)),
            _cell(p.mean, 6),
            _cell(p.spread, 3),
            Cell(str(p.runs), float(p.runs)),
        )
        for p in found
    )
    return Table("Figures", ("figure", "unit", "#mean", "#spread", "#runs"), rows)


def _failures(summary: Summary) -> Table:
    rows = tuple(
        (Cell(f.type), Cell(str(f.count), float(f.count)), Cell(str(f.run), float(f.run)), Cell(f.message))
        for f in summary.failures
    )
    return Table("Errors", ("error", "#runs", "#first", "its message"), rows)


def _cell(x: float | None, digits: int, tone: Tone = "neutral") -> Cell:
    known = x is not None and math.isfinite(x)
    return Cell(number(x, digits), float(np.float64(x)) if known and x is not None else None, tone)
