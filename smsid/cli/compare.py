"""``smsid compare``: what changed between two estimates."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from smsid.cli.errors import CommandResult
from smsid.cli.inputs import write_page
from smsid.cli.options import Output, ReportPath, ShowAll
from smsid.cli.output import print_parts, show_spinner
from smsid.cli.places import Writes

if TYPE_CHECKING:
    from smsid.comparison import Comparison

MASS_PROPERTIES = ("mass", "centre", "central_inertia")  # of a body that are shown at once
ROWS, LINES = 20, 8  # parameters and findings shown, unless everything is asked for


def compare_command(
    estimate: Annotated[Path, typer.Argument(help="estimate before (JSON of `smsid identify`)")],
    second: Annotated[Path, typer.Argument(help="estimate after, of the same spacecraft")],
    output: Annotated[Output, Writes((".json",), kind="comparison")] = Path("comparison.json"),
    description: Annotated[
        Path | None,
        typer.Option(help="what both were identified from: knows which effect is a tank, a panel, friction"),
    ] = None,
    show_all: ShowAll = False,
    report: ReportPath = None,
) -> CommandResult:
    """Tell what changed between two estimates: a body grasped, fuel used, a panel softened."""
    from smsid.comparison import compare, save_comparison
    from smsid.description import load_description
    from smsid.identify.estimate import load_estimate
    from smsid.report.compare import compare_report

    described = None if description is None else load_description(description)
    before, after = load_estimate(estimate), load_estimate(second)
    with show_spinner("comparing"):
        found = compare(before, after, described, names=(str(estimate), str(second)))
    save_comparison(found, output)
    made = write_page(report, lambda o: compare_report(found, o), [description, estimate, second], described)
    print_parts(comparison_parts(found, everything=show_all))
    written = [output, *made]
    return CommandResult(json.loads(found.to_json()), written)


def comparison_parts(found: Comparison, *, everything: bool = False) -> Iterator[Any]:
    """Yield what to print of a comparison: the verdict, findings, parameters that changed most, notes."""
    from rich.text import Text

    from smsid.cli.output import note_lines
    from smsid.cli.tables import cut_tables, report_table
    from smsid.report.compare import numbers_table, parameters_table

    yield Text(f"{found.first} -> {found.second}", style="dim")
    yield Text(found.sentence, style="bold")
    shown = found.findings if everything else found.findings[:LINES]
    for finding in shown:
        yield Text(f"- {finding.sentence}")
        if finding is shown[0] and finding.kind in ("body_grasped", "body_released", "mass_left"):
            own = [q for q in finding.quantities if everything or q.name.startswith(MASS_PROPERTIES)]
            yield report_table(numbers_table(replace(finding, quantities=tuple(own))))
    if len(found.findings) > len(shown):
        yield Text(f"{len(found.findings) - len(shown)} more findings with --all", style="dim")
    table = report_table(parameters_table(found), everything=everything)
    yield from cut_tables([table] if found.parameters else [], everything, ROWS)
    lines = [f"not comparable, {n.reason} ({n.estimate} estimate): {n.name}" for n in found.not_comparable]
    if lines and not everything:
        yield Text(f"{len(lines)} parameters are not comparable: --all", style="yellow")
        lines = []
    yield from (Text(line) for line in note_lines((*lines, *found.notes), everything=everything))
