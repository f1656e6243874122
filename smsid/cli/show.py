"""``smsid show``: what is in a file, whatever it is."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from rich.table import Table
from rich.text import Text

from smsid.cli.tables import estimate_table, recording_table
from smsid.description import load_description
from smsid.description.files import read_toml
from smsid.errors import SmsidError
from smsid.experiments import load_experiment
from smsid.identify.estimate import load_estimate
from smsid.model import SpacecraftModel, build_model
from smsid.recording import load_recording


def show_file(path: Path) -> Iterable[Any]:
    """Yield what to print about a recording, estimate, description or experiment.

    Raises `SmsidError` for a file that is none of these.
    """
    if not path.is_file():
        raise SmsidError(f"The file '{path}' does not exist.", advice="Check the path.")
    match path.suffix.lower():
        case ".nc" | ".h5" | ".hdf5":
            yield from _recording(path)
        case ".json":
            estimate = load_estimate(path)
            sources = ", ".join(estimate.recordings)
            yield f"estimate of '{estimate.description}' by method {estimate.method} from {sources}"
            yield from estimate_table(estimate, everything=True)
            yield from (f"note: {n}" for n in estimate.notes)
        case ".urdf":
            yield from _description(path)
        case ".toml":
            tables = read_toml(path, SmsidError)
            yield from (_experiment(path) if "duration" in tables else _description(path))
        case suffix:
            raise SmsidError(
                f"'{path}' ends in '{suffix}', which is no recording (.nc), estimate (.json), description or "
                "experiment (.toml).",
                advice="Import a log with `smsid import` first.",
            )


def _recording(path: Path) -> Iterable[Any]:
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
    roles = {int(j): "wheel" for j in model.wheels.joints}
    roles |= {int(j): "bending mode" for j in model.modes.joints}
    roles |= {j.joint: "slosh mass" for j in model.slosh}
    roles |= {int(j): f"arm '{name}'" for name, arm in model.arms.items() for j in arm.joints}
    table = Table(title="joints", title_justify="left", header_style="bold")
    for name in ("joint", "role", "parent", "mass [kg]"):
        table.add_column(name, justify="right" if name.startswith("mass") else "left")
    for j in range(1, model.pin.njoints):
        mass = f"{model.pin.inertias[j].mass:.5g}"
        table.add_row(model.pin.names[j], roles.get(j, "base"), model.pin.names[model.pin.parents[j]], mass)
    return table
