"""What was tracked over time: parameters, motion and innovations with standard deviations; as netCDF."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from smsid._short_repr import short_repr
from smsid._time_text import time_text
from smsid.errors import RecordingError, require
from smsid.identify.estimate import Estimate, classify
from smsid.tracking._sample_buffer import Event

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

SCHEMA = "smsid.track"
VERSION = 1
KNOWN = (
    ("value", "values", "parameter"),
    ("sigma", "sigmas", "parameter"),
    *((name, name, "dof") for name in ("position", "position_sigma", "velocity", "velocity_sigma")),
)  # name in a file, field, second dimension; "smoothed_" before the name of what is known in the end
FALSE_ALARMS = 0.1  # per hour, where changes are asked for


@short_repr
@dataclass(frozen=True, eq=False)
class SmoothedTrack:
    """What is known of each time of a history from all that was read, before and after (fixed interval).

    ``values``, ``sigmas`` (N, m) of the parameters, ``position``, ``velocity`` (N, nv) with their standard
    deviations: as in `TrackHistory`.
    """

    values: np.ndarray
    sigmas: np.ndarray
    position: np.ndarray
    position_sigma: np.ndarray
    velocity: np.ndarray
    velocity_sigma: np.ndarray


@short_repr
@dataclass(frozen=True, eq=False)
class TrackHistory:
    """Tracked quantities at ``time`` (N,) [s], counted on through all recordings.

    ``recording`` (N,) says which, ``own_time`` (N,) [s] by its own clock. ``values``, ``sigmas`` (N, m) are
    of the parameters ``names``, ``described`` (m,) the description's; ``position``, ``velocity`` (N, nv) with
    their standard deviations of the degrees of freedom ``dofs`` (of a free bus: place [m] and attitude as
    rotation vector [rad], twist in body axes [m/s, rad/s]). ``fit`` (N, channels) is the root mean square of
    the normalised innovations since the time before: one while the model is right. ``covariance`` (m, m) is
    that of the parameters at the end. ``smoothed`` is what is known of each time from all that was read,
    where that was asked for.
    """

    description: str
    time: np.ndarray
    own_time: np.ndarray
    recording: np.ndarray
    recordings: tuple[str, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    described: np.ndarray
    values: np.ndarray
    sigmas: np.ndarray
    dofs: tuple[str, ...]
    position: np.ndarray
    position_sigma: np.ndarray
    velocity: np.ndarray
    velocity_sigma: np.ndarray
    channels: tuple[str, ...]
    fit: np.ndarray
    covariance: np.ndarray
    events: tuple[Event, ...] = ()
    notes: tuple[str, ...] = ()
    conditions: Mapping[str, float] = field(default_factory=dict)
    smoothed: SmoothedTrack | None = None

    def estimate(self) -> Estimate:
        """Return what is known at the end, as an estimate with its covariance; trends are no part of it."""
        trends = {f"{name}.trend" for name in self.names}
        kept = [i for i, name in enumerate(self.names) if name not in trends]
        table = zip(self.names, self.values[-1], self.units, self.sigmas[-1], self.described, strict=True)
        parameters = [
            classify(n, float(x), u, float(s), "tracked", nominal=float(d)) for n, x, u, s, d in table
        ]
        return Estimate(
            self.description,
            "tracking",
            tuple(parameters[i] for i in kept),
            self.recordings,
            notes=self.notes,
            covariance=self.covariance[np.ix_(kept, kept)],
        )

    def to_dataframe(self) -> pd.DataFrame:
        """Return the parameters over time [s] as a table of pandas; ``<name> sigma`` beside each.

        Raises:
            MissingDependencyError: pandas is not installed (``smsid[pandas]``).
        """
        pandas = require("pandas", "pandas")
        columns = {}
        for i, name in enumerate(self.names):
            columns |= {name: self.values[:, i], f"{name} sigma": self.sigmas[:, i]}
        return pandas.DataFrame(columns, index=pandas.Index(self.time, name="time"))

    def to_dataset(self) -> xr.Dataset:
        """Return the history as a dataset of xarray."""
        import xarray as xr

        variables: dict[str, Any] = {
            "own_time": ("time", self.own_time, {"unit": "s"}),
            "recording": ("time", self.recording),
            "described": ("parameter", self.described),
            "covariance": (("parameter", "parameter_too"), self.covariance),
            "fit": (("time", "channel"), self.fit),
        }
        for prefix, own in (("", self), ("smoothed_", self.smoothed)):
            if own is not None:
                variables |= {f"{prefix}{n}": (("time", second), getattr(own, k)) for n, k, second in KNOWN}
        coordinates = {
            "time": ("time", self.time, {"unit": "s"}),
            "parameter": list(self.names),
            "unit": ("parameter", list(self.units)),
            "dof": list(self.dofs),
            "channel": list(self.channels),
        }
        attributes = {
            "schema": SCHEMA,
            "schema_version": VERSION,
            "description": self.description,
            "recordings": list(self.recordings) or [""],
            "events": [f"{time_text(e.time)}: {e.kind}: {e.channel}: {e.text}" for e in self.events] or [""],
            "notes": list(self.notes) or [""],
        }
        return xr.Dataset(variables, coordinates, attributes)


def save_history(history: TrackHistory, path: str | os.PathLike[str]) -> Path:
    """Write a history to a netCDF-4 file, whole or not at all, and return its path.

    Raises `OutputError` when the file cannot be written.
    """
    from smsid.recording.storage import save_dataset

    return save_dataset(history.to_dataset(), path)


def load_history(path: str | os.PathLike[str]) -> TrackHistory:
    """Load a history that `save_history` wrote; raises `RecordingError` for a file that holds none."""
    from smsid.recording.storage import read_dataset

    found = read_dataset(path)
    if found.attrs.get("schema") != SCHEMA:
        raise RecordingError(f"'{path}' is no track.", advice="Make one with `smsid track`.")
    try:
        return _history(found)
    except (LookupError, ValueError, AttributeError) as error:
        raise RecordingError(
            f"'{path}' is no whole track: {error}.", advice="Make it again with `smsid track`."
        ) from error


def _history(found: xr.Dataset) -> TrackHistory:
    words = {
        key: [str(x) for x in np.atleast_1d(found.attrs[key]) if x]
        for key in ("recordings", "events", "notes")
    }
    arrays = {
        key: found[key].values for key in ("time", "own_time", "recording", "described", "fit", "covariance")
    }
    smoothed = None
    if "smoothed_value" in found:
        smoothed = SmoothedTrack(**{key: found[f"smoothed_{name}"].values for name, key, _ in KNOWN})
    arrays |= {key: found[name].values for name, key, _ in KNOWN}
    return TrackHistory(
        description=str(found.attrs["description"]),
        recordings=tuple(words["recordings"]),
        names=tuple(map(str, found["parameter"].values)),
        units=tuple(map(str, found["unit"].values)),
        dofs=tuple(map(str, found["dof"].values)),
        channels=tuple(map(str, found["channel"].values)),
        events=tuple(map(_event, words["events"])),
        notes=tuple(words["notes"]),
        smoothed=smoothed,
        **arrays,  # type: ignore[arg-type]
    )


def _event(text: str) -> Event:
    time, kind, channel, told = re.fullmatch(r"(\S+) s: ([^:]*): ([^:]*): (.*)", text, re.DOTALL).groups()  # type: ignore[union-attr]
    return Event(float(time), kind, channel, told)
