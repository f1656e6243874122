"""``smsid plot``: figures for papers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from smsid.cli.errors import CommandResult
from smsid.cli.options import Output
from smsid.cli.output import show_spinner
from smsid.cli.places import FIGURE, Writes


def plot_command(
    what: Annotated[
        str, typer.Argument(help="recording, estimate, stabilisation, diagnosis (map) or campaign (coverage)")
    ],
    file: Annotated[
        Path,
        typer.Argument(help="recording (.nc), estimate or diagnosis (.json), store of a campaign (.jsonl)"),
    ],
    output: Annotated[Output, Writes((".png", ".svg", ".pdf"), kind=FIGURE)] = Path("figure.png"),
    channel: Annotated[
        list[str] | None, typer.Option(help="recording: a channel to draw; may be given repeatedly")
    ] = None,
    description: Annotated[
        Path | None, typer.Option(help="stabilisation: the spacecraft's TOML, for its sensors")
    ] = None,
    truth: Annotated[
        Path | None, typer.Option(help="estimate: another estimate (JSON) whose values are taken as true")
    ] = None,
    title: Annotated[str, typer.Option(help="above the figure")] = "",
) -> CommandResult:
    """Draw a figure for a paper as PNG, SVG or PDF, by the suffix of the output (extra: plot)."""
    from smsid.figures import draw
    from smsid.figures.draw import Request

    with show_spinner("drawing"):
        draw(what, Request(file, description, tuple(channel or ()), truth, title), output)
    return CommandResult({"figure": what}, [output])
