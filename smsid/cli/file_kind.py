"""What kind of file a file is, by its suffix and by what stands in it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from smsid._explain import toml_kind
from smsid._reading import read_json as read_any_json
from smsid._reading import read_toml
from smsid.errors import SmsidError
from smsid.paths import bundled_craft, missing_craft_advice

PARTS, READ_JSON = "smsid.cli.show_parts", "smsid.cli.file_kind:read_json"
SHOWN = {
    "recording": ("smsid.recording:load_recording", f"{PARTS}:recording_parts"),
    "estimate": ("smsid.identify.estimate:load_estimate", f"{PARTS}:estimate_and_notes"),
    "diagnosis": ("smsid.diagnose:load_diagnosis", "smsid.cli.diagnose:diagnosis_parts"),
    "comparison": ("smsid.comparison:load_comparison", "smsid.cli.compare:comparison_parts"),
    "track": ("smsid.tracking.history:load_history", f"{PARTS}:track_parts"),
    "linear_plant": (READ_JSON, f"{PARTS}:plant_parts"),
    "controller": (f"{PARTS}:checked_controller", "smsid.cli.control:document_parts"),
    "control_study": (READ_JSON, "smsid.cli.control:study_parts"),
    "campaign": (f"{PARTS}:campaign_of", f"{PARTS}:campaign_parts"),
    "campaign_summary": ("smsid.campaign.summary:load_summary", "smsid.cli.campaign:summary_parts"),
    "campaign_plan": ("smsid.campaign:load_campaign", f"{PARTS}:plan_parts"),
    "mapping": ("smsid.recording.mapping:load_mapping", f"{PARTS}:mapping_parts"),
    "experiment": ("smsid.experiments:load_experiment", f"{PARTS}:experiment_parts"),
    "description": ("smsid.description:load_description", f"{PARTS}:description_parts"),
}
"""By kind, what loads a file and what yields what `smsid show` prints of it; all that commands read or write
but pages and pictures."""

TRACK = "smsid.track"  # schema of what `smsid track` writes
LOGS = (".csv", ".npz", ".mat", ".parquet", ".bag", ".mcap", ".db3", ".ulg", ".txt")
PICTURES = {
    ".html": "a page for a browser",
    ".png": "a picture",
    ".svg": "a picture",
    ".pdf": "a picture",
}


def kind_of(path: Path) -> str:
    """Return which of `SHOWN` a file is; raises `SmsidError` saying what else it is and what to do."""
    if path.is_dir():
        raise SmsidError(f"'{path}' is a folder.", advice="Name a file in it.")
    if not path.is_file():
        if bundled_craft(str(path)) is not None:
            return "description"
        raise SmsidError(f"The file '{path}' does not exist.", advice=missing_craft_advice(str(path)))
    match path.suffix.lower():
        case ".nc" | ".h5" | ".hdf5":
            from smsid.recording.storage import file_attribute

            return "track" if file_attribute(path, "schema") == TRACK else "recording"
        case ".json":
            return _kind_of_json(path)
        case ".jsonl":
            return "campaign"
        case ".urdf" | ".xacro" | ".sdf" | ".mjcf" | ".xml":
            return "description"
        case ".toml":
            return toml_kind(read_toml(path)) or "description"
        case suffix if suffix in PICTURES:
            raise SmsidError(f"'{path}' is {PICTURES[suffix]}.", advice="Open it with a program for those.")
        case suffix if suffix in LOGS:
            raise SmsidError(
                f"'{path}' is a log.", advice="Look at it with `smsid inspect`, read it by `smsid import`."
            )
        case suffix:
            raise SmsidError(
                f"'{path}' ends in '{suffix}', which nothing that smsid writes does.",
                advice="Import a log with `smsid import` first.",
            )


def read_json(path: Path) -> dict[str, Any]:
    """Return the document of a JSON file; raises `SmsidError` where it holds none."""
    document = read_any_json(path)
    if not isinstance(document, dict):
        raise SmsidError(f"'{path}' is nothing that smsid writes.", advice="Check the path.")
    return document


def _kind_of_json(path: Path) -> str:
    document = read_json(path)
    kind = document.get("kind")
    if kind in SHOWN:
        return str(kind)
    if kind is None and {"rows", "orderings", "improvements"} <= set(document):
        return "control_study"  # those of earlier versions do not say what they are
    what = f"says that it is a '{kind}'" if kind else "does not say what it is"
    raise SmsidError(
        f"'{path}' {what}.",
        advice="Show an estimate, a diagnosis, a controller or the summary of a campaign.",
    )
