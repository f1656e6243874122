"""``smsid show``: what is in a file, whatever it is."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from smsid.cli.manners import Outcome
from smsid.cli.output import console
from smsid.errors import SmsidError
from smsid.paths import bundled_craft

if TYPE_CHECKING:
    from rich.table import Table

    from smsid.model import SpacecraftModel
    from smsid.recording import Recording


def show_command(
    file: Annotated[Path, typer.Argument(help="a recording, estimate, description or experiment")],
) -> Outcome:
    """Show what is in a file."""
    out = console()
    for part in show_file(file):
        out.print(part)
    return Outcome(file_document(file))


def show_file(path: Path) -> Iterable[Any]:
    """Yield what to print about a recording, estimate, description or experiment.

    Raises `SmsidError` for a file that is none of these.
    """
    match _kind(path):
        case "recording":
            yield from _recording(path)
        case "estimate":
            from smsid.cli.tables import estimate_table
            from smsid.identify.estimate import load_estimate

            estimate = load_estimate(path)
            sources = ", ".join(estimate.recordings)
            yield f"estimate of '{estimate.description}' by method {estimate.method} from {sources}"
            yield from estimate_table(estimate, everything=True)
            yield from (f"note: {n}" for n in estimate.notes)
        case "experiment":
            yield from _experiment(path)
        case _:
            yield from _description(path)


def file_document(path: Path) -> dict[str, Any]:
    """Return the same as a document; raises as `show_file`."""
    kind = _kind(path)
    match kind:
        case "recording":
            from smsid.recording import load_recording

            found: dict[str, Any] = recording_document(load_recording(path))
        case "estimate":
            from smsid.identify.estimate import load_estimate

            found = json.loads(load_estimate(path).to_json())
        case "experiment":
            from smsid.experiments import load_experiment

            found = load_experiment(path).model_dump(mode="json", exclude_none=True)
        case _:
            from smsid.description import load_description
            from smsid.model import build_model

            description = load_description(path)
            model = build_model(description)
            found = description.model_dump(mode="json", exclude_none=True)
            found |= {"degrees_of_freedom": model.nv, "mass": {"value": model.mass, "unit": "kg"}}
    return {"kind": kind, kind: found}


def recording_document(recording: Recording) -> dict[str, Any]:
    """Return what `smsid show` tells of a recording: channels with unit, shape, rate and range."""
    import numpy as np

    channels = []
    for name in recording.channels:
        values, time = recording[name], recording.time(name)
        channels.append(
            {
                "name": name,
                "unit": recording.unit(name),
                "shape": list(values.shape),
                "rate": 1.0 / float(np.median(np.diff(time))) if len(time) > 1 else None,
                "from": float(time[0]),
                "to": float(time[-1]),
                "smallest": float(np.nanmin(values)),
                "largest": float(np.nanmax(values)),
            }
        )
    try:
        recording.check()
        check = ""
    except SmsidError as error:
        check = str(error)
    provenance = {k: v for k, v in recording.provenance.items()}
    return {
        "name": recording.name,
        "role": recording.role,
        "channels": channels,
        "check": check,
        "provenance": provenance,
    }


def _kind(path: Path) -> str:
    """Return recording, estimate, experiment or description; raises `SmsidError` for anything else."""
    if not path.is_file():
        if bundled_craft(str(path)) is not None:
            return "description"
        raise SmsidError(f"The file '{path}' does not exist.", advice="Check the path.")
    match path.suffix.lower():
        case ".nc" | ".h5" | ".hdf5":
            return "recording"
        case ".json":
            return "estimate"
        case ".urdf" | ".xacro":
            return "description"
        case ".toml":
            from smsid.description.files import read_toml

            return "experiment" if "duration" in read_toml(path, SmsidError) else "description"
        case suffix:
            raise SmsidError(
                f"'{path}' ends in '{suffix}', which is no recording (.nc), estimate (.json), description or "
                "experiment (.toml).",
                advice="Import a log with `smsid import` first.",
            )


def _recording(path: Path) -> Iterable[Any]:
    from rich.text import Text

    from smsid.cli.tables import recording_table
    from smsid.recording import load_recording

    recording = load_recording(path)
    yield recording_table(recording)
    try:
        recording.check()
        yield "no gaps, no NaN, units plausible"
    except SmsidError as error:
        yield Text(f"check: {error}", style="yellow")
    for key, value in recording.provenance.items():
        text = str(value)
        yield Text(f"{key}: {text if len(text) < 200 else text[:200] + '...'}")


def _experiment(path: Path) -> Iterable[Any]:
    from rich.table import Table
    from rich.text import Text

    from smsid.experiments import load_experiment

    experiment = load_experiment(path)
    yield f"experiment '{experiment.name}': {experiment.note or 'no note'}"
    table = Table(header_style="bold")
    table.add_column("key")
    table.add_column("value")
    for key, value in experiment.model_dump(exclude_none=True).items():
        if key not in ("name", "note", "schema_version"):
            text = str(value)
            table.add_row(key, Text(text if len(text) < 100 else text[:100] + "..."))
    yield table


def _description(path: Path) -> Iterable[Any]:
    from rich.table import Table

    from smsid.description import load_description
    from smsid.model import build_model

    description = load_description(path)
    model = build_model(description)
    yield (
        f"'{description.name}': {model.nv} degrees of freedom, {model.mass:.6g} kg, "
        f"{'free floating' if model.free else 'welded base'}"
    )
    yield _joints(model)
    parameters = [p for e in description.effect for p in e.parameters()]
    if parameters:
        table = Table(title="effects", title_justify="left", header_style="bold")
        for name in ("parameter", "value", "unit", "prior sigma"):
            table.add_column(name, justify="left" if name in ("parameter", "unit") else "right")
        for p in parameters:
            table.add_row(p.name, f"{p.value:.6g}", p.unit, "" if p.sigma is None else f"{p.sigma:.3g}")
        yield table
    if description.sensor:
        table = Table(title="sensors", title_justify="left", header_style="bold")
        for name in ("name", "kind", "preset", "rate", "measures"):
            table.add_column(name)
        for s in description.sensor:
            table.add_row(s.name, s.kind, s.preset or "", f"{s.rate:g} Hz", ", ".join(s.quantities))
        yield table


def _joints(model: SpacecraftModel) -> Table:
    from rich.table import Table

    roles = {int(j): "wheel" for j in model.wheels.joints}
    roles |= {int(j): "bending mode" for g in (model.modes, model.further_modes) for j in g.joints}
    roles |= {j.joint: "slosh mass" for j in model.slosh}
    roles |= {int(j): f"arm '{name}'" for name, arm in model.arms.items() for j in arm.joints}
    table = Table(title="joints", title_justify="left", header_style="bold")
    for name in ("joint", "role", "parent", "mass [kg]"):
        table.add_column(name, justify="right" if name.startswith("mass") else "left")
    for j in range(1, model.pin.njoints):
        mass = f"{model.pin.inertias[j].mass:.5g}"
        table.add_row(model.pin.names[j], roles.get(j, "base"), model.pin.names[model.pin.parents[j]], mass)
    return table
