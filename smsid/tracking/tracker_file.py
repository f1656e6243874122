"""A tracker in a file: saved and restored so that it goes on exactly as it would have."""

from __future__ import annotations

import hashlib
import io
import json
import os
import zipfile
from collections import deque
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter
from scipy.interpolate import BSpline

from smsid._files import atomic_write
from smsid.description.schema import Description
from smsid.errors import RecordingError
from smsid.estimation.panels import modal_panels
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.inputs.signals import Constant, Sampled, Signal
from smsid.kernel.filter_arrays import Drive
from smsid.simulate import Inputs
from smsid.tracking._course import Course
from smsid.tracking._fit_watch import FitWatch
from smsid.tracking._linearisation import Linearisation
from smsid.tracking._parameter_filter import ParameterFilter
from smsid.tracking._sample_buffer import Event, MomentEvents
from smsid.tracking._setting import Setting
from smsid.tracking._tracker import Tracker
from smsid.tracking.followed_parameters import Followed, StartingPoint

SCHEMA = "smsid.tracker"
VERSION = 7
STATE = ("q", "v", "unknown", "values", "covariance")
PASSED = ("edges", "readings", "attitudes", *Drive._fields[:8])
SETTING, FOLLOWED = TypeAdapter(Setting), TypeAdapter(tuple[Followed, ...])
HELD = TypeAdapter(tuple[tuple[Unknown, float], ...])
EARLIEST = (1980, 1, 1, 0, 0, 0)  # date of files within, so that equal trackers give equal bytes


