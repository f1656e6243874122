"""What was tracked over time: parameters, motion and innovations with standard deviations; as netCDF."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from smsid._files import atomic_write, check_target
from smsid.errors import RecordingError
from smsid.tracking.sample_buffer import Event

if TYPE_CHECKING:
    import xarray as xr

SCHEMA = "smsid.track"
VERSION = 1


@dataclass(frozen=True, eq=False)
class TrackHistory:
    """Tracked quantities at ``time`` (N,) [s], counted on through all recordings.

    ``recording`` (N,) says which, ``own_time`` (N,) [s] by its own clock. ``values``, ``sigmas`` (N, m) are
    of the parameters ``names``, ``described`` (m,) the description's; ``position``, ``velocity`` (N, nv) with
    their standard deviations of the degrees of freedom ``dofs`` (of a free bus: place [m] and attitude as
    rotation vector [rad], twist in body axes [m/s, rad/s]). ``fit`` (N, channels) is the root mean square of
    the normalised innovations since the time before: one while the model is right. ``covariance`` (m, m) is
    that of the parameters at the end.
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

    def parameter(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return values and standard deviations (N,) of a parameter.

        Raises `RecordingError` for one that was not followed.
        """
        if name not in self.names:
            raise RecordingError(
                f"'{name}' was not followed.", advice=f"Followed were {', '.join(self.names)}."
            )
        i = self.names.index(name)
        return self.values[:, i], self.sigmas[:, i]

    def to_dataset(self) -> xr.Dataset:
        """Return the history as a dataset of xarray."""
        import xarray as xr

        def over(second: str) -> tuple[str, str]:
            return ("time", second)

        variables: dict[str, Any] = {
            "own_time": ("time", self.own_time, {"unit": "s"}),
            "recording": ("time", self.recording),
            "value": (over("parameter"), self.values),
            "sigma": (over("parameter"), self.sigmas),
            "described": ("parameter", self.described),
            "covariance": (("parameter", "parameter_too"), self.covariance),
            "position": (over("dof"), self.position),
            "position_sigma": (over("dof"), self.position_sigma),
            "velocity": (over("dof"), self.velocity),
            "velocity_sigma": (over("dof"), self.velocity_sigma),
            "fit": (over("channel"), self.fit),
        }
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
            "events": [f"{e.time:.6g} s: {e.kind}: {e.channel}: {e.text}" for e in self.events] or [""],
            "notes": list(self.notes) or [""],
        }
        return xr.Dataset(variables, coordinates, attributes)


def save_history(history: TrackHistory, path: str | os.PathLike[str]) -> Path:
    """Write a history to a netCDF-4 file, whole or not at all, and return its path.

    Raises `OutputError` when the file cannot be written.
    """
    check_target(path)
    content = history.to_dataset().to_netcdf(engine="h5netcdf")
    return atomic_write(path, bytes(content))
