"""``smsid campaign``: the command, ready to be registered with a typer application."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from smsid.cli.errors import Outcome
from smsid.cli.inputs import write_page
from smsid.cli.options import ReportPath, ShowAll
from smsid.cli.output import error_console, is_quiet, print_parts, warn
from smsid.cli.places import Writes

if TYPE_CHECKING:
    from smsid.report import Provenance, Report


def _summary_beside(output: Path) -> tuple[Path, ...]:
    from smsid.campaign.run import summary_path

    return (summary_path(output),)


def campaign_command(
    plan: Annotated[Path, typer.Argument(help="plan of the campaign: a TOML")],
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="results, one line per run; an existing file is continued"),
        Writes((".jsonl",), beside=_summary_beside, beside_kind="campaign_summary"),
    ] = Path("campaign.jsonl"),
    runs: Annotated[int | None, typer.Option(help="number of runs, instead of the plan's")] = None,
    workers: Annotated[int | None, typer.Option(help="worker processes; default: one per core")] = None,
    backend: Annotated[str, typer.Option(help="loky (local processes), dask, or serial")] = "loky",
    dask: Annotated[str | None, typer.Option(help="address of a dask scheduler, tcp://host:port")] = None,
    retry_failed: Annotated[bool, typer.Option(help="do runs again that ended in an error")] = False,
    level: Annotated[float, typer.Option(help="family-wise level of the bands in the summary")] = 0.01,
    report: ReportPath = None,
    show_all: ShowAll = False,
) -> Outcome:
    """Run a Monte Carlo campaign; interrupted in any way, the same command goes on where it stopped."""
    from smsid.campaign.run import campaign_main, summary_path
    from smsid.campaign.store import read_store
    from smsid.campaign.table import summary_tables
    from smsid.cli.tables import cut_tables

    try:
        summary = campaign_main(
            plan,
            output,
            backend=backend,
            workers=workers,
            dask_address=dask,
            retry_failed=retry_failed,
            runs=runs,
            level=level,
            console=None if is_quiet() else error_console(),
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
    return Outcome({"summary": json.loads(summary.to_json())}, written)
