"""``smsid campaign``: a Monte Carlo campaign, run or gone on with, and what it says."""

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

    from rich.console import RenderableType

    from smsid.campaign.run import Progress
    from smsid.campaign.summary import Summary


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
    from smsid.report.campaign import campaign_report

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
    name, seed = header.plan["name"], header.plan["seed"]
    made = write_page(
        report, lambda o: campaign_report(name, summary, list(records), o), [plan, output], seed=seed
    )
    written = [output, summary_path(output), *made]
    print_parts(summary_parts(summary, everything=show_all))
    if summary.failed:
        warn(f"{summary.failed} of {summary.runs} runs failed")
    return CommandResult({"summary": json.loads(summary.to_json())}, written)


def summary_parts(summary: Summary, *, everything: bool) -> Iterator[RenderableType]:
    """Yield the tables of a summary, and where ratio and coverage lie when intervals are right.

    Of a parameter: ``truth`` (mean over runs), mean error, spread of the error, ``predicted σ``, ratio of the
    two, coverage of the 95 % interval. Red: outside the band at the summary's family-wise level.
    """
    from smsid.cli.tables import cut_tables, report_table
    from smsid.report.campaign import summary_tables

    yield f"{summary.runs} runs, {summary.failed} failed"
    tables = [report_table(t, everything=everything) for t in summary_tables(summary).values()]
    yield from cut_tables(tables, everything)
    yield _calibration_note(summary)


def _calibration_note(summary: Summary) -> str:
    """Say where ratio and coverage lie when sigmas and intervals are right; with fewer runs, wider."""
    most = max((p.runs for p in summary.parameters), default=0)
    parts = []
    for name, key, form in (("ratio", "ratio_band", ".2f"), ("covered", "coverage_band", ".1%")):
        bands = [b for p in summary.parameters if p.runs == most and (b := getattr(p, key)) is not None]
        parts += [f"{name} {bands[0][0]:{form}} to {bands[0][1]:{form}}"] if bands else []
    told = f"expected at {summary.level:.2g} family-wise: {', '.join(parts)}; red is outside"
    return told if parts else "no interval was evaluated"
