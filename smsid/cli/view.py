"""``smsid view``: a spacecraft in 3-D."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from smsid.cli.manners import Outcome
from smsid.cli.options import DescriptionPath, writable
from smsid.cli.output import console, working


def view_command(
    description: DescriptionPath,
    recording: Annotated[Path | None, typer.Argument(help="recording to replay")] = None,
    output: Annotated[
        Path, typer.Option("--output", "-o", callback=writable, help="self-contained HTML to write")
    ] = Path("view.html"),
) -> Outcome:
    """Write a 3-D view of a spacecraft, or the replay of a recording, as one HTML file (extra: view)."""
    from smsid.view import view_main

    with working("drawing"):
        _, notes = view_main(description, recording, output)
    console().print(f"wrote {output}")
    return Outcome({"notes": list(notes)}, [output])
