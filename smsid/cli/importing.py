"""``smsid import``: a log becomes a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from smsid.cli.errors import Outcome
from smsid.cli.options import RecordingOutput
from smsid.cli.output import console, say, working


def import_command(
    file: Annotated[Path, typer.Argument(help="CSV, NPZ, MAT, HDF5, Parquet, ROS bag, MCAP or PX4 ULog")],
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
    also: Annotated[
        list[Path] | None,
        typer.Option(help="another file with columns of the same log on the same clock; once for each"),
    ] = None,
) -> Outcome:
    """Turn a log into a recording: a mapping file says which column is which channel, unit and frame."""
    from smsid.cli.show_parts import recording_document
    from smsid.cli.tables import recording_table
    from smsid.recording import import_recording, save_recording

    with working(f"importing {file.name}"):
        recording = import_recording(file, mapping, check=not unchecked, also=also or ())
        save_recording(recording, output)
    out = console()
    out.print(recording_table(recording))
    if not unchecked:
        for sentence in recording.suspicious():
            say(f"suspicious: {sentence}", style="yellow")
    return Outcome({"recording": recording_document(recording)}, [output])
