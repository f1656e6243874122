"""Which channels of a recording tell of which part of the motion."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from smsid.errors import RecordingError
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording
from smsid.sensing.sensor import Sensor
from smsid.view.motion import interpolate

Samples = tuple[np.ndarray, np.ndarray]
"""Times (N,) [s] and values (N, ...)."""


def channel(recording: Recording, name: str) -> Samples:
    """Return time and values of a channel, samples that are not finite left out.

    Raises `RecordingError` when there is no finite sample.
    """
    t, values = recording.time(name), recording[name]
    good = np.isfinite(values.reshape(len(t), -1)).all(axis=1) & np.isfinite(t)
    if not good.any():
        raise RecordingError(
            f"'{name}' has no finite sample.", advice="Leave it out or mend it.", channel=name
        )
    return np.asarray(t[good]), np.asarray(values[good])


def sources(model: SpacecraftModel, kind: str, default: str) -> Iterator[tuple[str, np.ndarray]]:
    """Yield names and positions (3,) [m] of the sensors that may have recorded a quantity."""
    sensors: tuple[Sensor, ...] = model.description.sensor
    for sensor in sensors:
        if sensor.kind == kind:
            yield sensor.name, np.asarray(sensor.position)
    if all(sensor.name != default for sensor in sensors):
        yield default, np.zeros(3)


def measured_samples(
    model: SpacecraftModel, recording: Recording, kind: str, default: str, quantity: str
) -> tuple[Samples, np.ndarray] | None:
    """Return the samples of a quantity, from the first source that has it, and where (3,) [m] that sits."""
    for name, position in sources(model, kind, default):
        if f"{name}.{quantity}" in recording:
            return channel(recording, f"{name}.{quantity}"), position
    return None


def commanded_samples(recording: Recording, quantity: str) -> Samples | None:
    """Return the samples of a force or torque: what was commanded, else what any source has of it."""
    names = [f"command.{quantity}", *(c for c in recording.channels if c.endswith(f".{quantity}"))]
    return next((channel(recording, n) for n in names if n in recording), None)


def hidden_coordinates(recording: Recording, quantity: str, *, together: bool) -> Samples | None:
    """Return slosh or modal coordinates (N, columns), of the truth first; None if not recorded.

    Several tanks may have a channel each (``together``); several sources of modes tell the same.
    """
    names = [c for c in recording.channels if c.endswith(f".{quantity}")]
    if not names:
        return None
    names.sort(key=lambda c: not c.startswith("truth."))
    t, values = channel(recording, names[0])
    same = names if together else [n for n in names if n.split(".")[0] == names[0].split(".")[0]]
    columns = [values.reshape(len(t), -1)]
    columns += [interpolate(*channel(recording, n), t).reshape(len(t), -1) for n in same[1:]]
    return t, np.concatenate(columns, axis=1)
