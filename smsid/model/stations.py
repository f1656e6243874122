"""Where on an appendage a sensor's stations are."""

from __future__ import annotations

import numpy as np

from smsid.effects.assembly import AppendageJoints
from smsid.errors import DescriptionError
from smsid.model.spacecraft import SpacecraftModel
from smsid.sensing.sensor import Sensor


def find_appendage(model: SpacecraftModel, name: str) -> AppendageJoints:
    """Return an appendage by name; raises `DescriptionError`."""
    for found in model.appendages:
        if found.appendage.name == name:
            return found
    raise DescriptionError(
        f"There is no appendage '{name}'.",
        advice=f"Appendages: {', '.join(a.appendage.name for a in model.appendages) or 'none'}.",
    )


def station_indices(panel: AppendageJoints, sensor: Sensor) -> np.ndarray:
    """Return which stations of the appendage a sensor uses, indices (k,), found by their distances.

    Raises `DescriptionError` for a station the appendage does not have.
    """
    positions = panel.appendage.station_positions()
    if sensor.stations is None:
        return np.arange(len(positions))
    chosen = []
    for station in sensor.stations:
        if isinstance(station, int):
            near = station if 0 <= station < len(positions) else -1
        else:
            gaps = np.abs(np.linalg.norm(positions, axis=1) - station)
            near = int(np.argmin(gaps)) if len(gaps) and gaps.min() < 1e-6 else -1
        if near < 0:
            raise DescriptionError(
                f"Sensor '{sensor.name}': there is no station {station} on '{panel.appendage.name}'.",
                advice=f"Its stations are at {positions.tolist()}.",
            )
        chosen.append(near)
    return np.array(chosen)
