"""``smsid campaign``: the command, ready to be registered with a typer application."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from smsid.cli.errors import CommandResult
from smsid.cli.inputs import write_page
from smsid.cli.options import ReportPath, ShowAll
from smsid.cli.output import print_parts, show_progress, warn
from smsid.cli.places import Writes

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.table import Table

    from smsid.campaign.run import Progress
    from smsid.campaign.summary import ParameterSummary, Summary
    from smsid.report import Provenance, Report


def _summary_path(output: Path) -> tuple[Path, ...]:
    from smsid.campaign.run import summary_path

    return (summary_path(output),)


def campaign_command(
    plan: Annotated[Path, typer.Argument(help="plan of the campaign: a TOML")],
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="results, one line per run; an existing file is continued"),
        Writes((".jsonl",), beside=_summary_path, beside_kind="campaign_summary"),
    ] = Path("campaign.jsonl"),
    runs: Annotated[int | None, typer.Option(help="number of runs, instead of the plan's")] = None,
    workers: Annotated[int | None, typer.Option(help="worker processes; default: one per core")] = None,
    backend: Annotated[str, typer.Option(help="loky (local processes), dask, or serial")] = "loky",
    dask: Annotated[str | None, typer.Option(help="address of a dask scheduler, tcp://host:port")] = None,
    retry_failed: Annotated[bool, typer.Option(help="do runs again that ended in an error")] = False,
    level: Annotated[float, typer.Option(help="family-wise level of the bands in the summary")] = 0.01,
    report: ReportPath = None,
    show_all: ShowAll = False,
) -> CommandResult:
    """Run a Monte Carlo campaign; interrupted in any way, the same command goes on where it stopped."""
    from smsid.campaign.run import campaign_main, summary_path
    from smsid.campaign.store import read_store
    from smsid.cli.tables import cut_tables

    how: dict[str, Any] = {"backend": backend, "workers": workers, "dask_address": dask, "runs": runs}
    try:
        with show_progress(f"campaign {plan.stem}") as tell:

            def show(state: Progress) -> None:
                tell(state.done, state.total, f", {state.failed} failed" if state.failed else "")

            summary = campaign_main(
                plan, output, **how, retry_failed=retry_failed, level=level, progress=show
            )
    except KeyboardInterrupt:
        warn(f"finished runs are in {output}; the same command goes on from there")
        raise typer.Abort from None
    header, records = read_store(output)

    def page(origin: Provenance) -> Report:
        from smsid.report.campaign import campaign_report

        return campaign_report(header.plan["name"], summary, list(records), origin)

    made = write_page(report, page, [plan, output], seed=header.plan["seed"])
    written = [output, summary_path(output), *made]
    print_parts(cut_tables(summary_tables(summary), show_all))
    if summary.failed:
        warn(f"{summary.failed} of {summary.runs} runs failed")
    return CommandResult({"summary": json.loads(summary.to_json())}, written)


def summary_tables(summary: Summary) -> Iterator[Table]:
    """Yield the tables of parameters, of figures without truth, and of failures, as far as there are any.

    Of a parameter: ``truth`` (mean over runs, with ``~`` when it varies), mean ``error``, ``spread`` of the
    error, mean ``predicted`` standard deviation, ``ratio`` of the two, ``covered`` share of truths inside
    the 95 % interval. Red: outside the band at the summary's family-wise level. A dash: not evaluated.
    """
    from rich.text import Text

    from smsid.cli.tables import plain_table

    figures = [p for p in summary.parameters if p.truth is None and p.mean_sigma is None and p.runs]
    known = [p for p in summary.parameters if p.truth is not None]
    if known or not summary.runs:
        columns = ("truth", "error", "spread", "predicted", "ratio", "covered", "runs")
        title = f"{summary.runs} runs, {summary.failed} failed"
        table = plain_table("parameter", *columns, title=title, left=("parameter",), fold=True)
        table.caption, table.caption_justify = _calibration_note(summary, len(figures)), "left"
        for p in known:
            varies = p.truth_spread is not None and p.truth_spread > 1e-9 * abs(p.truth or 0.0)
            truth = ("~" if varies else "") + _figure(p.truth, ".5g")
            sizes = (_figure(p.mean_error, ".2g"), _figure(p.spread, ".3g"), _figure(p.mean_sigma, ".3g"))
            tested = ((p.ratio, ".2f", p.ratio_holds), (p.coverage, ".1%", p.coverage_holds))
            judged = (Text(_figure(x, f), "red" if holds is False else "") for x, f, holds in tested)
            table.add_row(Text(_label(p)), truth, *sizes, *judged, _runs(p))
        yield table
    if figures:
        table = plain_table("figure", "mean", "spread", "runs", left=("figure",), fold=True)
        for p in figures:
            table.add_row(Text(_label(p)), _figure(p.mean, ".6g"), _figure(p.spread, ".3g"), _runs(p))
        yield table
    if summary.failures:
        columns = ("error", "runs", "first", "its message")
        table = plain_table(*columns, title="failed runs", left=(columns[0], columns[3]), fold=True)
        table.columns[3].no_wrap, table.columns[3].overflow = False, "fold"
        for f in summary.failures:
            table.add_row(f.type, str(f.count), str(f.run), Text(f.message))
        yield table


def _label(p: ParameterSummary) -> str:
    return f"{p.name} [{p.unit}]" if p.unit else p.name


def _runs(p: ParameterSummary) -> str:
    """Return the runs that have it, and after a minus those that do not."""
    lost = p.missing + p.not_finite
    return f"{p.runs}-{lost}" if lost else f"{p.runs}"


def _calibration_note(summary: Summary, figures: int) -> str:
    """Say where ratio and coverage lie when sigmas and intervals are right; with fewer runs, wider."""
    most = max((p.runs for p in summary.parameters), default=0)
    parts = []
    for name, key, form in (("ratio", "ratio_band", ".2f"), ("covered", "coverage_band", ".1%")):
        bands = [b for p in summary.parameters if p.runs == most and (b := getattr(p, key)) is not None]
        parts += [f"{name} {bands[0][0]:{form}} to {bands[0][1]:{form}}"] if bands else []
    told = f"expected at {summary.level:.2g} family-wise: {', '.join(parts)}; red is outside"
    told = told if parts else "no interval was evaluated"
    hidden = sum(p.truth is None for p in summary.parameters) - figures
    return told + (f"\nnot shown, for want of a truth: {hidden} parameters" if hidden else "")


def _figure(x: float | None, form: str) -> str:
    return "-" if x is None else format(x, form)
