"""Recordings of the twin as they should not be: faults of its sensors' channels, and of its commands."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from smsid.recording import Recording

SENSED = ("imu.", "pose.", "panel.", "encoder.", "tachometer.")
LATE, DRIFT = 0.03, 1e-3  # [s, 1] of a clock that does not agree with the others

Change = Callable[[str, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""What becomes of a channel: its name, times (N,) and values (N, ...), which may be written to."""


def changed(recording: Recording, change: Change) -> Recording:
    """The recording with every sensor's channel replaced by what ``change`` makes of it."""
    channels = {}
    for name in recording.channels:
        times, values = recording.time(name), np.array(recording[name])
        channels[name] = change(name, times, values) if name.startswith(SENSED) else (times, values)
    return Recording.from_arrays(
        None, channels, labels=recording.labels, role="estimation", name=recording.name
    )


def of(channels: tuple[str, ...], change: Change) -> Change:
    """The change of channels whose names begin so; the others stay."""

    def limited(name: str, times: np.ndarray, values: np.ndarray):
        return change(name, times, values) if name.startswith(channels) else (times, values)

    return limited


def outliers(name: str, times: np.ndarray, values: np.ndarray):
    """One sample in a hundred is off by 50 times what samples differ by; attitudes stay."""
    rng = np.random.default_rng(len(name))
    if name != "pose.attitude":
        rows = rng.random(len(values)) < 0.01
        size = 50.0 * np.std(np.diff(values, axis=0), axis=0)
        values[rows] += size * rng.choice([-1.0, 1.0], size=values[rows].shape)
    return times, values


def not_finite(begin: float, end: float) -> Change:
    """Samples within [begin, end] [s] are not a number."""

    def change(name: str, times: np.ndarray, values: np.ndarray):
        values[(times >= begin) & (times <= end)] = np.nan
        return times, values

    return change


def missing(begin: float, end: float) -> Change:
    """Samples within [begin, end] [s] are not there."""

    def change(name: str, times: np.ndarray, values: np.ndarray):
        kept = (times < begin) | (times > end)
        return times[kept], values[kept]

    return change


def saturated(*channels: str) -> Change:
    """Those channels end at 0.8 of their largest value."""

    def change(name: str, times: np.ndarray, values: np.ndarray):
        if name in channels:
            limit = 0.8 * np.abs(values).max()
            values = np.clip(values, -limit, limit)
        return times, values

    return change


def dead(channel: str) -> Change:
    """That channel says nothing for two thirds of the time."""

    def change(name: str, times: np.ndarray, values: np.ndarray):
        if name == channel:
            values[: 2 * len(values) // 3] = np.nan
        return times, values

    return change


def late(sensor: str) -> Change:
    """That sensor's clock is `LATE` and drifts by `DRIFT`."""

    def change(name: str, times: np.ndarray, values: np.ndarray):
        return (times * (1.0 + DRIFT) + LATE if name.startswith(f"{sensor}.") else times), values

    return change


def never_commanded(recording: Recording) -> Recording:
    """The recording with one commanded force that is not a number."""
    force = np.array(recording["command.force"])
    force[7] = np.nan
    return recording.with_channels({"command.force": force})
