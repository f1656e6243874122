"""Two close modes of a concrete slab from a phone's accelerometer, beside pyOMA-2 on the same samples.

pyOMA-2 gets the covariance-driven SSI at one of smsid's block rows (the middle one) and all its orders;
its modes are the medians of poles of physical damping about each of smsid's modes, of orders from 12 on.

    python benchmarks/cessipy_slab.py
"""

from __future__ import annotations

import contextlib
import io
import logging
import time

import numpy as np
from _common import environment, write_result

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
        "seconds": round(seconds, 2),
        "window_s": round(found.window, 3),
        "rate_Hz": round(found.rate, 3),
    }
    print(write_result("cessipy_slab", result))
    for key in ("modes", "separations_Hz", "harmonics_Hz", "pyoma2", "pyoma2_within_interval", "seconds"):
        print(key, result[key])


if __name__ == "__main__":
    main()
