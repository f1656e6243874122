"""``smsid track``: parameters, motion and how well each is known, over time."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from smsid.cli.errors import CommandResult
from smsid.cli.inputs import read_estimate, read_recordings, write_page
from smsid.cli.options import DescriptionPath, Output, ReportPath, ShowAll, StartingEstimate, Unchecked
from smsid.cli.output import print_parts, show_spinner
from smsid.cli.places import Writes
from smsid.errors import SmsidError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rich.console import RenderableType

    from smsid.tracking.followed_parameters import Rate
    from smsid.tracking.history import TrackHistory

SHOWN = 24  # parameters in the table, unless all are asked for

Changes = Annotated[
    bool,
    typer.Option(
        "--changes",
        help="also say what jumped, when and by how much: at most one false alarm in ten hours",
    ),
]
SavedTracker = Annotated[
    Path | None, typer.Option(help="file for the tracker as it ends, to go on from"), Writes((".npz",))
]
NotFollowed = Annotated[
    list[str] | None, typer.Option(metavar="PARAM", help="parameter (or pattern) that is not followed")
]


def track_command(
    description: DescriptionPath,
    recordings: Annotated[list[Path], typer.Argument(help="recordings, in the order they were made")],
    output: Annotated[Output, Writes((".nc",), kind="track")] = Path("track.nc"),
    method: Annotated[
        Literal["filter", "momentum"],
        typer.Option(
            help="filter: an extended Kalman filter of all the description lists; momentum: recursive total "
            "least squares of the conserved momentum (the paper's Step B), from rest without thrust"
        ),
    ] = "filter",
    memory: Annotated[
        float | None,
        typer.Option(
            min=1e-3,
            metavar="SECONDS",
            help="--method momentum: time over which what was measured, and the prior, is forgotten; all is "
            "kept if left out",
        ),
    ] = None,
    follow: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PARAM=RATE[,TREND]",
            help="parameter (or pattern, 'tank.*') to follow and how far it wanders, in its unit per square "
            "root of a second; without =RATE 1 % of its size in an hour. With TREND, its unit per second, it "
            "also changes steadily, about as fast as that. May be given repeatedly; all unknown parameters "
            "if left out",
        ),
    ] = None,
    hold: NotFollowed = None,
    estimate: StartingEstimate = None,
    cad: Annotated[
        float,
        typer.Option(min=1e-6, help="without an estimate: how far bodies may be off, relative to their size"),
    ] = 0.2,
    gap: Annotated[
        float, typer.Option(min=0.0, help="time between recordings whose clocks begin again [s]")
    ] = 0.0,
    warm_up: Annotated[
        float,
        typer.Option(
            min=0.0,
            help="without an estimate: how much of the first recording is searched for where to start [s]",
        ),
    ] = 120.0,
    changes: Changes = False,
    smooth: Annotated[
        bool,
        typer.Option(
            "--smooth",
            help="also say what is known of each time from all that was read, before and after: the filter "
            "runs a few times more",
        ),
    ] = False,
    save: SavedTracker = None,
    report: ReportPath = None,
    show_all: ShowAll = False,
    unchecked: Unchecked = False,
) -> CommandResult:
    """Follow a spacecraft's parameters through recordings, each as a random walk with bands."""
    from smsid.description import load_description
    from smsid.report.track import track_report
    from smsid.tracking.history import FALSE_ALARMS, save_history
    from smsid.tracking.track_recordings import track_recordings
    from smsid.tracking.tracker_file import save_tracker

    described = load_description(description)
    loaded, known = read_recordings(recordings, unchecked), read_estimate(estimate)
    if method == "momentum":
        refused = {"--follow": follow, "--hold": hold, "--save": save, "--changes": changes}
        refused |= {"--smooth": smooth}
        if given := [name for name, value in refused.items() if value]:
            raise SmsidError(
                f"{given[0]} is for --method filter.",
                advice="Recursive total least squares follows all combinations that momentum tells.",
            )
        from smsid.tracking.track_momentum import track_momentum

        with show_spinner("following"):
            history, _ = track_momentum(described, loaded, estimate=known, cad=cad, memory=memory, gap=gap)
    elif memory is not None:
        raise SmsidError(
            "--memory is for --method momentum.", advice="A filter forgets by --follow PARAM=RATE."
        )
    else:
        with show_spinner("following"):
            history, tracker = track_recordings(
                described, loaded, follow=rates_of(follow or ()) or None, hold=hold or (), estimate=known,
                cad=cad, gap=gap, warm_up=warm_up, false_alarms=FALSE_ALARMS if changes else None,
                smooth=smooth,
            )  # fmt: skip
        if save is not None:
            save_tracker(tracker, save)
    save_history(history, output)
    written = [output]
    if save is not None:
        written.append(save)
    inputs = [description, *recordings, estimate]
    written += write_page(report, lambda o: track_report(history, o), inputs, described)
    print_parts(history_parts(history, everything=show_all))
    return CommandResult({"track": document(history)}, written)


def rates_of(follow: Sequence[str]) -> dict[str, Rate]:
    """Return rates by parameter from ``PARAM=RATE[,TREND]``; ``None`` where no rate is given.

    Raises `SmsidError` for a rate that is no number.
    """
    found: dict[str, Rate] = {}
    for text in follow:
        name, equals, rate = text.partition("=")
        try:
            walk, comma, trend = rate.partition(",")
            own = float(walk) if equals and walk.strip() else None
            found[name.strip()] = (own, float(trend)) if comma else own
        except ValueError as error:
            raise SmsidError(
                f"--follow '{text}': '{rate}' is no number.",
                advice="Write PARAM=RATE or PARAM=RATE,TREND: the rate in the parameter's unit per square "
                "root of a second, the trend per second.",
            ) from error
    return found


def document(history: TrackHistory) -> dict:
    """Return what ``--json`` prints: every parameter at the start and at the end, events and notes."""
    table = zip(history.names, history.units, history.values.T, history.sigmas.T, strict=True)
    return {
        "seconds": float(history.time[-1] - history.time[0]),
        "recordings": list(history.recordings),
        "parameters": [
            {
                "name": name,
                "unit": unit,
                "first": {"value": float(x[0]), "sigma": float(s[0])},
                "last": {"value": float(x[-1]), "sigma": float(s[-1])},
            }
            for name, unit, x, s in table
        ],
        "events": [
            {"time": e.time, "kind": e.kind, "channel": e.channel, "text": e.text} for e in history.events
        ],
        "notes": list(history.notes),
    }


def history_parts(history: TrackHistory, *, everything: bool = False) -> Iterator[RenderableType]:
    """Yield what to print of a history: parameters at the end, events, notes."""
    from smsid.cli.output import note_lines
    from smsid.cli.tables import cut_tables, report_table
    from smsid.report.track import values_table

    table = report_table(values_table(history), everything=everything)
    yield from cut_tables([table], everything, SHOWN)
    yield from (e.text for e in history.events if e.kind == "change")
    kinds = Counter(e.kind for e in history.events if e.kind != "change")
    yield from (f"{n} times: {kind}" for kind, n in kinds.items())
    yield from note_lines(history.notes, everything=everything)
