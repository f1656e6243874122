"""Which sensor of a description plays which part in a recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from smsid.errors import RecordingError
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording
from smsid.sensing import Sensor


@dataclass(frozen=True)
class Roles:
    """Which sensor of the description plays which part. ``panels`` by appendage.

    ``pose`` gives position and velocity, ``attitude`` the attitude: a star tracker, say, or the same sensor.
    """

    pose: Sensor | None
    attitude: Sensor | None
    imu: Sensor
    encoder: Sensor | None
    tachometer: Sensor | None
    panels: dict[str, Sensor]

    @classmethod
    def of(cls, model: SpacecraftModel, recording: Recording, *, joints: bool = True) -> Roles:
        """Find the sensors that the paper's method takes, as far as the recording has their channels.

        ``joints``: encoders and tachometers are needed. Raises `RecordingError` naming what is missing.
        """

        def find(kind: str, quantities: tuple[str, ...], needed: bool) -> Sensor | None:
            return (needed_sensor if needed else find_sensor)(model, recording, kind, quantities)

        imu = needed_sensor(model, recording, "imu", ("acceleration", "angular_rate"))
        panels = {
            str(s.appendage): s
            for s in model.description.effective_sensors()
            if s.kind == "accelerometers" and f"{s.name}.acceleration" in recording
        }
        return cls(
            pose=find("pose", ("position", "velocity"), joints),
            attitude=find("pose", ("attitude",), joints),
            imu=imu,
            encoder=find(
                "encoder", ("joint_position", "joint_velocity"), joints and len(model.arm_joints) > 0
            ),
            tachometer=find("tachometer", ("wheel_rate",), joints and len(model.wheels) > 0),
            panels=panels,
        )


def find_sensor(
    model: SpacecraftModel, recording: Recording, kind: str, quantities: tuple[str, ...]
) -> Sensor | None:
    """Return the quietest sensor of a kind whose channels of these quantities the recording has, if any."""
    sensors = _described(model, kind, quantities)
    found = [s for s in sensors if all(f"{s.name}.{q}" in recording for q in quantities)]
    return min(found, key=lambda s: _noise(s, quantities[0]), default=None)


def needed_sensor(
    model: SpacecraftModel, recording: Recording, kind: str, quantities: tuple[str, ...]
) -> Sensor:
    """Return the same; raises `RecordingError` naming what is missing where there is none."""
    found = find_sensor(model, recording, kind, quantities)
    if found is not None:
        return found
    wanted = [f"{s.name}.{q}" for s in _described(model, kind, quantities) for q in quantities]
    raise RecordingError(
        f"Recording '{recording.name}' has no {kind} with {', '.join(quantities)}.",
        advice=f"It needs the channels {', '.join(wanted)}."
        if wanted
        else f"The description needs a sensor of kind '{kind}' that measures them.",
        missing=wanted,
        present=list(recording.channels),
        other_flight=True,
    )


def _described(model: SpacecraftModel, kind: str, quantities: tuple[str, ...]) -> list[Sensor]:
    known = model.description.effective_sensors()
    return [s for s in known if s.kind == kind and set(quantities) <= set(s.quantities)]


def _noise(sensor: Sensor, quantity: str) -> float:
    """White noise of a quantity as a density, [unit/sqrt(Hz)]: of several sensors the quietest is used."""
    return float(np.max(sensor.error(quantity).white_sigma(sensor.rate))) / np.sqrt(sensor.rate)