def save_tracker(tracker: Tracker, path: str | os.PathLike[str]) -> Path:
    """Write a tracker to a file (npz), whole or not at all, and return its path.

    Raises `OutputError` when the file cannot be written.
    """
    f = tracker.filter
    arrays: dict[str, np.ndarray] = {
        **{name: getattr(f, name) for name in STATE},
        "linearised": f.at.values,
        "renewed": f.at.renewed,
        "known_at": f.known_at,
        "start_mean": tracker.start.mean,
        "start_covariance": tracker.start.covariance,
    }
    if tracker._before is not None:
        arrays["before"] = tracker._before
    document = {
        "schema": SCHEMA,
        "version": VERSION,
        "description": description_digest(tracker.described),
        "setting": asdict(tracker.setting),
        "followed": [asdict(x) for x in tracker.start.followed],
        "notes": tracker.start.notes,
        "held": [(asdict(u), x) for u, x in tracker.start.held],
        "time": f.time,
        "moving": tracker.moving,
        "first": tracker._first,
        "looks": tracker._looks,
        "samples": tracker.samples,
        "watch": {
            "widening": tracker.watch.misfit,
            "apart": tracker.watch.apart,
            "seconds": tracker.watch.seconds,
            "component": tracker.watch.component,
            "squares": tracker.watch.squares,
        },
        "rebuilt": f.rebuilt,
        "passed": tracker.buffer.passed,
        "newest": tracker.buffer.newest,
        "read": sorted(tracker.buffer.read),
        "events": [asdict(e) for e in tracker.log.last],
        "counts": tracker.log.counts,
        "unknown_channels": sorted(tracker._unknown_channels),
        "waiting": _entries(tracker.buffer.waiting, "waiting", arrays),
        "settling": _entries(tracker._settling, "settling", arrays),
        "commands": {},
        "beginning": _beginning_table(f, arrays),
    }
    for channel, own in tracker.commands.memory.items():
        document["commands"][channel] = [t for t, _ in own]
        if own:
            arrays[f"command:{channel}"] = np.array([x for _, x in own])
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo("tracker.json", EARLIEST), json.dumps(document))
        for name, value in arrays.items():
            own_buffer = io.BytesIO()
            np.save(own_buffer, value, allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy", EARLIEST), own_buffer.getvalue())
    return atomic_write(path, buffer.getvalue())


def load_tracker(path: str | os.PathLike[str], description: Description) -> Tracker:
    """Restore a tracker of a description; it goes on as if it had never stopped.

    Raises `RecordingError` when there is no such file, it is none of a tracker, of another version, or of
    another description.
    """
    document, arrays = _read(path)
    if document.get("version") != VERSION:
        raise RecordingError(
            f"'{path}' is a tracker of version {document.get('version')}; this smsid reads {VERSION}.",
            advice="Restore it with the smsid that saved it, or start anew from an estimate.",
            path=str(path),
        )
    if document["description"] != description_digest(description):
        raise RecordingError(
            f"'{path}' was saved with another description than '{description.name}'.",
            advice="Give the description it was started with.",
            path=str(path),
        )
    tracker = Tracker.__new__(Tracker)
    tracker.described, tracker.listener, tracker.rescue = description, None, None
    tracker.course = Course()
    tracker.description = modal_panels(description)[0]
    tracker.setting = SETTING.validate_python(document["setting"])
    followed, held = FOLLOWED.validate_python(document["followed"]), HELD.validate_python(document["held"])
    notes = tuple(document["notes"])
    start = StartingPoint(followed, arrays["start_mean"], arrays["start_covariance"], notes, held)
    tracker._build(Point.of(tracker.description), start)
    f = tracker.filter
    for name in STATE:
        setattr(f, name, arrays[name])
    f.time, f.rebuilt = document["time"], document["rebuilt"]
    renewed = Linearisation(f.origin, followed, arrays["renewed"], f.layout, f.locked)
    f.at = Linearisation(f.origin, followed, arrays["linearised"], f.layout, f.locked, renewed, np.inf)
    f.known_at = arrays["known_at"]
    if document["beginning"] is not None:
        _restore_beginning(f, document["beginning"], arrays)
    watch = document["watch"]
    squares = {name: (mean, count) for name, (mean, count) in watch["squares"].items()}
    tracker.watch = FitWatch(
        watch["widening"], watch["component"], squares, watch.get("apart", 1.0), watch.get("seconds", 0.0)
    )
    tracker._first, tracker._looks = document["first"], document["looks"]
    tracker.moving, tracker.samples = document["moving"], document["samples"]
    tracker._before = arrays.get("before")
    tracker._unknown_channels = set(document["unknown_channels"])
    buffer = tracker.buffer
    buffer.passed, buffer.newest = document["passed"], document["newest"]
    buffer.read = set(document["read"])
    buffer.waiting = _restore_events(document["waiting"], "waiting", arrays)
    tracker._settling = _restore_events(document["settling"], "settling", arrays)
    tracker.log.last.extend(Event(**e) for e in document["events"])
    tracker.log.counts.update(document["counts"])
    for channel, times in document["commands"].items():
        if times:
            tracker.commands.memory[channel] = deque(
                zip(times, list(arrays[f"command:{channel}"]), strict=True)
            )
    return tracker


def _beginning_table(f: ParameterFilter, arrays: dict[str, np.ndarray]) -> dict[str, Any] | None:
    """Return what there is to say of a beginning that may be filtered again; its arrays are added."""
    begun, passes = f.begun, f.since
    if begun is None:
        return None
    for name in STATE:
        arrays[f"begun:{name}"] = getattr(begun, name)
    rows = [(edges, values, attitudes, *drive[:8]) for edges, drive, values, attitudes, _ in passes]
    for k, name in enumerate(PASSED):
        arrays[f"since:{name}"] = np.concatenate([np.zeros(0), *(row[k].ravel() for row in rows)])
    shapes = [[x.shape for x in row] for row in rows]
    arrays["begun:offset"] = f.offset
    told: dict[str, Any] = {"commanded": []}
    if f.at.drives:  # what commands do is asked again
        kept: list[Inputs] = []
        for *_, (inputs, substep) in passes:
            k = next((i for i, x in enumerate(kept) if x is inputs), len(kept))
            kept += [inputs] * (k == len(kept))
            told["commanded"].append((k, substep))
        told["inputs"] = [_signals(inputs, k, arrays) for k, inputs in enumerate(kept)]
    return told | {"time": begun.time, "shapes": shapes, "again": f.again, "moved": f.moved}


def _signals(inputs: Inputs, number: int, arrays: dict[str, np.ndarray]) -> dict[str, int | None]:
    """Return degrees of the signals by what they command, ``None`` of a constant; their arrays are added."""
    out: dict[str, int | None] = {}
    for name, signal in vars(inputs).items():
        key = f"input{number}:{name}"
        if isinstance(signal, Constant):
            out[name], arrays[f"{key}:c"] = None, signal.value
        elif isinstance(signal, Sampled):
            out[name] = signal.degree
            arrays |= {f"{key}:t": signal.spline.t, f"{key}:c": signal.spline.c}
            arrays[f"{key}:knots"] = np.array(signal.knots, dtype=float)
    return out


def _inputs(told: dict[str, int | None], number: int, arrays: dict[str, np.ndarray]) -> Inputs:
    signals: dict[str, Signal] = {}
    for name, degree in told.items():
        key = f"input{number}:{name}"
        if degree is None:
            signals[name] = Constant(arrays[f"{key}:c"])
            continue
        spline = BSpline(arrays[f"{key}:t"], arrays[f"{key}:c"], degree)
        signals[name] = Sampled(spline, degree, tuple(arrays[f"{key}:knots"].tolist()))
    return Inputs(**signals)  # type: ignore[arg-type]


def _restore_beginning(f: ParameterFilter, told: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
    f.begun = f.snapshot()
    for name in STATE:
        setattr(f.begun, name, arrays[f"begun:{name}"])
    f.begun.time, f.again, f.moved = told["time"], told["again"], told["moved"]
    f.offset = arrays["begun:offset"]
    own = []
    for k, name in enumerate(PASSED):
        sizes = [int(np.prod(shapes[k])) for shapes in told["shapes"]]
        parts = np.split(arrays[f"since:{name}"], np.cumsum(sizes)[:-1]) if sizes else []
        own.append([x.reshape(shapes[k]) for x, shapes in zip(parts, told["shapes"], strict=True)])
    inputs = [_inputs(x, k, arrays) for k, x in enumerate(told.get("inputs", ()))]
    commanded = [(inputs[k], substep) for k, substep in told["commanded"]] or [()] * len(told["shapes"])
    no_jumps = np.zeros((0, f.nv))  # a tracker takes commands for jumping at samples
    for (edges, values, attitudes, *drive), asked in zip(zip(*own, strict=True), commanded, strict=True):
        drives = Drive._make((*drive, no_jumps, *f.forces, f.input_noise))
        f.since.append((edges, drives, values, attitudes, asked))


def description_digest(description: Description) -> str:
    """Return a digest of a description: its tables and the URDFs they name."""
    found = hashlib.sha256(description.model_dump_json(exclude={"folder"}).encode())
    urdfs = [description.urdf, *(a.urdf for a in description.arm)]
    for name in urdfs:
        file = Path(description.folder) / str(name) if name is not None else None
        if file is not None and file.is_file():
            found.update(file.read_bytes())
    return found.hexdigest()


def _read(path: str | os.PathLike[str]) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    try:
        with zipfile.ZipFile(path) as archive:
            document = json.loads(archive.read("tracker.json"))
            names = [n for n in archive.namelist() if n.endswith(".npy")]
            arrays = {
                n.removesuffix(".npy"): np.load(io.BytesIO(archive.read(n)), allow_pickle=False)
                for n in names
            }
    except (OSError, KeyError, ValueError, RecursionError, zipfile.BadZipFile) as error:
        raise RecordingError(
            f"'{path}' is no saved tracker: {error}.", advice="Give a file of save_tracker.", path=str(path)
        ) from error
    if document.get("schema") != SCHEMA:
        raise RecordingError(
            f"'{path}' is no saved tracker.", advice="Give a file of save_tracker.", path=str(path)
        )
    return document, arrays


def _entries(entries: list[MomentEvents], prefix: str, arrays: dict[str, np.ndarray]) -> list[dict[str, Any]]:
    out = []
    for i, entry in enumerate(entries):
        for channel, value in entry.channels.items():
            arrays[f"{prefix}{i}:{channel}"] = value
        out.append({"time": entry.time, "channels": list(entry.channels)})
    return out


def _restore_events(
    table: list[dict[str, Any]], prefix: str, arrays: dict[str, np.ndarray]
) -> list[MomentEvents]:
    return [
        MomentEvents(e["time"], {c: arrays[f"{prefix}{i}:{c}"] for c in e["channels"]})
        for i, e in enumerate(table)
    ]
