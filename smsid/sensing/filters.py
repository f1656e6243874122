"""A low-pass filter and differentiation of sampled data, along the first axis.

The paper (section V) filters its noisy measurements with causal IIR low-pass filters. Offline nothing needs
to be causal, and `zero_phase` shifts nothing in time.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import make_interp_spline

from smsid._recursion import filter_recursively
from smsid._time_text import time_text
from smsid.errors import RecordingError
from smsid.sensing.signals import FloatArray

ORDER = 4  # of the Butterworth low-pass, each way


def zero_phase(x: ArrayLike, rate: float, cutoff: float) -> FloatArray:
    """Filter forwards and backwards with a Butterworth low-pass: no delay, -6 dB at the cutoff.

    The gain is the filter's squared. The record is extended at both ends, odd about its end points,
    until the start of the two passes has settled to 1e-4 (about four periods of the cutoff), or by
    its own length if it is shorter.

    Args:
        x: (N, ...) samples [unit].
        rate: sampling rate [Hz].
        cutoff: -6 dB frequency [Hz], below half the rate.

    Raises:
        RecordingError: cutoff not below Nyquist, a sample not finite, or a record shorter than one period of
            the cutoff.
    """
    data, sections, pad = _prepare(x, rate, cutoff)
    before, after = 2.0 * data[0] - data[pad:0:-1], 2.0 * data[-1] - data[-2 : -pad - 2 : -1]
    wide = np.concatenate([before, data, after])
    for _ in range(2):  # settled at the first sample, which a low-pass lets through as it is
        wide = (wide[0] + _low_passed(wide - wide[0], sections))[::-1]
    return wide[pad : pad + data.shape[0]]


def zero_phase_transposed(x: ArrayLike, rate: float, cutoff: float) -> FloatArray:
    """Apply the transpose of `zero_phase` as a matrix (N, N): that is itself but for the ends.

    The odd extension about an end point counts that sample many times, so its noise weighs more than others'.
    What `zero_phase` leaves of the start of its two passes, 1e-4, is left out.

    Args:
        x: (N, ...) what multiplies the filtered samples from the left.
        rate: sampling rate [Hz].
        cutoff: -6 dB frequency [Hz], below half the rate.

    Raises:
        RecordingError: as `zero_phase`.
    """
    data, sections, pad = _prepare(x, rate, cutoff)
    n = data.shape[0]
    wide = np.concatenate([np.zeros((pad, *data.shape[1:])), data, np.zeros((pad, *data.shape[1:]))])
    wide = _low_passed(_low_passed(wide, sections)[::-1], sections)[::-1]
    left, out, right = wide[:pad], wide[pad : pad + n].copy(), wide[pad + n :]
    out[0] += 2.0 * left.sum(axis=0)
    out[1 : pad + 1] -= left[::-1]
    out[-1] += 2.0 * right.sum(axis=0)
    out[n - 1 - pad : n - 1] -= right[::-1]
    return out


def differentiate(x: ArrayLike, rate: float, cutoff: float) -> FloatArray:
    """Differentiate once with no delay: `zero_phase`, then the slope of the quintic spline through it.

    White noise of two-sided density N [unit/sqrt(Hz)] comes out with a sigma of about ``4.6 N cutoff**1.5``
    [unit/s]: choose the cutoff with care.

    Args:
        x: (N, ...) samples [unit].
        rate: sampling rate [Hz].
        cutoff: -6 dB frequency of the low-pass [Hz], below half the rate.

    Returns:
        (N, ...) derivative [unit/s].

    Raises:
        RecordingError: as `zero_phase`.
    """
    smooth = zero_phase(x, rate, cutoff)
    times = np.arange(smooth.shape[0]) / rate
    return np.asarray(make_interp_spline(times, smooth, k=5, axis=0).derivative()(times))


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
            f"'{name}' is not evenly sampled: a step of {steps[worst]:.6g} s, else {step:.6g} s, after "
            f"t = {time_text(times[worst], times[0])}.",
            advice="Resample it, or cut it at the gap.",
            channel=name,
            at=float(times[worst]),
            step=float(steps[worst]),
            other_flight=True,  # too uneven for the paper's method, which is no fault of the recording
        )
    return float((times.size - 1) / (times[-1] - times[0]))


def settling_time(cutoff: float) -> float:
    """Return the time [s] in which a Butterworth low-pass with ``cutoff`` [Hz] settles to 1e-4."""
    return math.log(1e4) / (2.0 * math.pi * cutoff * math.sin(math.pi / (2 * ORDER)))


def butterworth(rate: float, cutoff: float) -> list[tuple[FloatArray, FloatArray]]:
    """Return the low-pass as sections ``b``, ``a`` (3,) that each let a constant through as it is.

    The bilinear transform of the analogue filter, whose cutoff is moved so that the digital one's is
    ``cutoff`` [Hz] of samples at ``rate`` [Hz]; -3 dB there.
    """
    w = math.tan(math.pi * cutoff / rate)
    sections = []
    for angle in (math.pi * (2 * k + 1) / (2 * ORDER) for k in range(ORDER // 2)):
        damped = 2.0 * w * math.sin(angle)
        size = 1.0 + damped + w * w
        a = np.array([size, 2.0 * (w * w - 1.0), 1.0 - damped + w * w]) / size
        sections.append((w * w / size * np.array([1.0, 2.0, 1.0]), a))
    return sections


def _low_passed(x: FloatArray, sections: list[tuple[FloatArray, FloatArray]]) -> FloatArray:
    for b, a in sections:
        x = filter_recursively(b, a, x)
    return x


def _prepare(
    x: ArrayLike, rate: float, cutoff: float
) -> tuple[FloatArray, list[tuple[FloatArray, FloatArray]], int]:
    """Return the samples, the filter's sections, and by how many samples to extend them at both ends."""
    if not (math.isfinite(rate) and 0.0 < cutoff < 0.5 * rate):
        raise RecordingError(
            f"A cutoff of {cutoff} Hz is not between 0 and Nyquist, {0.5 * rate} Hz, of a rate of {rate} Hz.",
            advice="Lower the cutoff, or record faster.",
            cutoff=cutoff,
            nyquist=0.5 * rate,
            other_flight=True,  # too slow for the paper's method, which is no fault of the recording
        )
    # The slack keeps a rate read off a clock, 200.0000001 Hz, from costing a sample.
    period = max(math.ceil(rate / cutoff - 1e-6), 3 * (ORDER + 1))
    wanted, least = max(period, math.ceil(settling_time(cutoff) * rate - 1e-6)), period + 1
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
    return data, butterworth(rate, cutoff), min(wanted, samples - 1)
