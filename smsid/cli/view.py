"""``smsid view``: a spacecraft in 3-D, at rest or as it was recorded."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from smsid.cli.errors import CommandResult
from smsid.cli.inputs import read_recordings
from smsid.cli.options import DescriptionPath
from smsid.cli.output import say, show_spinner
from smsid.cli.places import PAGE, Writes
from smsid.errors import SmsidError

if TYPE_CHECKING:
    from smsid.tracking.history import TrackHistory


def view_command(
    description: DescriptionPath,
    recordings: Annotated[
        list[Path] | None,
        typer.Argument(
            help="recordings to replay, or what `smsid track` wrote: the first as it is, others with it; "
            "without: at rest"
        ),
    ] = None,
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            "--html",
            help="self-contained HTML to write; .mp4 or .gif: a film (extra: video)",
        ),
        Writes((".html", ".htm", ".mp4", ".gif"), kind=PAGE),
    ] = Path("view.html"),
    simulated: Annotated[
        bool,
        typer.Option("--simulated", help="also what the description makes of the first recording's commands"),
    ] = False,
    layout: Annotated[
        Literal["ghost", "beside"], typer.Option(help="of more than one motion; ghost: over each other")
    ] = "ghost",
    bending: Annotated[
        float, typer.Option(help="deflections drawn this many times larger; the page has a slider")
    ] = 1.0,
    slosh: Annotated[float, typer.Option(help="slosh drawn this many times larger")] = 1.0,
    speed: Annotated[
        float, typer.Option(min=1e-3, max=1e3, help="seconds of motion per second; the page has a choice")
    ] = 1.0,
    fps: Annotated[float, typer.Option(min=0.1, max=240.0, help="frames kept per second on screen")] = 20.0,
    dark: Annotated[
        bool, typer.Option("--dark", help="before stars, whatever the reader's system prefers")
    ] = False,
    arrows: Annotated[bool, typer.Option(help="thrust, torques, momentum, centre of mass")] = True,
    trail: Annotated[bool, typer.Option(help="the way of each arm's tool")] = True,
    live: Annotated[
        bool, typer.Option("--live", help="serve it to a browser until Ctrl-C instead of writing a file")
    ] = False,
    host: Annotated[
        str, typer.Option(help="--live: address to listen on; by default for this machine alone")
    ] = "127.0.0.1",
) -> CommandResult:
    """Show a spacecraft, or replay recordings of it, in 3-D: one HTML file, a film, or live (extra: view)."""
    from smsid.description import load_description
    from smsid.view import Look, build_replay, show, write_view

    sky: Literal["space", "auto"] = "space" if dark else "auto"
    look = Look(slosh_factor=slosh, panel_factor=bending, background=sky, arrows=arrows, trail=trail)
    if simulated and not recordings:
        raise SmsidError("--simulated needs a recording.", advice="Give the one whose commands to fly.")
    with show_spinner("drawing"):
        described, paths = load_description(description), recordings or []
        how = {"simulated": simulated, "layout": layout, "look": look, "fps": fps, "speed": speed}
        motions = [_load_track(p) if _is_track(p) else read_recordings([p])[0] for p in paths]
        view = build_replay(described, motions, file_names(paths), **how)  # type: ignore[arg-type]
    if live:
        with show_spinner("drawing"):
            shown = show(view, host=host)
        say(f"listening on {host}; open {shown.url} in a browser; Ctrl-C ends it")
        try:
            while True:
                time.sleep(1.0)
        except KeyboardInterrupt:
            shown.close()
        return CommandResult({"url": shown.url, "notes": list(shown.scene.notes)})
    with show_spinner("drawing"):
        write_view(view, output, fps=fps)
    for note in view.notes:
        say(f"note: {note}")
    return CommandResult({"notes": list(view.notes)}, [output])


def _load_track(path: Path) -> TrackHistory:
    from smsid.tracking.history import load_history  # the tracker takes time to load

    return load_history(path)


def _is_track(path: Path) -> bool:
    from smsid.cli.file_kind import kind_of

    with suppress(SmsidError):  # what is wrong with a recording is said when it is read
        return kind_of(path) == "track"
    return False


def file_names(paths: Sequence[Path]) -> list[str]:
    """Return short names of files: their stems, or their paths where stems coincide."""
    stems = [p.stem for p in paths]
    return stems if len(set(stems)) == len(stems) else [str(p) for p in paths]
