"""What the sensors make of a motion: a recording from exact values, or noise on one that has none."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from smsid._listing import did_you_mean
from smsid.errors import RecordingError
from smsid.sensing.filters import uniform_rate
from smsid.sensing.sensor import Sensor
from smsid.sensing.signals import FloatArray, resample

if TYPE_CHECKING:
    from smsid.recording import Recording

Truth = Callable[[FloatArray], Mapping[str, FloatArray]]


def observe(
    truth: Truth,
    sensors: Sequence[Sensor],
    *,
    start: float,
    stop: float,
    rng: np.random.Generator,
    exact: Sequence[str] = (),
    rate: float | None = None,
    labels: Mapping[str, Sequence[str]] | None = None,
    role: str = "estimation",
    name: str = "",
    provenance: Mapping[str, Any] | None = None,
    known_until: float | None = None,
) -> Recording:
    """Return what the sensors record between ``start`` and ``stop``.

    Each sensor is sampled at its own rate, and its delay and time offset are exact: the truth is asked at
    ``t - delay - time_offset`` (at ``start`` before that, at ``known_until`` after that). Sensors at
    ``rate`` share the recording's ``time``; any other has its own clock. The noise of a channel depends
    on ``rng`` and the channel's name alone, so adding, dropping or reordering sensors does not change
    that of the others; calling again with the same generator gives fresh noise.

    Args:
        truth: takes (N,) times [s], not decreasing and perhaps repeated, and returns exact values by channel
            name, ``<sensor>.<quantity>``, (N, ...) in the unit and frame of the quantity (body vectors in the
            bus frame) at the sensor's position or stations.
        sensors: what to record with; names differ.
        start: time of the first sample [s].
        stop: time of the last sample, if the rate meets it [s].
        rng: source of every draw; it needs a seed sequence (`numpy.random.default_rng` has one).
        exact: channels of the truth recorded as they are at ``rate``, such as ``command.force``.
        rate: rate of the shared clock [Hz]; by default the highest of the sensors'.
        labels: names of columns, handed to the recording.
        role: ``estimation`` or ``validation``, handed to the recording.
        name: of the recording.
        provenance: more to remember; sensors and seed are always noted.
        known_until: last time the truth can be asked for [s]; ``stop`` when not given. A clock that is ahead
            reports what happens after ``stop``.

    Raises:
        RecordingError: a channel that the truth does not give, two sensors of one name, no samples between
            start and stop, or values of a shape that does not fit.
        DescriptionError: an error model that does not fit its quantity.
    """
    _unique(sensors)
    if rate is None:
        if not sensors:
            raise RecordingError(
                "No sensors and no rate are given.", advice="Pass rate for the shared clock."
            )
        rate = max(s.rate for s in sensors)
    shared = sample_times(start, stop, rate)
    last = stop if known_until is None else known_until
    streams = NoiseStreams(rng)
    evaluated: dict[tuple[float, float], Mapping[str, FloatArray]] = {}

    def true_values(channel: str, sampling: float, times: FloatArray, delay: float) -> FloatArray:
        if (sampling, delay) not in evaluated:
            evaluated[sampling, delay] = truth(np.clip(times - delay, start, last))
        return _lookup(evaluated[sampling, delay], channel)

    channels: dict[str, Any] = {}
    for sensor in sensors:
        times = shared if sensor.rate == rate else sample_times(start, stop, sensor.rate)
        for quantity, channel in zip(sensor.quantities, sensor.channels, strict=True):
            ideal = true_values(channel, sensor.rate, times, sensor.error(quantity).lag)
            measured = sensor.measure(quantity, times, ideal, streams.generator(channel), delayed=True)
            channels[channel] = measured if times is shared else (times, measured)
    for channel in exact:
        if channel in channels:
            raise RecordingError(
                f"'{channel}' is asked exact and measured.", advice="Take it out of exact.", channel=channel
            )
        channels[channel] = np.array(true_values(channel, rate, shared, 0.0), dtype=float)
    note = {**(provenance or {}), "sensing": {**_note(sensors, streams), "start": start, "stop": stop}}
    # Describing a sensor must not load the file formats, hence the import here.
    from smsid.recording import Recording

    time = shared if any(not isinstance(values, tuple) for values in channels.values()) else None
    return Recording.from_arrays(time, channels, labels=labels, provenance=note, role=role, name=name)


def add_noise(recording: Recording, sensors: Sequence[Sensor], rng: np.random.Generator) -> Recording:
    """Return a noise-free recording, of another engine say, as the sensors would have made it.

    The recording must hold the channels of every sensor. A sensor slower than the recording is resampled to
    its own clock; one as fast or faster is sampled where the recording is, with the noise of that rate.
    Delays and resampling interpolate (cubic spline, slerp). Channels of a sensor's source that it does not
    measure are dropped, as they would pass for exact measurements, and listed in the provenance; all
    others are kept.

    Args:
        recording: evenly sampled.
        sensors: what to measure with; names differ.
        rng: source of every draw, used as by `observe`.

    Raises:
        RecordingError: a channel is missing, unevenly sampled or not finite, or two sensors share a name.
        DescriptionError: an error model that does not fit its quantity.
    """
    _unique(sensors)
    streams = NoiseStreams(rng)
    names = {s.name for s in sensors}
    measured: dict[str, Any] = {}
    for sensor in sensors:
        for quantity, channel in zip(sensor.quantities, sensor.channels, strict=True):
            recording.require(channel)
            values = recording[channel]
            source = np.asarray(recording.time(channel), dtype=float)
            times = source
            if sensor.rate < uniform_rate(source, channel) * (1.0 - 1e-6):
                times = sample_times(float(source[0]), float(source[-1]), sensor.rate)
            delay = sensor.error(quantity).lag
            if delay != 0.0 or times is not source:
                values = resample(
                    source,
                    values,
                    np.clip(times - delay, source[0], source[-1]),
                    attitude=quantity == "attitude",
                )
            values = sensor.measure(quantity, times, values, streams.generator(channel), delayed=True)
            measured[channel] = values if times is source else (times, values)
    dropped = [c for c in recording.channels if c.split(".")[0] in names and c not in measured]
    note = {**_note(sensors, streams), "dropped": dropped}
    steps = [*recording.provenance.get("steps", []), {"add_noise": note}]
    kept = recording.without(*dropped) if dropped else recording
    return kept.with_channels(measured).with_provenance({"steps": steps})


def sample_times(start: float, stop: float, rate: float) -> FloatArray:
    """Return the sampling times ``start + k / rate`` up to and including ``stop``: (N,) [s].

    Raises:
        RecordingError: ``stop`` is before ``start``, or one of them or the rate is not a usable number.
    """
    if not (np.isfinite([start, stop, rate]).all() and rate > 0.0 and stop >= start):
        raise RecordingError(
            f"Nothing can be sampled from {start} to {stop} s at {rate} Hz.",
            advice="Give a stop after the start and a positive rate.",
            start=start,
            stop=stop,
            rate=rate,
        )
    return start + np.arange(int(np.floor((stop - start) * rate + 1e-6)) + 1) / rate


class NoiseStreams:
    """One generator per channel, from one child of ``rng`` and the channel's name."""

    def __init__(self, rng: np.random.Generator) -> None:
        """Spawn the child; ``rng`` needs a seed sequence."""
        root: Any = rng.spawn(1)[0].bit_generator.seed_seq
        self.entropy: Any = root.entropy
        self.key: tuple[int, ...] = tuple(root.spawn_key)

    def generator(self, channel: str) -> np.random.Generator:
        """Return a channel's generator, at its beginning."""
        key = (*self.key, zlib.crc32(channel.encode()))
        return np.random.default_rng(np.random.SeedSequence(self.entropy, spawn_key=key))


def _note(sensors: Sequence[Sensor], streams: NoiseStreams) -> dict[str, Any]:
    return {
        "sensors": [s.model_dump(mode="json", exclude_defaults=True) for s in sensors],
        # A string: an entropy of 128 bits does not fit the integers of every file format.
        "entropy": str(streams.entropy),
        "spawn_key": list(streams.key),
    }


def _unique(sensors: Sequence[Sensor]) -> None:
    names = [s.name for s in sensors]
    twice = sorted({n for n in names if names.count(n) > 1})
    if twice:
        raise RecordingError(
            f"Several sensors are called {', '.join(twice)}.", advice="Give each its own name.", names=names
        )


def _lookup(values: Mapping[str, FloatArray], channel: str) -> FloatArray:
    if channel not in values:
        raise RecordingError(
            f"The truth has no '{channel}'.{did_you_mean(channel, values)}",
            advice="Restrict the sensor with quantities, or supply it.",
            channel=channel,
            available=sorted(values),
        )
    return values[channel]
