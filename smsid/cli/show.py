"""``smsid show``: what is in a file, whatever it is."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

from smsid.cli import show_parts as parts
from smsid.cli.errors import Outcome
from smsid.cli.file_kind import kind_of, read_json
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
) -> Outcome:
    """Show what is in a file."""
    if asks_json():  # a file is read and checked once
        return Outcome(file_document(file))
    print_parts(show_file(file, everything=show_all))
    return Outcome()


def show_file(path: Path, *, everything: bool = False) -> Iterator[Any]:
    """Yield what to print about a file of any of `KINDS`; ``everything``: all of it, however long.

    Raises `SmsidError` for a file that is none of these.
    """
    yield from SHOWN[kind_of(path)](path, everything)


def file_document(path: Path) -> dict[str, Any]:
    """Return the same as a document; raises as `show_file`."""
    kind = kind_of(path)
    match kind:
        case "recording":
            from smsid.recording import load_recording

            found: dict[str, Any] = parts.recording_document(load_recording(path))
        case "track":
            from smsid.cli.track import document
            from smsid.tracking.history import load_history

            found = document(load_history(path))
        case "estimate":
            from smsid.identify.estimate import load_estimate

            found = json.loads(load_estimate(path).to_json())
        case "experiment":
            from smsid.experiments import load_experiment

            found = load_experiment(path).model_dump(mode="json", exclude_none=True)
        case "campaign":
            from smsid.campaign import read_store, summarise

            header, records = read_store(path)
            found = {"plan": header.plan, "summary": json.loads(summarise(records).to_json())}
        case "campaign_plan":
            from smsid.campaign import load_campaign

            found = load_campaign(path).model_dump(mode="json")
        case "mapping":
            from smsid.recording.mapping import load_mapping

            found = load_mapping(path).model_dump(mode="json", exclude_none=True)
        case "description":
            from smsid.description import load_description
            from smsid.model import build_model

            description = load_description(path)
            model = build_model(description)
            found = description.model_dump(mode="json", exclude_none=True)
            found |= {"degrees_of_freedom": model.nv, "mass": {"value": model.mass, "unit": "kg"}}
        case _:
            found = read_json(path)
    return {"kind": kind, kind: found}


SHOWN: dict[str, Callable[[Path, bool], Iterator[Any]]] = {
    "recording": parts.recording,
    "estimate": parts.estimate,
    "diagnosis": parts.diagnosis,
    "comparison": parts.comparison,
    "track": parts.track,
    "linear_plant": parts.linear_plant,
    "controller": parts.controller,
    "control_study": parts.control_study,
    "campaign": parts.campaign,
    "campaign_summary": parts.campaign_summary,
    "campaign_plan": parts.campaign_plan,
    "mapping": parts.mapping,
    "experiment": parts.experiment,
    "description": parts.description,
}
"""What shows each kind of file."""
