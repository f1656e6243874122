"""``smsid inspect``: what is in a log."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from smsid.cli.errors import Outcome
from smsid.cli.options import ShowAll
from smsid.cli.output import console, say, working
from smsid.cli.places import Writes
from smsid.errors import SmsidError

MAPPING = 20  # lines of a drafted mapping that are printed


def inspect_command(
    file: Annotated[Path, typer.Argument(help="CSV, NPZ, MAT, HDF5, Parquet, ROS bag, MCAP or PX4 ULog")],
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
    also: Annotated[
        list[Path] | None,
        typer.Option(help="another file with columns of the same log on the same clock; once for each"),
    ] = None,
    show_all: ShowAll = False,
) -> Outcome:
    """Tell what is in a log: columns, rates, gaps, ranges, what looks wrong; draft a mapping file."""
    from rich.markup import escape

    from smsid._files import atomic_write, signed
    from smsid.cli.notes import MOST, clipped
    from smsid.cli.tables import cut_tables, plain_table
    from smsid.recording.inspect import inspect_file

    if description is not None and mapping is None:
        raise SmsidError("--description needs --with.", advice="Say what the columns are in a mapping.")
    with working(f"reading {file.name}"):
        report = inspect_file(file, mapping, also=also or ())
    doubts = list(report.suspicions)
    if description is not None and mapping is not None:
        from smsid.arm import joint_doubts
        from smsid.description import load_description
        from smsid.recording import import_recording

        recording = import_recording(file, mapping, check=False, also=also or ())
        doubts += [d.sentence for d in joint_doubts(load_description(description), recording, cutoff=cutoff)]
    out = console()
    left = ("clock", "jitter", "unit", "column")
    clocks = plain_table("clock", "samples", "rate [Hz]", "jitter", "from", "to", "unit", left=left)
    for c in report.clocks:
        numbers = (f"{c.rate:.6g}", f"{100 * c.jitter:.2g} %", f"{c.start:.9g}", f"{c.end:.9g}")
        clocks.add_row(escape(c.name), str(c.samples), *numbers, c.unit)
    columns = plain_table("column", "shape", "from", "to", left=left)
    for column in report.columns:
        columns.add_row(escape(column.name), str(column.shape), f"{column.low:.6g}", f"{column.high:.6g}")
    for part in cut_tables([clocks, columns], show_all, 26):
        out.print(part, highlight=False)
    shown = doubts if show_all else doubts[:MOST]
    for sentence in shown:
        text = f"suspicious: {sentence}"
        out.print(text if show_all else clipped(text), style="yellow", markup=False, highlight=False)
    if len(doubts) > len(shown):
        say(f"{len(doubts) - len(shown)} more suspicions with --all")
    if not doubts:
        say("nothing suspicious")
    document = {
        "clocks": [asdict(c) for c in report.clocks],
        "columns": [asdict(c) for c in report.columns],
        "suspicions": doubts,
        "mapping": report.mapping,
    }
    if mapping is not None:
        return Outcome(document)
    if output is None:
        lines = report.mapping.splitlines()
        if show_all or len(lines) <= MAPPING:
            out.print(report.mapping, markup=False, highlight=False)
        else:
            say(f"drafted a mapping of {len(lines)} lines: --map map.toml writes it, --all prints it")
        return Outcome(document)
    atomic_write(output, signed(report.mapping))
    return Outcome(document, [output])
