"""Labelled columns of a recording, brought into the order of a model: labels say which column is which.

Joints that follow another and are not in a log get the columns of what they follow.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from smsid.errors import RecordingError
from smsid.recording.channels import LABELLED_DIMS, QUANTITIES, split_channel
from smsid.recording.recording import Recording

if TYPE_CHECKING:
    from smsid.model.spacecraft import SpacecraftModel


OWN_SOURCES = ("command", "truth")
"""Sources that are about the spacecraft itself, beside the sensors of its description."""

WHAT = {
    "joint": "arm joints",
    "wheel": "wheels",
    "mode": "bending modes",
    "thruster": "thrusters",
    "station": "stations",
}
SAME = 1e-6  # [m] between the distance on a label and that of a station


def order_columns(recording: Recording, model: SpacecraftModel) -> Recording:
    """Return the recording with its labelled columns in the model's order.

    Joints, wheels, thrusters and modes are labelled by their names in the model, or by what follows the
    arm's name where that is unique, modes also by their number from 1. Stations are labelled by their
    distance from the appendage's root (``4 m``) or by their index, as in a sensor's ``stations``. Columns
    without labels are in the model's order already. Channels of sources that the description does not know
    stay as they are. A joint that follows another may be missing (`with_followers`). A recording that is
    in order is given back as it is.

    Raises:
        RecordingError: a label is unknown to the model, or one of the model's is missing.
    """
    recording = with_followers(recording, model)
    labels = recording.labels
    if not labels:
        return recording
    known = {s.name: s for s in model.description.effective_sensors()}
    names = {"joint": model.arm_joints.names, "wheel": model.wheels.names, "mode": model.modes.names}
    names["thruster"] = tuple(t.name for t in model.description.thruster)
    changed: dict[str, Any] = {}
    renamed: dict[str, Sequence[str]] = dict(labels)
    moved = False
    orders: dict[str, np.ndarray] = {}
    for key, own in labels.items():
        source, _, kind = key.rpartition(".")
        if kind not in WHAT or not _concerns(recording, key, {*known, *OWN_SOURCES}, model):
            continue
        if kind == "station":
            if source not in known or known[source].appendage is None:
                continue
            wanted = _station_order(recording, own, model, source)
        else:
            wanted = _order(recording, key, own, names[kind], kind)
            if kind == "joint":
                _check_units_of_joints(recording, [own[k] for k in wanted], names[kind], model)
            renamed[key] = names[kind]
        orders[key] = wanted
        moved |= not np.array_equal(wanted, np.arange(len(own))) or tuple(renamed[key]) != tuple(own)
        if kind == "station":
            renamed[key] = tuple(own[k] for k in wanted)
    if not moved:
        return recording
    for name in recording.channels:
        values = recording[name]
        for axis, dim in enumerate(recording.columns(name), start=1):
            if dim in orders:
                values = np.take(values, orders[dim], axis=axis)
        changed[name] = (recording.time(name), values)
    return _rebuilt(recording, changed, renamed)


def column_map(
    labels: Mapping[str, Sequence[str]], channel: str, width: int, model: SpacecraftModel
) -> tuple[np.ndarray, np.ndarray]:
    """Return the affine map that `order_columns` is to one reading of a channel, ``width`` numbers long.

    It is ``matrix`` (k, width) and ``offset`` (k,): a permutation, and of joints that follow another what
    their leaders say. Stations are read point by point, x, y, z. A channel that no recording can have, and
    one whose columns have no labels, is left as it is.

    Raises:
        RecordingError: as `order_columns`.
    """
    source, _, name = channel.partition(".")
    quantity = QUANTITIES.get(name)
    dims = {d for own in quantity.dims for d in own if d in LABELLED_DIMS} if quantity is not None else set()
    own = {key: labels[key] for d in dims for key in (d, f"{source}.{d}") if key in labels}
    if not own:
        return np.eye(width), np.zeros(width)
    shape = (width + 1, width // 3, 3) if "station" in dims and width > 3 else (width + 1, width)
    told = np.concatenate([np.zeros((1, width)), np.eye(width)]).reshape(shape)
    recording = Recording.from_arrays(np.arange(width + 1.0), {channel: told}, labels=own)
    ordered = np.asarray(order_columns(recording, model)[channel], dtype=float).reshape(width + 1, -1)
    return (ordered[1:] - ordered[0]).T, ordered[0]


def _concerns(recording: Recording, dim: str, sources: set[str], model: SpacecraftModel) -> bool:
    """Return whether a channel of the spacecraft's own runs along a dimension; of a welded arm, any."""
    return any(
        dim in recording.columns(name) and (not model.free or split_channel(name)[0] in sources)
        for name in recording.channels
    )


