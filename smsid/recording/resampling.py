"""Bringing the channels of a recording to other times."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from smsid._time_text import stamp_text
from smsid.errors import RecordingError
from smsid.recording import channel_checks
from smsid.recording._layout import clock_array
from smsid.recording.attitude import slerp
from smsid.recording.channels import quantity_of
from smsid.recording.clock import check_order, find_gaps

if TYPE_CHECKING:
    from smsid.recording.recording import Recording

FloatArray = NDArray[np.float64]
MOST_SAMPLES = 1e8  # 32 hours at 1 kHz
SAME_TIME = 1e-6  # share of a command's sample by which times may differ that are the same


def new_times(recording: Recording, rate_or_times: float | ArrayLike) -> FloatArray:
    """Give the times (M,) [s] that a rate [Hz] or the times themselves ask for, or raise `RecordingError`."""
    channel_checks.check_clocks(recording)
    if np.ndim(rate_or_times) > 0:
        times = clock_array(rate_or_times, "time")
        check_order(times, "time")
        return times
    rate = float(rate_or_times)  # type: ignore[arg-type]
    if not (np.isfinite(rate) and rate > 0.0):
        raise RecordingError(f"A rate of {rate} Hz is none.", advice="Give a positive rate in Hz.", rate=rate)
    spans = list(recording.times().values())
    start, end = max(float(t[0]) for t in spans), min(float(t[-1]) for t in spans)
    if start > end:
        raise RecordingError(
            f"The clocks {', '.join(recording.clocks)} have no time in common.",
            advice="Resample them apart, or correct their offset.",
            start=start,
            end=end,
        )
    if (end - start) * rate > MOST_SAMPLES:
        raise RecordingError(
            f"{rate:g} Hz over {end - start:g} s are {(end - start) * rate:.3g} samples, more than "
            f"{MOST_SAMPLES:.0e}.",
            advice="Give a lower rate in Hz, or is the clock in another unit?",
            rate=rate,
        )
    # The slack keeps the last sample when the span is a whole number of steps but for rounding.
    times = start + np.arange(int(np.floor((end - start) * rate * (1.0 + 1e-12) + 1e-6)) + 1) / rate
    return np.minimum(times, end)


def interpolate_channels(recording: Recording, times: FloatArray) -> dict[str, FloatArray]:
    """Interpolate every channel at ``times`` (M,) [s], or raise `RecordingError`.

    Commands are held or go on in straight lines as the recording says; where it does not, those that step
    are held, as a computer holds them: a valve is open or shut, never half.
    """
    said = recording.provenance.get("inputs")
    channel_checks.check_finite(recording)
    channel_checks.check_quaternions(recording)
    for clock, own in recording.times().items():
        _refuse_outside(own, clock, times)
    channels = {}
    for name in recording.channels:
        own, values = recording.time(name), recording[name]
        if quantity_of(name, unit=recording.unit(name)).is_quaternion:
            channels[name] = slerp(own, values, times)
        elif _is_command(name) and own.size > 1 and (said == "held" if said else switches(values)):
            channels[name] = values[np.searchsorted(own, times + 1e-9 * np.median(np.diff(own)), "right") - 1]
        else:
            channels[name] = linear(own, values, times)
    return channels


def keeps_knots(recording: Recording, times: FloatArray) -> bool:
    """Whether commands that are sampled at ``times`` (M,) [s] still act between samples as before: where all
    of their own samples in that span are among these.
    """
    for name in filter(_is_command, recording.channels):
        own = recording.time(name)
        inside = own[(own >= times[0]) & (own <= times[-1])]
        k = np.clip(np.searchsorted(times, inside), 1, times.size - 1) if times.size > 1 else 0
        nearest = np.minimum(np.abs(times[k] - inside), np.abs(times[np.maximum(k - 1, 0)] - inside))
        if own.size > 1 and np.any(nearest > SAME_TIME * np.median(np.diff(own))):
            return False
    return True


def _is_command(name: str) -> bool:
    return name.startswith("command.")


def switches(values: FloatArray) -> bool:
    """Whether a command (N, ...) stays as it is at most samples where it is not zero."""
    flat = values.reshape(len(values), -1)
    moves, acts = np.diff(flat, axis=0) != 0.0, flat[1:] != 0.0
    return bool(np.any(acts) and np.sum(moves & acts) < 0.5 * np.sum(acts))


def linear(t: FloatArray, values: FloatArray, at: FloatArray) -> FloatArray:
    """Interpolate linearly; t: (N,) [s], values: (N, ...), at: (M,) within ``t``; gives (M, ...)."""
    if t.size == 1:
        return np.repeat(values, at.size, axis=0)
    k = np.clip(np.searchsorted(t, at, side="right") - 1, 0, t.size - 2)
    shape = (-1, *([1] * (values.ndim - 1)))
    fraction = ((at - t[k]) / (t[k + 1] - t[k])).reshape(shape)
    return (1.0 - fraction) * values[k] + fraction * values[k + 1]


def _refuse_outside(own: FloatArray, clock: str, times: FloatArray) -> None:
    if times[0] < own[0] or times[-1] > own[-1]:
        raise RecordingError(
            f"Times from {stamp_text(times[0])} to {stamp_text(times[-1])} s are asked, but clock '{clock}' "
            f"runs from {stamp_text(own[0])} to {stamp_text(own[-1])} s.",
            advice="Nothing is extrapolated: choose times inside.",
            clock=clock,
            start=float(own[0]),
            end=float(own[-1]),
        )
    for gap in find_gaps(own, clock):
        inside = np.flatnonzero((times > gap.start) & (times < gap.end))
        if inside.size:
            raise RecordingError(
                f"{inside.size} of the times asked lie in a gap of clock '{clock}': {gap}.",
                advice="Resample the stretches between gaps apart: recording.window(t0, t1).resampled(...).",
                gap=gap,
            )
