"""``smsid show``: what is in a file, whatever it is."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from pkgutil import resolve_name
from typing import Annotated, Any

import typer

from smsid.cli.errors import CommandResult
from smsid.cli.file_kind import SHOWN, kind_of, read_json
from smsid.cli.options import ShowAll
from smsid.cli.output import asks_json, print_parts


def show_command(
    file: Annotated[
        Path,
        typer.Argument(
            help="any file a command takes or makes: a recording, estimate, comparison, track, diagnosis, "
            "controller, linear plant, campaign, description, experiment or mapping"
        ),
    ],
    show_all: ShowAll = False,
) -> CommandResult:
    """Show what is in a file."""
    if asks_json():  # a file is read and checked once
        return CommandResult(file_document(file))
    print_parts(show_file(file, everything=show_all))
    return CommandResult()


def show_file(path: Path, *, everything: bool = False) -> Iterator[Any]:
    """Yield what to print about a file of any of `SHOWN`; ``everything``: all of it, however long.

    Raises `SmsidError` for a file that is none of these.
    """
    kind = kind_of(path)
    loader, parts = SHOWN[kind]
    yield from resolve_name(parts)(resolve_name(loader)(path), everything=everything)


def file_document(path: Path) -> dict[str, Any]:
    """Return the same as a document; raises as `show_file`."""
    kind = kind_of(path)
    if kind not in ("recording", "track", "estimate", "experiment", "campaign", "campaign_plan", "mapping",
                    "description"):  # fmt: skip
        return {"kind": kind, kind: read_json(path)}
    found = resolve_name(SHOWN[kind][0])(path)
    match kind:
        case "recording":
            from smsid.cli.show_parts import recording_document

            document = recording_document(found)
        case "track":
            from smsid.cli.track import document as track_document

            document = track_document(found)
        case "estimate":
            document = json.loads(found.to_json())
        case "campaign":
            header, summary = found
            document = {"plan": header.plan, "summary": json.loads(summary.to_json())}
        case _:
            document = found.model_dump(mode="json", exclude_none=kind != "campaign_plan")
    if kind == "description":
        from smsid.model import build_model

        model = build_model(found)
        document |= {"degrees_of_freedom": model.nv, "mass": {"value": model.mass, "unit": "kg"}}
    return {"kind": kind, kind: document}
