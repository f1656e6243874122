"""``smsid inspect``: what is in a log."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from smsid.cli.manners import Outcome
from smsid.cli.output import console, working
from smsid.cli.places import Writes
from smsid.errors import SmsidError


def inspect_command(
    file: Annotated[Path, typer.Argument(help="CSV, NPZ, MAT, HDF5, Parquet, ROS bag or MCAP")],
    output: Annotated[
        Path | None, typer.Option("--map", help="write the drafted mapping to this TOML"), Writes((".toml",))
    ] = None,
    mapping: Annotated[
        Path | None, typer.Option("--with", help="mapping that says what the columns are (TOML)")
    ] = None,
    description: Annotated[
        Path | None,
        typer.Option(
            help="welded arm (TOML): also compare signs and torques with it; needs --with, and joint labels"
        ),
    ] = None,
    cutoff: Annotated[float | None, typer.Option(min=1e-6, help="with --description: low-pass [Hz]")] = None,
) -> Outcome:
    """Tell what is in a log: columns, rates, gaps, ranges, what looks wrong; draft a mapping file."""
    from rich.table import Table

    from smsid._files import atomic_write
    from smsid.recording.inspect import inspect_file

    if description is not None and mapping is None:
        raise SmsidError("--description needs --with.", advice="Say what the columns are in a mapping.")
    with working(f"reading {file.name}"):
        report = inspect_file(file, mapping)
    doubts = list(report.suspicions)
    if description is not None and mapping is not None:
        from smsid.arm import joint_doubts
        from smsid.description import load_description
        from smsid.recording import import_recording

        recording = import_recording(file, mapping, check=False)
        doubts += [d.sentence for d in joint_doubts(load_description(description), recording, cutoff=cutoff)]
    out = console()
    table = Table("clock", "samples", "rate [Hz]", "jitter", "from", "to", "unit")
    for c in report.clocks:
        numbers = (
            str(c.samples),
            f"{c.rate:.6g}",
            f"{100 * c.jitter:.2g} %",
            f"{c.start:.9g}",
            f"{c.end:.9g}",
        )
        table.add_row(c.name, *numbers, c.unit)
    out.print(table)
    table = Table("column", "shape", "from", "to")
    for column in report.columns:
        table.add_row(column.name, str(column.shape), f"{column.low:.6g}", f"{column.high:.6g}")
    out.print(table)
    for sentence in doubts:
        out.print(f"suspicious: {sentence}", style="yellow", markup=False, soft_wrap=True)
    if not doubts:
        out.print("nothing suspicious")
    document = {
        "clocks": [asdict(c) for c in report.clocks],
        "columns": [asdict(c) for c in report.columns],
        "suspicions": doubts,
        "mapping": report.mapping,
    }
    if mapping is not None:
        return Outcome(document)
    if output is None:
        out.print(report.mapping, markup=False, highlight=False)
        return Outcome(document)
    atomic_write(output, report.mapping)
    out.print(f"wrote {output}")
    return Outcome(document, [output])
