"""Low-pass filters, decimation and differentiation of sampled data, along the first axis.

The paper (section V) filters its noisy measurements with IIR low-pass filters; `lowpass` is that, causal.
Offline nothing needs to be causal, and `zero_phase` shifts nothing in time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, sosfilt, sosfilt_zi, sosfiltfilt

from smsid.errors import RecordingError
from smsid.sensing._noise import FloatArray

if TYPE_CHECKING:
    from smsid.recording import Recording


def lowpass(
    x: ArrayLike, rate: float, cutoff: float, order: int = 4, *, steady_start: bool = True
) -> FloatArray:
    """Filter causally with a Butterworth low-pass, -3 dB at the cutoff. It delays; `zero_phase` does not.

    Args:
        x: (N, ...) samples [unit].
        rate: sampling rate [Hz].
        cutoff: -3 dB frequency [Hz], below half the rate.
        order: of the filter.
        steady_start: start as if the first sample had lasted forever; otherwise from rest at zero.

    Raises:
        RecordingError: cutoff not below Nyquist, a sample not finite, or no samples.
    """
    data, sos = _prepare(x, rate, cutoff, order, least=1)
    if not steady_start:
        return np.asarray(sosfilt(sos, data, axis=0))
    start = sosfilt_zi(sos).reshape(sos.shape[0], 2, *(1,) * (data.ndim - 1)) * data[0]
    return np.asarray(sosfilt(sos, data, axis=0, zi=start)[0])


def zero_phase(x: ArrayLike, rate: float, cutoff: float, order: int = 4) -> FloatArray:
    """Filter forwards and backwards with a Butterworth low-pass: no delay, -6 dB at the cutoff.

    The gain is that of `lowpass` squared. The record is extended at both ends, odd about its end points,
    until the start of the two passes has settled to 1e-4 (about four periods of the cutoff at order 4), or by
    its own length if it is shorter.

    Args:
        x: (N, ...) samples [unit].
        rate: sampling rate [Hz].
        cutoff: -6 dB frequency [Hz], below half the rate.
        order: of each pass.

    Raises:
        RecordingError: cutoff not below Nyquist, a sample not finite, or a record shorter than one period of
            the cutoff.
    """
    least, wanted = _padding(rate, cutoff, max(order, 1))
    data, sos = _prepare(x, rate, cutoff, order, least=least + 1)
    return np.asarray(sosfiltfilt(sos, data, axis=0, padlen=min(wanted, data.shape[0] - 1)))


def zero_phase_transposed(x: ArrayLike, rate: float, cutoff: float, order: int = 4) -> FloatArray:
    """Apply the transpose of `zero_phase` as a matrix (N, N): that is itself but for the ends.

    The odd extension about an end point counts that sample many times, so its noise weighs more than others'.
    What `zero_phase` leaves of the start of its two passes, 1e-4, is left out.

    Args:
        x: (N, ...) what multiplies the filtered samples from the left.
        rate: sampling rate [Hz].
        cutoff: -6 dB frequency [Hz], below half the rate.
        order: of each pass.

    Raises:
        RecordingError: as `zero_phase`.
    """
    least, wanted = _padding(rate, cutoff, max(order, 1))
    data, sos = _prepare(x, rate, cutoff, order, least=least + 1)
    n, pad = data.shape[0], min(wanted, data.shape[0] - 1)
    wide = np.concatenate([np.zeros((pad, *data.shape[1:])), data, np.zeros((pad, *data.shape[1:]))])
    wide = sosfilt(sos, sosfilt(sos, wide, axis=0)[::-1], axis=0)[::-1]
    left, out, right = wide[:pad], wide[pad : pad + n].copy(), wide[pad + n :]
    out[0] += 2.0 * left.sum(axis=0)
    out[1 : pad + 1] -= left[::-1]
    out[-1] += 2.0 * right.sum(axis=0)
    out[n - 1 - pad : n - 1] -= right[::-1]
    return np.asarray(out)


def decimate(x: ArrayLike, rate: float, factor: int) -> FloatArray:
    """Keep every ``factor``-th sample after a zero-phase low-pass.

    Its cutoff is 0.8 of the new Nyquist frequency, its order 8 each pass. The first sample stays; the new
    rate is ``rate / factor`` [Hz].

    Args:
        x: (N, ...) samples [unit].
        rate: sampling rate [Hz].
        factor: 1 or more.

    Raises:
        RecordingError: factor below 1, a sample not finite, or a record too short for the filter.
    """
    if factor < 1 or int(factor) != factor:
        raise RecordingError(
            f"A record cannot be decimated by {factor}.", advice="Give a whole number from 1.", factor=factor
        )
    if factor == 1:
        return _finite(x, least=1).copy()
    return zero_phase(x, rate, 0.8 * 0.5 * rate / factor, order=8)[:: int(factor)]


def differentiate(x: ArrayLike, rate: float, cutoff: float, order: int = 4) -> FloatArray:
    """Differentiate once with no delay: `zero_phase`, then the slope of the quintic spline through it.

    White noise of two-sided density N [unit/sqrt(Hz)] comes out with a sigma of about ``4.6 N cutoff**1.5``
    [unit/s] at order 4: choose the cutoff with care.

    Args:
        x: (N, ...) samples [unit].
        rate: sampling rate [Hz].
        cutoff: -6 dB frequency of the low-pass [Hz], below half the rate.
        order: of each pass of the low-pass.

    Returns:
        (N, ...) derivative [unit/s].

    Raises:
        RecordingError: as `zero_phase`.
    """
    smooth = zero_phase(x, rate, cutoff, order)
    times = np.arange(smooth.shape[0]) / rate
    return np.asarray(make_interp_spline(times, smooth, k=5, axis=0).derivative()(times))


def filter_recording(
    recording: Recording, names: Sequence[str], cutoff: float, *, order: int = 4, zero_phase: bool = True
) -> Recording:
    """Return the recording with some channels low-passed, each at its own rate; the provenance says so.

    Quaternions are made continuous in sign, filtered by component and normalised, which is right to second
    order in the rotation within one period of the cutoff.

    Args:
        recording: the data.
        names: channels to filter, ``<source>.<quantity>``.
        cutoff: [Hz], see `lowpass` and `zero_phase`.
        order: of the filter (of each pass).
        zero_phase: forwards and backwards; otherwise causal from a steady start.

    Raises:
        RecordingError: no such channel, a time step that varies by more than 1 %, or as `zero_phase`.
    """
    run = _zero_phase if zero_phase else lowpass
    filtered: dict[str, FloatArray] = {}
    for name in names:
        rate = uniform_rate(recording.time(name), name)
        values = np.asarray(recording[name], dtype=float)
        if name.endswith(".attitude"):
            flips = np.sum(values[1:] * values[:-1], axis=1) < 0.0
            values = values * np.concatenate(([1.0], np.where(np.cumsum(flips) % 2, -1.0, 1.0)))[:, None]
            values = run(values, rate, cutoff, order)
            filtered[name] = values / np.linalg.norm(values, axis=1, keepdims=True)
        else:
            filtered[name] = run(values, rate, cutoff, order)
    note = {"cutoff": cutoff, "order": order, "zero_phase": zero_phase, "channels": list(names)}
    steps = [*recording.provenance.get("steps", []), {"filter": note}]
    return recording.with_channels(filtered).with_provenance({"steps": steps})


def uniform_rate(times: FloatArray, name: str = "record") -> float:
    """Return the rate [Hz] of evenly spaced ``times`` (N,) [s].

    Raises:
        RecordingError: fewer than two samples, or a step that differs from the median by more than 1 %.
    """
    steps = np.diff(times)
    if steps.size == 0:
        raise RecordingError(f"'{name}' has fewer than two samples.", advice="It has no rate.", channel=name)
    step = float(np.median(steps))
    worst = int(np.argmax(np.abs(steps - step)))
    if abs(steps[worst] - step) > 0.01 * step:
        raise RecordingError(
            f"'{name}' is not evenly sampled: {steps[worst]} s after t = {times[worst]} s, else {step} s.",
            advice="Resample it, or cut it at the gap.",
            channel=name,
            at=float(times[worst]),
            step=float(steps[worst]),
        )
    return float((times.size - 1) / (times[-1] - times[0]))


_zero_phase = zero_phase


def _padding(rate: float, cutoff: float, order: int) -> tuple[int, int]:
    """Return least and wanted extension in samples: one period of the cutoff, and settling to 1e-4."""
    if not 0.0 < cutoff < math.inf:
        return 0, 0
    # The slack keeps a rate read off a clock, 200.0000001 Hz, from costing a sample.
    period = max(math.ceil(rate / cutoff - 1e-6), 3 * (order + 1))
    return period, max(period, math.ceil(settling_time(cutoff, order) * rate - 1e-6))


def settling_time(cutoff: float, order: int = 4) -> float:
    """Return the time [s] in which a Butterworth low-pass with ``cutoff`` [Hz] settles to 1e-4."""
    return math.log(1e4) / (2.0 * math.pi * cutoff * math.sin(math.pi / (2 * order)))


def _prepare(
    x: ArrayLike, rate: float, cutoff: float, order: int, least: int
) -> tuple[FloatArray, FloatArray]:
    if not (math.isfinite(rate) and 0.0 < cutoff < 0.5 * rate):
        raise RecordingError(
            f"A cutoff of {cutoff} Hz is not between 0 and Nyquist, {0.5 * rate} Hz, of a rate of {rate} Hz.",
            advice="Lower the cutoff, or record faster.",
            cutoff=cutoff,
            nyquist=0.5 * rate,
            other_flight=True,  # too slow for the paper's method, which is no fault of the recording
        )
    if order < 1:
        raise RecordingError(f"A filter of order {order}.", advice="Give 1 or more.", order=order)
    return _finite(x, least), np.asarray(butter(order, cutoff, fs=rate, output="sos"))


def _finite(x: ArrayLike, least: int) -> FloatArray:
    data = np.asarray(x, dtype=float)
    samples = data.shape[0] if data.ndim else 0
    if samples < least:
        raise RecordingError(
            f"A record of {samples} samples is too short: the filter needs {least}.",
            advice="Raise the cutoff or record longer.",
            samples=samples,
            needed=least,
        )
    bad = np.flatnonzero(~np.isfinite(data).reshape(samples, -1).all(axis=1))
    if bad.size:
        raise RecordingError(
            f"{bad.size} of {samples} samples are not finite, the first is number {bad[0]}.",
            advice="Filters spread them over the record; cut or fill them first.",
            samples=bad,
        )
    return data
