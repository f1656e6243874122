"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from smsid.errors import SmsidError


def writable(path: Path | None) -> Path | None:
    """Return the path of a file to write, or refuse it before anything is computed."""
    if path is None:
        return None
    if path.is_dir():
        raise SmsidError(f"Cannot write '{path}': it is a folder.", advice="Name a file inside it.")
    if not path.resolve().parent.is_dir():
        raise SmsidError(
            f"Cannot write '{path}': the folder '{path.parent}' does not exist.", advice="Create it first."
        )
    return path


DescriptionPath = Annotated[
    Path, typer.Argument(help="description of the spacecraft: a TOML (or a bare URDF)")
]
Output = Annotated[
    Path, typer.Option("--output", "-o", callback=writable, help="file to write, whole or not at all")
]
ReportPath = Annotated[
    Path | None,
    typer.Option("--report", callback=writable, help="self-contained HTML report to write as well"),
]
ShowAll = Annotated[bool, typer.Option("--all", help="print everything: all rows, names in full, every note")]
Seed = Annotated[int, typer.Option(help="seed of sensor noise and turn-on biases")]
