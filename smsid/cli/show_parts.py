"""What `smsid show` prints of each kind of file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.table import Table
from rich.text import Text

from smsid.cli.file_kind import read_json
from smsid.cli.output import WIDTH, clip_line, note_lines
from smsid.cli.tables import channel_rows, cut_tables, estimate_parts, plain_table, recording_table
from smsid.errors import SmsidError

if TYPE_CHECKING:
    from smsid.campaign import Campaign
    from smsid.campaign.store import StoreHeader
    from smsid.campaign.summary import Summary
    from smsid.description import Description
    from smsid.experiments import Experiment
    from smsid.identify.estimate import Estimate
    from smsid.model import SpacecraftModel
    from smsid.recording import Recording
    from smsid.recording.mapping import ImportMapping
    from smsid.tracking.history import TrackHistory


def recording_parts(found: Recording, *, everything: bool) -> Iterator[Any]:
    """Yield the channels of a recording, whether its samples are in order, and where it is from."""
    yield recording_table(found)
    try:
        found.check()
        yield "no gaps, no NaN, units plausible"
    except SmsidError as error:
        yield Text(f"check: {error}", style="yellow")
    for key, names in found.labels.items():
        line = f"{key}: {', '.join(names)}"
        yield line if everything else clip_line(line)
    provenance = list(found.provenance.items())
    for key, value in provenance if everything else provenance[:8]:
        yield Text(f"{key}: {value}" if everything else clip_line(f"{key}: {value}"))
    if len(provenance) > 8 and not everything:
        yield f"{len(provenance) - 8} more of its provenance with --all"


def recording_document(recording: Recording) -> dict[str, Any]:
    """Return what `smsid show` tells of a recording: channels with unit, shape, rate and range."""
    try:
        recording.check()
        check = ""
    except SmsidError as error:
        check = str(error)
    return {
        "name": recording.name,
        "role": recording.role,
        "channels": channel_rows(recording),
        "labels": {k: list(v) for k, v in recording.labels.items()},
        "check": check,
        "provenance": recording.provenance,
    }


def estimate_and_notes(found: Estimate, *, everything: bool) -> Iterator[Any]:
    """Yield the parameters of an estimate, what cannot be told, and its notes."""
    yield from estimate_parts(found, everything=everything)
    yield from (Text(line) for line in note_lines(found.notes, everything=everything))


def track_parts(found: TrackHistory, *, everything: bool) -> Iterator[Any]:
    """Yield the parameters that were followed, where they began and ended, what jumped, and notes."""
    from smsid.cli.track import history_parts

    flights = f"{', '.join(found.recordings)}: {found.time[-1] - found.time[0]:g} s"
    yield Text(clip_line(f"track of '{found.description}' through {flights}"))
    yield from history_parts(found, everything=everything)


def plant_parts(found: dict[str, Any], *, everything: bool) -> Iterator[Any]:
    """Yield states, inputs and poles of a linear plant."""
    yield Text(f"linear plant of '{found['name']}', inputs {', '.join(found['inputs'])}")
    poles = np.linalg.eigvals(np.array(found["A"]))
    swinging = np.sort(np.abs(poles[poles.imag > 0.0]))
    yield Text("oscillates at " + (", ".join(f"{x:.4g}" for x in swinging) or "no frequency") + " rad/s")
    states = plain_table("state", "unit", left=("state", "unit"))
    for name, unit in zip(found["states"], found["units"], strict=True):
        states.add_row(Text(name), unit)
    yield from cut_tables([states], everything)
    yield from (Text(line) for line in note_lines(found["notes"], everything=everything))


def checked_controller(path: Path) -> dict[str, Any]:
    """Return the document of a controller; raises what `load_controller` raises."""
    from smsid.control.controller_file import load_controller

    load_controller(path)  # says what is wrong with the file
    return read_json(path)


def campaign_of(path: Path) -> tuple[StoreHeader, Summary]:
    """Return the header of a campaign and the summary of its runs, also of one that is not finished."""
    from smsid.campaign import read_store, summarise

    header, records = read_store(path)
    return header, summarise(records)


def campaign_parts(found: tuple[StoreHeader, Summary], *, everything: bool) -> Iterator[Any]:
    """Yield the summary of a campaign's runs."""
    from smsid.cli.campaign import summary_parts

    header, summary = found
    yield f"campaign '{header.plan['name']}' of '{header.plan['description']}'"
    yield from summary_parts(summary, everything=everything)


