"""What the commands of ``smsid lab`` share: options, and how a result is printed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from smsid.cli.output import console, say
from smsid.cli.places import Writes

if TYPE_CHECKING:
    from rich.console import Console

    from smsid.diagnose import Diagnosis
    from smsid.identify.estimate import Estimate

RecordingPath = Annotated[Path, typer.Argument(help="recording (.nc of `smsid import` or `smsid lab fetch`)")]
Diagnose = Annotated[
    Path | None,
    typer.Option(help="name what the simplest model lacks, and write that as `smsid diagnose` does"),
    Writes((".json",)),
]


def diagnosed(diagnosis: Diagnosis, path: Path) -> Path:
    """Write and print a diagnosis; return where it is."""
    from smsid.cli.diagnose import diagnosis_parts
    from smsid.diagnose.result import save_diagnosis

    save_diagnosis(diagnosis, path)
    for part in diagnosis_parts(diagnosis):
        console().print(part, highlight=False)
    return path


def print_estimate(out: Console, estimate: Estimate) -> None:
    """Print the parameters and notes of a test; `smsid show --all` prints the rest of long ones."""
    from smsid.cli.notes import told
    from smsid.cli.tables import estimate_parts

    for part in estimate_parts(estimate):
        out.print(part, highlight=False)
    for line in told(estimate.notes):
        say(line)
