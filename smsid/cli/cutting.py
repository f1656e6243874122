"""``smsid cut``, ``smsid resample`` and ``smsid convert``: a recording becomes another, or a table."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from smsid.cli.errors import Outcome
from smsid.cli.options import Output, RecordingOutput
from smsid.cli.output import console, say, working
from smsid.cli.places import Writes
from smsid.errors import RecordingError

if TYPE_CHECKING:
    from smsid.recording import Recording

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
) -> Outcome:
    """Cut a window out of a recording, or cut it into pieces without gaps."""
    from smsid.cli.tables import recording_table
    from smsid.recording import load_recording, save_recording
    from smsid.recording.pieces import complete_pieces

    if start is None and end is None and not pieces:
        raise RecordingError("Nothing is to be cut.", advice="State --from, --to or --pieces.")
    log = _usable(load_recording(recording))
    if start is not None or end is not None:
        log = log.window(float("-inf") if start is None else start, float("inf") if end is None else end)
    found = complete_pieces(log) if pieces else (log,)
    files = [output.with_stem(f"{output.stem}_{k}") for k in range(1, len(found) + 1)] if pieces else [output]
    out = console()
    with working("writing"):
        for piece, file in zip(found, files, strict=True):
            save_recording(piece, file)
    for piece in found[:3]:
        out.print(recording_table(piece))
    spans = [[float(p.time(p.channels[0])[0]), float(p.time(p.channels[0])[-1])] for p in found]
    return Outcome({"pieces": spans}, files)


def resample_command(
    recording: Source,
    rate: Annotated[float, typer.Option(help="of the new clock [Hz]")],
    output: RecordingOutput = Path("resampled.nc"),
) -> Outcome:
    """Bring all channels of a recording to one clock of even steps; nothing is filtered or extrapolated."""
    from smsid.cli.show_parts import recording_document
    from smsid.cli.tables import recording_table
    from smsid.recording import load_recording, save_recording

    with working("resampling"):
        made = load_recording(recording).resampled(rate)
        save_recording(made, output)
    console().print(recording_table(made))
    return Outcome({"recording": recording_document(made)}, [output])


def _usable(recording: Recording) -> Recording:
    """Refuse what no sensor and no clock reads; samples that are missing stay missing, and are told."""
    from smsid.recording._checks import check_clocks, check_finite

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
) -> Outcome:
    """Write a recording as CSV, Parquet or MCAP (ROS 2), and beside it the mapping that imports it again."""
    from smsid._files import atomic_write
    from smsid.recording import load_recording
    from smsid.recording.tables import mcap_mapping, save_mcap, save_table, table_mapping

    log = _usable(load_recording(recording))
    with working("writing"):
        mapping = output.with_suffix(".toml")
        if output.suffix.lower() == ".mcap":
            save_mcap(log, output)
            atomic_write(mapping, mcap_mapping(log))
        else:
            save_table(log, output)
            atomic_write(mapping, table_mapping(log))
    return Outcome({}, [output, mapping])
