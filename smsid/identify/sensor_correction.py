"""Readings without the errors that the description knows: bias, scale, misalignment, what is stuck."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from smsid.recording import Recording
from smsid.sensing import Sensor
from smsid.sensing.component import place_of
from smsid.sensing.error_model import ErrorModel
from smsid.sensing.signals import resample

ROUNDS = 20  # of a fixed-point iteration; what a scale that depends on the rate leaves shrinks by its size


def correct_readings(recording: Recording, sensors: Sequence[Sensor]) -> Recording:
    """Return what perfect sensors would have read, but for noise; what is stuck becomes not a number.

    ``sensors`` as `Description.effective_sensors` gives them. Delays and clocks stay: they are in the times
    (`smsid.identify.clocks.event_times`). A recording whose sensors have no known error comes out as it is.
    """
    channels = {}
    for sensor in sensors:
        for quantity, name in zip(sensor.quantities, sensor.channels, strict=True):
            error = sensor.error(quantity)
            if name in recording and _has_known_error(error):
                times = recording.time(name)
                channels[name] = (times, _undone(error, times, np.array(recording[name]), quantity))
    return recording.with_channels(channels) if channels else recording


def without_known_errors(recording: Recording, sensors: Sequence[Sensor]) -> Recording:
    """Return what perfect sensors would have read, but for noise, at the times at which it happened.

    By it channels are checked against each other: a delay that is described is no contradiction.
    """
    return on_event_clocks(correct_readings(recording, sensors), sensors)


def on_event_clocks(recording: Recording, sensors: Sequence[Sensor]) -> Recording:
    """Return a recording with each channel interpolated to when what it reports happened, as described."""
    channels = {}
    for sensor in sensors:
        for quantity, name in zip(sensor.quantities, sensor.channels, strict=True):
            lag = sensor.error(quantity).lag
            if name in recording and lag:
                times, values = recording.time(name), np.array(recording[name])
                good = np.isfinite(values.reshape(len(values), -1)).all(axis=1)
                if good.sum() > 1:
                    own = times[good]
                    at, attitude = np.clip(times + lag, own[0], own[-1]), quantity == "attitude"
                    channels[name] = (times, resample(own, values[good], at, attitude=attitude))
    return recording.with_channels(channels) if channels else recording


def _has_known_error(error: ErrorModel) -> bool:
    parts = [error, *error.components.values()]
    terms = ("bias", "scale_error", "misalignment")
    fixed = any(np.any(getattr(p, term)) for p in parts for term in terms)
    return fixed or any(p.stuck_from is not None for p in parts) or _bent(error)


def _bent(error: ErrorModel) -> bool:
    return any(np.any(p.scale_slope) for p in (error, *error.components.values()))


def _undone(error: ErrorModel, times: np.ndarray, values: np.ndarray, quantity: str) -> np.ndarray:
    """Undo, in reverse order, what `ErrorModel.systematic` does: (N, ...)."""
    parts = {k: p.model_copy(update={"stuck_from": None}) for k, p in error.components.items()}
    moving = error.model_copy(update={"stuck_from": None, "components": parts})
    if quantity == "attitude":
        unit = np.tile([0.0, 0.0, 0.0, 1.0], (len(times), 1))
        added = moving.systematic(times, unit, True, delayed=True)
        good = np.flatnonzero(np.isfinite(values).all(axis=1))
        values[good] = (Rotation.from_quat(values[good]) * Rotation.from_quat(added[good]).inv()).as_quat()
    else:
        parts = {k: p.model_copy(update={"misalignment": 0.0}) for k, p in parts.items()}
        straight = moving.model_copy(update={"misalignment": (0.0, 0.0, 0.0), "components": parts})
        bias = straight.systematic(times, np.zeros(values.shape), delayed=True)
        factor = straight.systematic(times, np.ones(values.shape), delayed=True) - bias
        read, values = values, (values - bias) / factor
        for _ in range(ROUNDS if _bent(error) else 0):
            again = straight.systematic(times, np.nan_to_num(values), delayed=True)
            values = values - (again - read) / factor
        if error.misaligned:
            turned = Rotation.from_rotvec(error.turns(values.shape).reshape(-1, 3)).as_matrix()
            apart = values.reshape(len(values), -1, 3)
            values = np.einsum("kij,nkj->nki", turned, apart).reshape(values.shape)
    if error.stuck_from is not None:
        values[times >= error.stuck_from] = np.nan
    for key, part in error.components.items():
        if part.stuck_from is not None:
            column = values[place_of(key, values.shape)]
            column[times >= part.stuck_from] = np.nan
    return values
