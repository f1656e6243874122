"""Logs and recordings: ``smsid inspect``, ``import``, ``cut``, ``resample`` and ``convert``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from smsid._time_text import stamp_text
from smsid.cli.errors import CommandResult
from smsid.cli.options import Output, RecordingOutput, ShowAll
from smsid.cli.output import console, say, show_spinner
from smsid.cli.places import Writes
from smsid.errors import OutputError, RecordingError, SmsidError

if TYPE_CHECKING:
    from smsid.recording import Recording

MAPPING = 20  # lines of a drafted mapping that are printed
Log = Annotated[Path, typer.Argument(help="CSV, NPZ, MAT, HDF5, Parquet, ROS bag, MCAP or PX4 ULog")]
MoreFiles = Annotated[
    list[Path] | None,
    typer.Option(help="another file with columns of the same log on the same clock; once for each"),
]


def inspect_command(
    file: Log,
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
    also: MoreFiles = None,
    show_all: ShowAll = False,
) -> CommandResult:
    """Tell what is in a log: columns, rates, gaps, ranges, what looks wrong; draft a mapping file."""
    from rich.markup import escape

    from smsid._files import atomic_write, with_sum
    from smsid.cli.output import MOST, clip_line
    from smsid.cli.tables import cut_tables, plain_table
    from smsid.recording.inspect import inspect_file

    if description is not None and mapping is None:
        raise SmsidError("--description needs --with.", advice="Say what the columns are in a mapping.")
    with show_spinner(f"reading {file.name}"):
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
        numbers = (f"{c.rate:.6g}", f"{100 * c.jitter:.2g} %", stamp_text(c.start), stamp_text(c.end))
        clocks.add_row(escape(c.name), str(c.samples), *numbers, c.unit)
    columns = plain_table("column", "shape", "from", "to", left=left)
    times = {c.name for c in report.clocks}
    for column in report.columns:
        write = stamp_text if column.name in times else "{:.6g}".format
        columns.add_row(escape(column.name), str(column.shape), write(column.low), write(column.high))
    for part in cut_tables([clocks, columns], show_all, 26):
        out.print(part, highlight=False)
    shown = doubts if show_all else doubts[:MOST]
    for sentence in shown:
        text = f"suspicious: {sentence}"
        out.print(text if show_all else clip_line(text), style="yellow", markup=False, highlight=False)
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
        return CommandResult(document)
    if output is None:
        lines = report.mapping.splitlines()
        if show_all or len(lines) <= MAPPING:
            out.print(report.mapping, markup=False, highlight=False)
        else:
            say(f"drafted a mapping of {len(lines)} lines: --map map.toml writes it, --all prints it")
        return CommandResult(document)
    atomic_write(output, with_sum(report.mapping))
    return CommandResult(document, [output])


def import_command(
    file: Log,
    mapping: Annotated[
        str,
        typer.Option(
            "--map",
            help="mapping file (TOML), or a ready one: joint_states, tiago, kinova, franka (ROS bags), "
            "ur_rtde (CSV), px4 (ULog), oracle_exp1, oracle_exp2",
        ),
    ],
    output: RecordingOutput = Path("recording.nc"),
    unchecked: Annotated[
        bool,
        typer.Option(
            "--unchecked", help="bring gaps, missing samples and contradictions in as they are, untold"
        ),
    ] = False,
    also: MoreFiles = None,
) -> CommandResult:
    """Turn a log into a recording: a mapping file says which column is which channel, unit and frame."""
    from smsid.cli.show_parts import recording_document
    from smsid.cli.tables import recording_table
    from smsid.recording import import_recording, save_recording

    with show_spinner(f"importing {file.name}"):
        recording = import_recording(file, mapping, check=not unchecked, also=also or ())
        save_recording(recording, output)
    out = console()
    out.print(recording_table(recording))
    if not unchecked:
        for sentence in recording.suspicious():
            say(f"suspicious: {sentence}", style="yellow")
    return CommandResult({"recording": recording_document(recording)}, [output])


Source = Annotated[Path, typer.Argument(help="recording (netCDF, as `smsid import` writes it)")]


def cut_command(
    recording: Source,
    output: RecordingOutput = Path("cut.nc"),
    start: Annotated[float | None, typer.Option("--from", help="first time kept [s]")] = None,
    end: Annotated[float | None, typer.Option("--to", help="last time kept [s]")] = None,
    pieces: Annotated[
        bool,
        typer.Option(
            "--pieces", help="also cut at gaps and missing samples: cut_1.nc, cut_2.nc, ... without either"
        ),
    ] = False,
    role: Annotated[
        str | None, typer.Option(help="of what is kept: estimation, validation (held out) or unspecified")
    ] = None,
) -> CommandResult:
    """Cut a window out of a recording, or cut it into pieces without gaps."""
    from smsid.cli.tables import recording_table
    from smsid.recording import load_recording, save_recording
    from smsid.recording.pieces import complete_pieces

    if start is None and end is None and not pieces and role is None:
        raise RecordingError("Nothing is to be cut.", advice="State --from, --to, --pieces or --role.")
    log = _refuse_unusable(load_recording(recording))
    if role is not None:
        log = log.with_role(role)
    if start is not None or end is not None:
        log = log.window(float("-inf") if start is None else start, float("inf") if end is None else end)
    found = complete_pieces(log) if pieces else (log,)
    files = [output.with_stem(f"{output.stem}_{k}") for k in range(1, len(found) + 1)] if pieces else [output]
    out = console()
    with show_spinner("writing"):
        for piece, file in zip(found, files, strict=True):
            save_recording(piece, file)
    for piece in found[:3]:
        out.print(recording_table(piece))
    spans = [[float(p.time(p.channels[0])[0]), float(p.time(p.channels[0])[-1])] for p in found]
    return CommandResult({"pieces": spans}, files)


def resample_command(
    recording: Source,
    rate: Annotated[float, typer.Option(help="of the new clock [Hz]")],
    output: RecordingOutput = Path("resampled.nc"),
) -> CommandResult:
    """Bring all channels of a recording to one clock of even steps; nothing is filtered or extrapolated."""
    from smsid.cli.show_parts import recording_document
    from smsid.cli.tables import recording_table
    from smsid.recording import load_recording, save_recording

    with show_spinner("resampling"):
        made = load_recording(recording).resampled(rate)
        save_recording(made, output)
    console().print(recording_table(made))
    return CommandResult({"recording": recording_document(made)}, [output])


def _refuse_unusable(recording: Recording) -> Recording:
    """Refuse what no sensor and no clock reads; samples that are missing stay missing, and are told."""
    from smsid.recording.channel_checks import check_clocks, check_finite

    check_clocks(recording)
    check_finite(recording, missing=True)
    for name in recording.channels:
        values = recording[name]
        if count := int((values != values).reshape(len(values), -1).any(axis=1).sum()):
            say(f"'{name}': {count} of {len(values)} samples are missing")
    return recording


def convert_command(
    recording: Source,
    output: Annotated[
        Output,
        Writes(
            (".csv", ".parquet", ".mcap"), beside=lambda o: (o.with_suffix(".toml"),), beside_kind="mapping"
        ),
    ],
) -> CommandResult:
    """Write a recording as CSV, Parquet or MCAP (ROS 2), and beside it the mapping that imports it again."""
    from smsid._files import atomic_write, sha256
    from smsid.recording import load_recording
    from smsid.recording.tables import mcap_mapping, save_mcap, save_table, table_mapping

    log = _refuse_unusable(load_recording(recording))
    imported = log.provenance.get("imported") or {}
    if output.is_file() and sha256(output) == imported.get("sha256"):
        raise OutputError(
            f"'{output}' is the log that '{recording}' was imported from.",
            advice="What was measured is not replaced: name another output.",
            path=str(output),
        )
    with show_spinner("writing"):
        mapping = output.with_suffix(".toml")
        if output.suffix.lower() == ".mcap":
            save_mcap(log, output)
            atomic_write(mapping, mcap_mapping(log))
        else:
            save_table(log, output)
            atomic_write(mapping, table_mapping(log))
    return CommandResult({}, [output, mapping])