def _order(
    recording: Recording, key: str, labels: Sequence[str], names: Sequence[str], kind: str
) -> np.ndarray:
    """Return the column of each name; raises `RecordingError` for names or labels that are left over."""
    short = [name.rpartition("/")[2] for name in names]
    unique = {s: n for s, n in zip(short, names, strict=True) if short.count(s) == 1}
    if kind == "mode":
        unique |= {str(k): n for k, n in enumerate(names, start=1)}
    place: dict[str, int] = {}
    unknown = []
    for column, label in enumerate(labels):
        name = label if label in names else unique.get(label)
        if name is None or name in place:
            unknown.append(label)
        else:
            place[name] = column
    lacking = [name for name in names if name not in place]
    if unknown or lacking:
        raise _mismatch(recording, key, unknown, lacking, names, kind)
    return np.array([place[name] for name in names], dtype=int)


def joints_imported(recording: Recording, kind: str) -> tuple[str, ...]:
    """Return the labels of joints that were imported as ``sliding`` or ``turning``, by their units."""
    imported = recording.provenance.get("imported")
    told = imported.get(kind) if isinstance(imported, dict) else None
    return tuple(str(label) for label in told) if isinstance(told, list) else ()


def _check_units_of_joints(
    recording: Recording, labels: Sequence[str], names: Sequence[str], model: SpacecraftModel
) -> None:
    """Raise `RecordingError` for a joint imported in metres that turns, or in degrees that slides."""
    from smsid.effects.spatial import turns

    sliding, turning = (joints_imported(recording, kind) for kind in ("sliding", "turning"))
    for label, name in zip(labels, names, strict=True):
        for told, does in ((sliding, "turns"), (turning, "slides")):
            if label in told and turns(model.pin, model.pin.getJointId(name)) == (does == "turns"):
                unit = "metres or newtons" if told is sliding else "degrees"
                raise RecordingError(
                    f"Joint '{label}' was imported in {unit}, but in '{model.description.name}' it {does}.",
                    advice="State the unit of each column in the mapping, as a list, and import again.",
                    joint=label,
                )


def _station_order(
    recording: Recording, labels: Sequence[str], model: SpacecraftModel, source: str
) -> np.ndarray:
    from smsid.model.stations import station_indices

    sensor = next(s for s in model.description.effective_sensors() if s.name == source)
    joints = next((a for a in model.appendages if a.appendage.name == sensor.appendage), None)
    if joints is None:
        return np.arange(len(labels))
    used = station_indices(joints, sensor)
    distances = np.linalg.norm(joints.appendage.station_positions()[used], axis=1)
    as_distance = [_nearest(_metres(label), distances) for label in labels]
    as_index = [_index(label, used) for label in labels]
    for found in (as_index, as_distance):
        if sorted(x for x in found if x is not None) == list(range(len(used))) and len(found) == len(used):
            return np.argsort([x for x in found if x is not None])
    at = [f"{x:g} m" for x in distances]
    fits = [a if a is not None else b for a, b in zip(as_distance, as_index, strict=True)]
    unknown = [label for label, x in zip(labels, fits, strict=True) if x is None]
    lacking = [name for k, name in enumerate(at) if k not in fits]
    raise _mismatch(recording, f"{source}.station", unknown, lacking, at, "station")


