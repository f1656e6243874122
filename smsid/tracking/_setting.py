"""How a spacecraft's telemetry is taken: what drives joints, noise levels, and when it counts as stopped."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from smsid.description.schema import Description
from smsid.errors import RecordingError
from smsid.estimation.flight import Flight, longest_step
from smsid.estimation.gaps import bridge_length
from smsid.estimation.initial_state import InitialPrior
from smsid.estimation.input_hold import VARYING
from smsid.estimation.measurements import ChannelSlice, Measurements, _block, component_labels, stated_noise
from smsid.estimation.problem import ProcessNoise, UnknownInput
from smsid.model.spacecraft import SpacecraftModel


@dataclass(frozen=True)
class Setting:
    """What a tracker takes for granted of the telemetry.

    ``channels`` are those read, in order, with one standard deviation of each component's white ``sigma`` at
    a sample; ``locked`` degrees of freedom (indices in v) stand still; ``unknown_inputs`` are forces that
    nobody records. Commands are ``held`` until the next one, or vary linearly in between. Samples may come
    late by ``lateness`` [s]. After a silence of ``silence`` [s] the motion is begun anew from what is read
    then; what is known of the parameters stays. Where forces are unknown it is shorter
    (`smsid.estimation.gaps.bridge_length`).
    """

    channels: tuple[str, ...]
    sigma: tuple[float, ...]
    locked: tuple[int, ...] = ()
    unknown_inputs: tuple[UnknownInput, ...] = ()
    noise: ProcessNoise = field(default_factory=ProcessNoise)
    hold: Literal["held", "linear"] = "held"
    longest: float = 0.1
    substep: float = 0.025
    lateness: float = 0.0
    silence: float = 10.0
    initial: InitialPrior = field(default_factory=InitialPrior)

    @classmethod
    def of(
        cls,
        description: Description,
        model: SpacecraftModel,
        *,
        channels: tuple[str, ...] | None = None,
        hold: Literal["held", "linear"] = "held",
    ) -> Setting:
        """Return the setting of a spacecraft all of whose joints and wheels are driven by recorded commands.

        Noise is what the description states of its sensors. Raises `RecordingError` for a sensor without.
        """
        names, sigma = [], []
        for sensor in description.effective_sensors():
            for quantity in sensor.quantities:
                channel = f"{sensor.name}.{quantity}"
                width = len(component_labels(model, sensor, quantity))
                if (channels is not None and channel not in channels) or not width:
                    continue
                shape = (1, width // 3, 3) if sensor.kind == "accelerometers" else (1, width)
                own = stated_noise(sensor, quantity, sensor.rate, shape)
                if not (own > 0.0).all():
                    raise RecordingError(
                        f"The description does not state the noise of '{channel}'.",
                        advice="State noise_sigma, or start from a recording.",
                        channel=channel,
                    )
                names.append(channel)
                sigma += own.tolist()
        step = longest_step(model)
        return cls(tuple(names), tuple(sigma), hold=hold, longest=step, substep=min(0.025, step))

    @classmethod
    def of_flight(cls, flight: Flight) -> Setting:
        """Return the setting of a recording that was made ready for identification."""
        problem = flight.problem
        silence = min(cls.silence, bridge_length(problem))
        return cls(
            tuple(b.channel for b in problem.data.blocks),
            tuple(problem.data.sigma.tolist()),
            tuple(int(v) for v in problem.locked),
            problem.unknown_inputs,
            problem.noise,
            "linear" if problem.timing.hold in VARYING else "held",
            longest_step(flight.model),
            problem.substep,
            silence=silence,
        )

    def layout(self, model: SpacecraftModel, description: Description) -> Measurements:
        """Return the channels as a filter needs them, without samples."""
        sensors = {s.name: s for s in description.effective_sensors()}
        blocks: list[ChannelSlice] = []
        start = 0
        for channel in self.channels:
            name, quantity = channel.split(".")
            sensor = sensors[name]
            labels = component_labels(model, sensor, quantity)
            width = len(labels)
            rows = slice(start, start + width)
            start = rows.stop
            names = tuple(f"{channel}[{x}]" for x in labels)
            stations = width // 3 if sensor.kind == "accelerometers" else 1
            blocks.append(_block(sensor, quantity, rows, stations, names))
        return Measurements(np.zeros(0), np.zeros((0, start)), {}, tuple(blocks), np.array(self.sigma))

    def with_motion(self, other: Setting) -> Setting:
        """Return the setting with joints driven as in another one, lateness as here, the shorter silence."""
        return replace(other, lateness=self.lateness, silence=min(self.silence, other.silence))
