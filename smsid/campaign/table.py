"""A campaign's summary as tables for the terminal."""

from __future__ import annotations

from collections.abc import Iterator

from rich import box
from rich.table import Table
from rich.text import Text

from smsid.campaign.summary import Band, ParameterSummary, Summary

_COLUMNS = ("truth", "error", "spread", "predicted", "ratio", "covered", "runs")


def summary_tables(summary: Summary) -> Iterator[Table]:
    """Yield the tables of parameters, of figures without truth, and of failures, as far as there are any."""
    if any(p.truth is not None for p in summary.parameters) or not summary.runs:
        yield parameter_table(summary)
    if any(_is_figure(p) for p in summary.parameters):
        yield figure_table(summary)
    if summary.failures:
        table = Table(title="failed runs", title_justify="left", header_style="bold")
        for name in ("error", "runs", "first", "its message"):
            table.add_column(name, overflow="fold", justify="right" if name in ("runs", "first") else "left")
        for failure in summary.failures:
            table.add_row(failure.type, str(failure.count), str(failure.run), Text(failure.message))
        yield table


def parameter_table(summary: Summary) -> Table:
    """Return one row per parameter of known truth.

    ``truth`` (mean over runs, with ``~`` when it varies), mean ``error``, ``spread`` of the error, mean
    ``predicted`` standard deviation, ``ratio`` of the two, ``covered`` share of truths inside the 95 %
    interval. Red: outside the band at the summary's family-wise level. A dash: not evaluated.
    """
    table = Table(
        title=f"{summary.runs} runs, {summary.failed} failed",
        caption=_expected(summary),
        title_justify="left",
        caption_justify="left",
        header_style="bold",
        box=box.SIMPLE_HEAD,
        padding=0,
        pad_edge=False,
    )
    table.add_column("parameter", overflow="fold", min_width=18, max_width=48)
    for name in _COLUMNS:
        table.add_column(name, justify="right", no_wrap=True)
    for p in summary.parameters:
        if p.truth is not None:
            table.add_row(_label(p), *_cells(p))
    return table


def figure_table(summary: Summary) -> Table:
    """Return one row per figure that has neither truth nor predicted standard deviation."""
    table = Table(title="figures", title_justify="left", header_style="bold", box=box.SIMPLE_HEAD)
    table.add_column("figure", overflow="fold", min_width=21, max_width=48)
    for name in ("mean", "spread", "runs"):
        table.add_column(name, justify="right", no_wrap=True)
    for p in summary.parameters:
        if _is_figure(p):
            cells = (_figure(p.mean, ".6g"), _figure(p.spread, ".3g"), _runs(p))
            table.add_row(_label(p), *cells)
    return table


def _is_figure(p: ParameterSummary) -> bool:
    return p.truth is None and p.mean_sigma is None and p.runs > 0


def _cells(p: ParameterSummary) -> list[Text]:
    varies = p.truth_spread is not None and p.truth is not None and p.truth_spread > 1e-9 * abs(p.truth)
    return [
        Text(("~" if varies else "") + _figure(p.truth, ".5g")),
        Text(_figure(p.mean_error, ".2g")),
        Text(_figure(p.spread, ".3g")),
        Text(_figure(p.mean_sigma, ".3g")),
        Text(_figure(p.ratio, ".2f"), style="red" if p.ratio_holds is False else ""),
        Text(_figure(p.coverage, ".1%"), style="red" if p.coverage_holds is False else ""),
        Text(_runs(p)),
    ]


def _label(p: ParameterSummary) -> Text:
    return Text(f"{p.name} [{p.unit}]" if p.unit else p.name)


def _runs(p: ParameterSummary) -> str:
    """Runs that have it, and after a minus those that do not."""
    lost = p.missing + p.not_finite
    return f"{p.runs}-{lost}" if lost else f"{p.runs}"


def _expected(summary: Summary) -> str:
    """Say where ratio and coverage lie when sigmas and intervals are right; with fewer runs, wider."""
    most = [p for p in summary.parameters if p.runs == max(q.runs for q in summary.parameters)]
    ratio: Band | None = next((p.ratio_band for p in most if p.ratio_band), None)
    coverage: Band | None = next((p.coverage_band for p in most if p.coverage_band), None)
    parts = []
    hidden = sum(p.truth is None and not _is_figure(p) for p in summary.parameters)
    if ratio is not None:
        parts.append(f"ratio {ratio[0]:.2f} to {ratio[1]:.2f}")
    if coverage is not None:
        parts.append(f"covered {coverage[0]:.1%} to {coverage[1]:.1%}")
    told = f"expected at {summary.level:.2g} family-wise: {', '.join(parts)}; red is outside"
    told = told if parts else "no interval was evaluated"
    return told + (f"\nnot shown, for want of a truth: {hidden} parameters" if hidden else "")


def _figure(x: float | None, form: str) -> str:
    return "-" if x is None else format(x, form)
