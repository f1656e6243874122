"""Channels on a common clock: each filtered at its own rate, its known delay taken out, then interpolated."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from smsid._time_text import stamp_text
from smsid.errors import RecordingError
from smsid.recording import Recording
from smsid.recording.attitude import continuous
from smsid.sensing import Sensor, uniform_rate, zero_phase


def rate_of(recording: Recording, sensor: Sensor, quantity: str) -> float:
    """Return the sampling rate of a channel [Hz]; raises `RecordingError` if it is uneven."""
    channel = f"{sensor.name}.{quantity}"
    return uniform_rate(recording.time(channel), channel)


def event_times(recording: Recording, sensor: Sensor, quantity: str) -> np.ndarray:
    """Return when what a channel reports happened, (N,) [s]: its clock less described delay and offset."""
    return recording.time(f"{sensor.name}.{quantity}") - sensor.error(quantity).lag


def sample_channel(
    recording: Recording, sensor: Sensor, quantity: str, times: np.ndarray, cutoff: float | None
) -> np.ndarray:
    """Return a channel at ``times`` (M,) [s], (M, ...) in its unit and frame.

    Low-passed without phase at ``cutoff`` [Hz] at its own rate (a channel too slow to have anything above the
    cut-off is taken as it is), then by a cubic spline where its samples are not at ``times``. Quaternions
    come out continuous in sign, not normalised. Up to one of its samples beyond its ends, which is about
    what delays shift clocks by, the channel keeps its first and last value.

    Raises `RecordingError` for missing or uneven samples, and times the channel does not cover.
    """
    channel = f"{sensor.name}.{quantity}"
    values, own = recording[channel], event_times(recording, sensor, quantity)
    if quantity == "attitude":
        values = continuous(values)
    rate = rate_of(recording, sensor, quantity)
    if cutoff is not None and cutoff < 0.5 * rate and values.size:
        values = zero_phase(values, rate, cutoff)
    at = np.clip(np.searchsorted(own, times), 0, len(own) - 1)
    if np.array_equal(own[at], times):
        return values[at]
    slack = 1.0 / rate
    if times[0] < own[0] - slack or times[-1] > own[-1] + slack:
        raise RecordingError(
            f"'{channel}' runs from {stamp_text(own[0])} to {stamp_text(own[-1])} s; it is needed from "
            f"{stamp_text(times[0])} to {stamp_text(times[-1])} s.",
            advice="Record all sensors over the same time, or cut the recording with window().",
            channel=channel,
        )
    return np.asarray(CubicSpline(own, values, axis=0)(np.clip(times, own[0], own[-1])))


def common_times(
    recording: Recording, lead: tuple[Sensor, str], others: list[tuple[Sensor, str]]
) -> np.ndarray:
    """Return the samples (M,) [s] of the ``lead`` channel that all ``others`` cover.

    Raises `RecordingError` when they have no time in common.
    """
    clock = event_times(recording, *lead)
    spans = [event_times(recording, s, q) for s, q in others]
    start = max([t[0] for t in spans], default=clock[0])
    stop = min([t[-1] for t in spans], default=clock[-1])
    inside = clock[(clock >= start) & (clock <= stop)]
    if len(inside) < 2:
        names = ", ".join(f"{s.name}.{q}" for s, q in [lead, *others])
        raise RecordingError(
            f"The channels {names} have no time in common.",
            advice="Record them together.",
            start=start,
            stop=stop,
        )
    return inside
