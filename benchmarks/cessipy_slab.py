"""Two close modes of a concrete slab from a phone's accelerometer, beside pyOMA-2 on the same samples.

pyOMA-2 gets the covariance-driven SSI at one of smsid's block rows (the middle one) and all its orders;
its modes are the medians of poles of physical damping about each of smsid's modes, of orders from 12 on.

The record is no lasting ambient vibration but mostly three hard steps. Their free decays are therefore fitted
as well: by one linear mode, by two, and by one whose frequency falls with the root of its amplitude.

    python benchmarks/cessipy_slab.py
"""

from __future__ import annotations

import contextlib
import io
import logging
import time

import numpy as np
from _common import environment, write_result
from scipy.optimize import least_squares
from scipy.signal import butter, hilbert, sosfiltfilt

from smsid.datasets import cessipy_slab
from smsid.identify.ssi_decimate import decimate
from smsid.lab import AmbientMode, ambient_modes

HIGHEST = 24.0  # [Hz]
NEAR = 0.015  # share of the frequency
LARGEST_DAMPING = 0.1


def row(mode: AmbientMode) -> dict[str, object]:
    return {
        "frequency_Hz": round(mode.frequency, 4),
        "interval_95_Hz": [round(x, 4) for x in mode.interval],
        "damping": round(mode.damping, 5),
        "damping_sigma": round(mode.damping_sigma, 5),
        "share_of_windows": round(mode.windows, 3),
        "kurtosis": round(mode.kurtosis, 2),
        "impulsive": mode.impulsive,
    }


def decays(y: np.ndarray, rate: float) -> tuple[list[tuple[np.ndarray, np.ndarray]], list[int]]:
    """Free decays, from 0.15 s after a hard step to 5 % of its peak: times and samples; where they end."""
    band = sosfiltfilt(butter(2, (12.0, 24.0), "bandpass", fs=rate, output="sos"), y)
    envelope = np.abs(hilbert(band))
    loud = envelope.copy()
    found, ends = [], []
    while loud.max() > 0.3 * envelope.max():
        peak = int(loud.argmax())
        begin = peak + round(0.15 * rate)
        quiet = begin + int(np.argmax(envelope[begin:] < 0.05 * envelope[peak]))
        found.append((np.arange(quiet - begin) / rate, band[begin:quiet]))
        ends.append(quiet)
        loud[max(0, peak - round(rate)) : quiet + round(rate)] = 0.0
    return found, sorted(ends)


def between(y: np.ndarray, rate: float, ends: list[int]) -> list[dict[str, object]]:
    """Modes of the longest stretch between hard steps, from a second after a decay to two before the next."""
    gap = int(np.argmax(np.diff(ends)))
    part = y[ends[gap] + round(rate) : ends[gap + 1] - round(4.0 * rate)]
    return [row(m) for m in ambient_modes(part, rate, highest_frequency=HIGHEST).modes]


def decay_errors(pieces: list[tuple[np.ndarray, np.ndarray]]) -> dict[str, object]:
    """What models leave of the decays, relative root mean square; amplitudes are each decay's own."""

    def linear(x: np.ndarray) -> np.ndarray:
        out = []
        for t, y in pieces:
            waves = []
            for f, z in x.reshape(-1, 2):
                w = 2 * np.pi * f
                waves += [np.exp(-z * w * t) * g(w * np.sqrt(1 - z * z) * t) for g in (np.cos, np.sin)]
            columns = np.array(waves).T
            out.append(y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0])
        return np.concatenate(out)

    starts = [np.array([np.abs(hilbert(y))[:40].max(), np.angle(hilbert(y))[3]]) for _, y in pieces]

    def softening(x: np.ndarray) -> np.ndarray:
        f, z, k = x
        w, out = 2 * np.pi * f, []
        for start, (t, y) in zip(starts, pieces, strict=True):

            def wave(a: np.ndarray, t: np.ndarray = t, w: float = w, z: float = z) -> np.ndarray:
                size = a[0] * np.exp(-z * w * t)
                turned = np.concatenate([[0.0], np.cumsum(np.sqrt(np.abs(size[:-1])) * np.diff(t))])
                return size * np.cos(w * (t - k * turned) + a[1])

            out.append(least_squares(lambda a, y=y, wave=wave: y - wave(a), start).fun)
        return np.concatenate(out)

    size = float(np.sqrt(np.mean(np.concatenate([y for _, y in pieces]) ** 2)))
    found: dict[str, object] = {"number": len(pieces)}
    for name, model, start in (
        ("one linear mode", linear, [17.6, 0.025]),
        ("two linear modes", linear, [17.2, 0.03, 17.9, 0.015]),
        ("one mode, frequency falls with the root of its amplitude", softening, [18.0, 0.025, 0.05]),
    ):
        scale = np.array([0.1, 0.01, 0.1, 0.01][: len(start)])
        fit = least_squares(model, np.array(start), x_scale=scale, diff_step=1e-5)
        found[name] = {
            "left": round(float(np.sqrt(np.mean(fit.fun**2))) / size, 4),
            "parameters": [round(float(v), 4) for v in fit.x],
        }
    return found


