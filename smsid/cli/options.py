"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from smsid.cli.places import Writes

DescriptionPath = Annotated[
    Path, typer.Argument(help="description of the spacecraft or arm: a TOML (or a bare URDF)")
]
Output = Annotated[Path, typer.Option("--output", "-o", help="file to write, whole or not at all")]
"""An output without a suffix of its own; a command says with `Writes` which suffixes fit."""
RecordingOutput = Annotated[Output, Writes((".nc",), kind="recording")]
EstimateOutput = Annotated[Output, Writes((".json",), kind="estimate")]
ReportPath = Annotated[
    Path | None,
    typer.Option("--report", help="self-contained HTML report to write as well"),
    Writes((".html", ".htm")),
]
ShowAll = Annotated[bool, typer.Option("--all", help="print everything: all rows, names in full, every note")]
Seed = Annotated[int, typer.Option(min=0, help="seed of sensor noise and turn-on biases")]
LabRecording = Annotated[Path, typer.Argument(help="recording (.nc of `smsid import` or `smsid lab fetch`)")]
LabDiagnosis = Annotated[
    Path | None,
    typer.Option(help="name what the simplest model lacks, and write that as `smsid diagnose` does"),
    Writes((".json",)),
]
Unchecked = Annotated[bool, typer.Option("--unchecked", help="go on although channels contradict each other")]
StartingEstimate = Annotated[
    Path | None, typer.Option(help="estimate (JSON) to start from, with its covariance")
]
