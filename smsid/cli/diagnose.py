"""``smsid diagnose``: does the simulation explain the recording, and if not, why?"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from smsid.cli.errors import CommandResult
from smsid.cli.inputs import read_estimate, read_recordings, write_page
from smsid.cli.options import DescriptionPath, Output, ReportPath, ShowAll, Unchecked
from smsid.cli.output import print_parts, show_spinner
from smsid.cli.places import Writes, is_ours

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import RenderableType

    from smsid.diagnose import Diagnosis
    from smsid.report import Provenance, Report


def _extended_path(output: Path) -> tuple[Path, ...]:
    """Return where the extended description stands when --extended does not say.

    One that smsid wrote is another diagnosis's where this one was never written, and stays.
    """
    plain, own = output.with_name("extended.toml"), output.with_suffix(".extended.toml")
    return (own if own.exists() or (is_ours(plain) and not output.exists()) else plain,)


DiagnosisOutput = Annotated[
    Output, Writes((".json",), kind="diagnosis", beside=_extended_path, beside_kind="description")
]
CAUSE = ("cause", "where", "parameter", "value", "95 % interval", "unit")  # what is printed of a cause
EXIT_CODES = {"adequate": 0, "explained": 0, "unexplained": 3, "not_evaluated": 4}


def diagnose_command(
    description: DescriptionPath,
    recordings: Annotated[list[Path], typer.Argument(help="recordings with the commands that drove them")],
    estimate: Annotated[
        Path | None, typer.Option(help="estimate (JSON): how well the nominal parameters are known")
    ] = None,
    validate: Annotated[
        list[Path] | None, typer.Option(help="recordings the gain is measured on; may be given repeatedly")
    ] = None,
    output: DiagnosisOutput = Path("diagnosis.json"),
    extended: Annotated[
        Path | None,
        typer.Option(
            help="description with the causes in it; by default extended.toml beside, or, where that is "
            "another diagnosis's, <output>.extended.toml"
        ),
        Writes((".toml",)),
    ] = None,
    unchecked: Unchecked = False,
    report: ReportPath = None,
    show_all: ShowAll = False,
    cutoff: Annotated[
        float | None, typer.Option(help="low-pass of the motion of an arm whose torques were measured [Hz]")
    ] = None,
) -> CommandResult:
    """Say what the simulation gets wrong, name the cause, extend the model and measure the gain.

    Exit code 0: adequate or explained, 3: unexplained, 4: not evaluated.
    """
    from smsid.arm.setup import arm_description, is_of_an_arm
    from smsid.description import load_description, save_description
    from smsid.diagnose.diagnose import diagnose
    from smsid.diagnose.result import save_diagnosis

    described = load_description(description)
    loaded, judged = read_recordings(recordings, unchecked), read_recordings(validate or (), unchecked)
    if description.suffix == ".urdf" and is_of_an_arm(loaded):
        described = arm_description(description)
    known = read_estimate(estimate)
    place = extended if extended is not None else _extended_path(output)[0]
    with show_spinner("diagnosing"):
        found = diagnose(described, loaded, estimate=known, validation=judged, cutoff=cutoff)
    save_diagnosis(found.diagnosis, output)
    written = [output]
    if found.diagnosis.extends:
        save_description(found.extended, place)
        written.append(place)

    def page(origin: Provenance) -> Report:
        from smsid.report.diagnose import DiagnosisInputs, diagnose_report

        return diagnose_report(found, DiagnosisInputs(described, loaded, known, judged), origin)

    written += write_page(report, page, [description, *recordings, *(validate or ()), estimate], described)
    print_parts(diagnosis_parts(found.diagnosis, everything=show_all))
    document = {"diagnosis": json.loads(found.diagnosis.to_json())}
    return CommandResult(document, written, EXIT_CODES[found.diagnosis.verdict])


def diagnosis_parts(diagnosis: Diagnosis, *, everything: bool = False) -> Iterator[RenderableType]:
    """Yield what to print of a diagnosis: the verdict, causes, gain and what remains."""
    from rich.text import Text

    from smsid.cli.output import note_lines
    from smsid.cli.tables import cut_tables, report_table
    from smsid.report.diagnosis_tables import cause_tables, gain_parts, limit_table, remaining_table
    from smsid.report.model import Table
    from smsid.report.model import Text as Words

    yield Text(f"{diagnosis.verdict.replace('_', ' ')}: {diagnosis.sentence}", style="bold")
    for table in cause_tables(diagnosis):
        shown = CAUSE if "parameter" in table.columns else ()
        yield from cut_tables([report_table(table, columns=shown, everything=everything)], everything, 12)
    if diagnosis.gain is not None:
        for part in gain_parts(diagnosis.gain, extends=bool(diagnosis.causes)):
            if isinstance(part, Table):
                yield report_table(part)
            elif isinstance(part, Words):
                yield from part.lines
    elif diagnosis.gain_reason:
        yield f"gain not evaluated: {diagnosis.gain_reason}"
    if diagnosis.remaining:
        yield from cut_tables([report_table(remaining_table(diagnosis))], everything, 8)
    if everything and diagnosis.limits:
        yield report_table(limit_table(diagnosis))
    if diagnosis.priors:
        yield diagnosis.priors
    yield from (Text(line) for line in note_lines(diagnosis.notes, everything=everything))