def _metres(label: str) -> float:
    try:
        return float(label.strip().removesuffix("m").strip())
    except ValueError:
        return np.nan


def _nearest(distance: float, known: np.ndarray) -> int | None:
    gaps = np.abs(known - distance)
    return int(np.argmin(gaps)) if len(gaps) and np.nanmin(np.append(gaps, np.inf)) < SAME else None


def _index(label: str, used: np.ndarray) -> int | None:
    """Return the place of a station's index among those a sensor uses, if the label is one."""
    text = label.strip()
    found = np.flatnonzero(used == int(text)) if text.isdecimal() else np.zeros(0, dtype=int)
    return int(found[0]) if len(found) else None


def _mismatch(
    recording: Recording,
    key: str,
    unknown: Sequence[str],
    lacking: Sequence[str],
    names: Sequence[str],
    kind: str,
) -> RecordingError:
    parts = [f"unknown {', '.join(map(repr, unknown))}"] if unknown else []
    parts += [f"missing {', '.join(map(repr, lacking))}"] if lacking else []
    name = f" '{recording.name}'" if recording.name else ""
    return RecordingError(
        f"The labels '{key}' of the recording{name} do not fit the model: {'; '.join(parts)}.",
        advice=f"{WHAT[kind].capitalize()} of the model: {', '.join(names) or 'none'}. Correct the labels, "
        "or leave columns out; weld or leave out what does not move.",
        label=key,
        unknown=tuple(unknown),
        lacking=tuple(lacking),
        known=tuple(names),
    )


MOVED = ("joint_position", "joint_velocity", "joint_acceleration")


def with_followers(recording: Recording, model: SpacecraftModel) -> Recording:
    """Return the recording with columns of the followers it lacks, where it has their leaders by label.

    Positions, rates, accelerations follow, with the leader's noise; a torque is zero, as the leader's motor
    drives both.
    """
    followers = model.followers
    labels = {
        k: [str(x) for x in own] for k, own in recording.labels.items() if k.rpartition(".")[2] == "joint"
    }
    if followers is None or not labels:
        return recording
    added: dict[str, list[tuple[int, float, float]]] = {}
    extended: dict[str, list[str]] = {}
    for key, own in labels.items():
        for name, leader, ratio, offset in zip(
            followers.names, followers.leaders, followers.ratio, followers.offset, strict=True
        ):
            place = _place(leader, own)
            if place is not None and _place(name, own) is None:
                added.setdefault(key, []).append((place, float(ratio), float(offset)))
                extended.setdefault(key, list(own)).append(name)
    if not added:
        return recording
    changed: dict[str, Any] = {}
    for channel in recording.channels:
        values = recording[channel]
        quantity = split_channel(channel)[1]
        for axis, dim in enumerate(recording.columns(channel), start=1):
            more = [
                (ratio * np.take(values, [k], axis=axis) + (offset if quantity == "joint_position" else 0.0))
                * (1.0 if quantity in MOVED else 0.0)
                for k, ratio, offset in added.get(dim, ())
            ]
            values = np.concatenate([values, *more], axis=axis)
        changed[channel] = (recording.time(channel), values)
    return _rebuilt(recording, changed, {**recording.labels, **extended})


def _place(name: str, labels: list[str]) -> int | None:
    for text in (name, name.rpartition("/")[2]):
        if text in labels:
            return labels.index(text)
    return None


def _rebuilt(
    recording: Recording, channels: Mapping[str, Any], labels: Mapping[str, Sequence[str]]
) -> Recording:
    """Return a recording with all else that it had."""
    return Recording.from_arrays(
        recording.time() if "time" in recording.clocks else None,
        channels,
        labels=labels,
        units={n: u for n, u in recording.units.items() if n.startswith("extra.")},
        provenance=recording.provenance,
        role=recording.role,
        name=recording.name,
    )
