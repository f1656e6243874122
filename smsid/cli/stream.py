"""``smsid stream`` and ``smsid play``: telemetry as JSON lines, as it comes or out of a recording."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from smsid.cli.errors import CommandResult
from smsid.cli.options import DescriptionPath, StartingEstimate
from smsid.cli.track import Changes, NotFollowed, SavedTracker, rates_of
from smsid.errors import SmsidError

if TYPE_CHECKING:
    from collections.abc import Iterator

STDIN = "-"


def stream_command(
    description: DescriptionPath,
    source: Annotated[
        str, typer.Argument(help="samples as JSON lines: a file, or - for the standard input")
    ] = STDIN,
    restore: Annotated[
        Path | None,
        typer.Option(help="tracker to go on from (NPZ), as `smsid track --save` or --save here wrote it"),
    ] = None,
    follow: Annotated[
        list[str] | None,
        typer.Option(metavar="PARAM=RATE[,TREND]", help="parameter (or pattern) to follow: as `smsid track`"),
    ] = None,
    hold: NotFollowed = None,
    estimate: StartingEstimate = None,
    begin: Annotated[
        float,
        typer.Option(
            min=0.1,
            metavar="SECONDS",
            help="how much is read first, to find out how commands act and, without an estimate, where to "
            "start; not with --restore",
        ),
    ] = 30.0,
    every: Annotated[
        float, typer.Option(min=0.0, metavar="SECONDS", help="least time between results, of the telemetry")
    ] = 1.0,
    wait: Annotated[
        float,
        typer.Option(
            min=0.0,
            metavar="SECONDS",
            help="a file that grows: go on until nothing was written for so long; without it, to its end",
        ),
    ] = 0.0,
    lateness: Annotated[
        float | None,
        typer.Option(min=0.0, metavar="SECONDS", help="wait so long for samples that come out of order"),
    ] = None,
    changes: Changes = False,
    save: SavedTracker = None,
) -> CommandResult:
    """Follow telemetry as it comes: JSON lines in, what is believed as JSON lines out."""
    from smsid.description import load_description
    from smsid.identify.estimate import load_estimate
    from smsid.tracking.history import FALSE_ALARMS
    from smsid.tracking.stream import Stream
    from smsid.tracking.tracker_file import load_tracker, save_tracker

    described = load_description(description)
    given = {"--follow": follow, "--hold": hold, "--estimate": estimate}
    if restore is not None and (refused := [name for name, value in given.items() if value]):
        raise SmsidError(
            f"{refused[0]} and --restore contradict each other.",
            advice="A saved tracker follows what it followed.",
        )
    stream = Stream(
        described,
        tracker=load_tracker(restore, described) if restore is not None else None,
        follow=rates_of(follow or ()) or None,
        hold=hold or (),
        estimate=load_estimate(estimate) if estimate is not None else None,
        begin=begin,
        every=every,
        lateness=lateness,
        false_alarms=FALSE_ALARMS if changes else None,
    )
    told, written = 0, []
    try:
        for line in stream.follow(_read(source, wait)):
            print(line, flush=True)
            told += 1
    finally:  # an interrupted stream is gone on with
        if save is not None and stream.tracker is not None:
            written = [save_tracker(stream.tracker, save)]
    tracker = stream.tracker
    assert tracker is not None
    sigmas = (tracker.watch.widening * tracker.sigmas).tolist()
    values = zip(tracker.names, tracker.values.tolist(), sigmas, strict=True)
    document = {
        "lines": told,
        "samples": tracker.samples,
        "explained": tracker.watch.explained,
        "events": dict(tracker.log.counts),
        "parameters": [{"name": n, "value": x, "sigma": s} for n, x, s in values],
    }
    return CommandResult({"stream": document}, written, untold=True)


def play_command(
    recording: Annotated[Path, typer.Argument(help="recording (NetCDF) to play")],
    speed: Annotated[float, typer.Option(min=0.0, help="times real time; 0: as fast as it is read")] = 0.0,
) -> CommandResult:
    """Play a recording as JSON lines, as `smsid stream` takes them."""
    from smsid.recording import load_recording
    from smsid.tracking.json_lines import lines_of

    begun, first, told = time.monotonic(), None, 0
    for at, line in lines_of(load_recording(recording)):
        first = at if first is None else first
        if speed > 0.0:
            time.sleep(max(0.0, (at - first) / speed - (time.monotonic() - begun)))
        print(line, flush=speed > 0.0)
        told += 1
    return CommandResult({"lines": told})


def _read(source: str, wait: float) -> Iterator[str]:
    from smsid.tracking.json_lines import growing_lines

    if source == STDIN:
        yield from sys.stdin
        return
    path, last = Path(source), time.monotonic()
    size = -1

    def ended() -> bool:
        nonlocal last, size
        now = path.stat().st_size if path.exists() else size
        if now != size:
            last, size = time.monotonic(), now
        return time.monotonic() - last >= wait

    yield from growing_lines(path, ended=ended)