def plan_parts(plan: Campaign, *, everything: bool) -> Iterator[Any]:
    """Yield the plan of a campaign."""
    yield f"campaign '{plan.name}': {plan.note or 'no note'}"
    yield _keys(plan.model_dump(exclude_none=True, exclude={"name", "note", "folder"}), everything)


def mapping_parts(found: ImportMapping, *, everything: bool) -> Iterator[Any]:
    """Yield which channel a mapping takes from which columns."""
    yield f"mapping to {len(found.channel)} channels, role {found.recording.role}"
    table = plain_table("channel", "from", "unit", "labels", left=("channel", "from", "unit", "labels"))
    for name, channel in found.channel.items():
        own = [", ".join(channel.columns), ", ".join(channel.units), ", ".join(channel.labels or ())]
        table.add_row(name, *(x if everything else clip_line(x, 30) for x in own))
    yield from cut_tables([table], everything)


def experiment_parts(found: Experiment, *, everything: bool) -> Iterator[Any]:
    """Yield what an experiment commands."""
    yield f"experiment '{found.name}': {found.note or 'no note'}"
    yield _keys(found.model_dump(exclude_none=True, exclude={"name", "note", "schema_version"}), everything)


def description_parts(found: Description, *, everything: bool) -> Iterator[Any]:
    """Yield joints, effects and sensors of a description."""
    from smsid.model import build_model

    model = build_model(found)
    yield (
        f"'{found.name}': {model.nv} degrees of freedom, {model.mass:.6g} kg, "
        f"{'free floating' if model.free else 'welded base'}"
    )
    tables = [_joints(model)]
    effects = model.description.effect  # those of the URDF's <dynamics> as well
    parameters = [p for e in effects for p in e.parameters()]
    if parameters:
        columns = ("parameter", "value", "unit", "prior sigma")
        table = plain_table(*columns, title="effects", left=("parameter", "unit"))
        for p in parameters:
            unit = _unit(model, p.name, p.unit)
            table.add_row(p.name, f"{p.value:.6g}", unit, "" if p.sigma is None else f"{p.sigma:.3g}")
        tables.append(table)
    if found.sensor:
        names = ("name", "kind", "preset", "rate", "measures")
        table = plain_table(*names, title="sensors", left=("name", "kind", "preset", "measures"))
        for s in found.sensor:
            table.add_row(s.name, s.kind, s.preset or "", f"{s.rate:g} Hz", ", ".join(s.quantities))
        tables.append(table)
    yield from cut_tables(tables, everything)


def _unit(model: SpacecraftModel, name: str, unit: str) -> str:
    """Return the unit of an effect's parameter; on joints that slide in metres and newtons."""
    from smsid.arm.units import joint_unit

    effect = model.description.get_effect(name.partition(".")[0])
    joints = getattr(effect, "joints", None) or (str(getattr(effect, "joint", "")),)
    return joint_unit(unit, model, *joints)


def _joints(model: SpacecraftModel) -> Table:
    roles = {int(j): "wheel" for j in model.wheels.joints}
    roles |= {int(j): "bending mode" for g in (model.modes, model.further_modes) for j in g.joints}
    roles |= {j.joint: "slosh mass" for j in model.slosh}
    roles |= {int(j): f"arm '{name}'" for name, arm in model.arms.items() for j in arm.joints}
    columns = ("joint", "role", "parent", "mass [kg]")
    table = plain_table(*columns, title="joints", left=columns[:3])
    for j in range(1, model.pin.njoints):
        mass = f"{model.pin.inertias[j].mass:.5g}"
        table.add_row(model.pin.names[j], roles.get(j, "base"), model.pin.names[model.pin.parents[j]], mass)
    return table


def _keys(table: dict[str, Any], everything: bool) -> Table:
    shown = plain_table("key", "value", left=("key", "value"))
    if everything:
        shown.columns[1].no_wrap, shown.columns[1].overflow = False, "fold"
    room = WIDTH - max(map(len, table), default=0) - 6
    for key, value in table.items():
        shown.add_row(key, Text(str(value) if everything else clip_line(str(value), room)))
    return shown