def pyoma(y: np.ndarray, rate: float, block_rows: int, largest: int) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies and damping ratios of all poles by order, NaN where there is none."""
    from pyoma2.algorithms import SSI
    from pyoma2.setup import SingleSetup

    logging.disable(logging.WARNING)
    with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
        setup = SingleSetup(y, fs=rate)
        setup.add_algorithms(SSI(name="ssi", br=block_rows, ordmax=largest, method="cov"))
        setup.run_by_name("ssi")
    logging.disable(logging.NOTSET)
    result = setup["ssi"].result
    return np.asarray(result.Fn_poles, dtype=float), np.asarray(result.Xi_poles, dtype=float)


def main() -> None:
    log = cessipy_slab()
    times = log.time()
    rate = (times.size - 1) / (times[-1] - times[0])
    y = log.resampled(rate)["phone.acceleration"]
    begin = time.perf_counter()
    found = ambient_modes(y, rate, highest_frequency=HIGHEST)
    seconds = time.perf_counter() - begin
    slow, slow_rate = decimate(y - y.mean(axis=0), rate, round(rate / found.rate))
    frequency, damping = pyoma(slow, slow_rate, int(2.0 * found.window * slow_rate), 60)
    physical = (damping > 0.0) & (damping < LARGEST_DAMPING)
    physical[:, :12] = False
    beside = []
    for mode in found.modes:
        near = physical & (np.abs(frequency / mode.frequency - 1.0) < NEAR)
        beside.append(
            {
                "frequency_Hz": round(float(np.median(frequency[near])), 4),
                "damping": round(float(np.median(damping[near])), 5),
                "poles": int(near.sum()),
            }
        )
    agree = [
        bool(m.interval[0] < b["frequency_Hz"] < m.interval[1])
        for m, b in zip(found.modes, beside, strict=True)
    ]
    pieces, ends = decays(y[:, 2] - y[:, 2].mean(), rate)
    result = {
        "claim": "both close modes with intervals, agreeing with pyOMA-2",
        "command": "python benchmarks/cessipy_slab.py",
        "environment": environment("numpy", "scipy", "pyOMA-2"),
        "modes": [row(m) for m in found.modes],
        "separations_Hz": [
            {"value": round(d, 4), "interval_95": [round(d + k * 1.959964 * s, 4) for k in (-1, 1)]}
            for d, s in found.separations
        ],
        "harmonics_Hz": list(found.harmonics),
        "pyoma2": beside,
        "pyoma2_within_interval": agree,
        "free_decays": decay_errors(pieces),
        "modes_between_the_hard_steps": between(y, rate, ends),
        "seconds": round(seconds, 2),
        "window_s": round(found.window, 3),
        "rate_Hz": round(found.rate, 3),
    }
    print(write_result("cessipy_slab", result))
    for key in (
        "modes",
        "separations_Hz",
        "harmonics_Hz",
        "pyoma2",
        "pyoma2_within_interval",
        "free_decays",
        "modes_between_the_hard_steps",
    ):
        print(key, result[key])


if __name__ == "__main__":
    main()
