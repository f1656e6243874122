"""``smsid show``: what is in a file, whatever it is."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer

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
    kind = kind_of(path)
    loader, parts = SHOWN[kind]
    yield from _named(parts)(_named(loader)(path), everything=everything)


def file_document(path: Path) -> dict[str, Any]:
    """Return the same as a document; raises as `show_file`."""
    kind = kind_of(path)
    if kind not in ("recording", "track", "estimate", "experiment", "campaign", "campaign_plan", "mapping",
                    "description"):  # fmt: skip
        return {"kind": kind, kind: read_json(path)}
    found = _named(SHOWN[kind][0])(path)
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


def _named(target: str) -> Callable[..., Any]:
    module, _, name = target.partition(":")
    return getattr(import_module(module), name)


PARTS, JSON = "smsid.cli.show_parts", "smsid.cli.file_kind:read_json"
SHOWN = {
    "recording": ("smsid.recording:load_recording", f"{PARTS}:recording_parts"),
    "estimate": ("smsid.identify.estimate:load_estimate", f"{PARTS}:estimate_and_notes"),
    "diagnosis": ("smsid.diagnose:load_diagnosis", "smsid.cli.diagnose:diagnosis_parts"),
    "comparison": ("smsid.comparison:load_comparison", "smsid.cli.compare:comparison_parts"),
    "track": ("smsid.tracking.history:load_history", f"{PARTS}:track_parts"),
    "linear_plant": (JSON, f"{PARTS}:plant_parts"),
    "controller": (f"{PARTS}:checked_controller", "smsid.cli.control:document_parts"),
    "control_study": (JSON, "smsid.cli.control:study_parts"),
    "campaign": (f"{PARTS}:campaign_of", f"{PARTS}:campaign_parts"),
    "campaign_summary": ("smsid.campaign.summary:load_summary", f"{PARTS}:summary_parts"),
    "campaign_plan": ("smsid.campaign:load_campaign", f"{PARTS}:plan_parts"),
    "mapping": ("smsid.recording.mapping:load_mapping", f"{PARTS}:mapping_parts"),
    "experiment": ("smsid.experiments:load_experiment", f"{PARTS}:experiment_parts"),
    "description": ("smsid.description:load_description", f"{PARTS}:description_parts"),
}
"""What loads each kind of file, and what yields what is printed of it."""
