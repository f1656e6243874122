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
        """Find the sensors whose channels the recording has; ``joints``: encoders and tachometers are needed.

        Raises `RecordingError` naming what is missing.
        """

        known = model.description.effective_sensors()

        def find(kind: str, quantities: tuple[str, ...], needed: bool) -> Sensor | None:
            sensors = [s for s in known if s.kind == kind and set(quantities) <= set(s.quantities)]
            found = [s for s in sensors if all(f"{s.name}.{q}" in recording for q in quantities)]
            if found:
                return min(found, key=lambda s: _noise(s, quantities[0]))
            if needed:
                wanted = [f"{s.name}.{q}" for s in sensors for q in quantities]
                raise RecordingError(
                    f"Recording '{recording.name}' has no {kind} with {', '.join(quantities)}.",
                    advice=f"It needs the channels {', '.join(wanted)}."
                    if wanted
                    else f"The description needs a sensor of kind '{kind}' that measures them.",
                    missing=wanted,
                    present=list(recording.channels),
                    other_flight=True,
                )
            return None

        imu = find("imu", ("acceleration", "angular_rate"), True)
        assert imu is not None
        panels = {
            str(s.appendage): s
            for s in known
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


def _noise(sensor: Sensor, quantity: str) -> float:
    """White noise of a quantity as a density, [unit/sqrt(Hz)]: of several sensors the quietest is used."""
    return float(np.max(sensor.error(quantity).white_sigma(sensor.rate))) / np.sqrt(sensor.rate)
