"""Silverbox: free-run error on the arrow of oscillators fitted on the multisines.

python benchmarks/silverbox.py
"""

from __future__ import annotations

import time

import numpy as np
from _common import environment, write_result

from smsid.datasets import silverbox
from smsid.datasets.recordings import SILVERBOX_RATE
from smsid.lab import Oscillator, fit_oscillator


def main() -> None:
    train, arrow = silverbox()
    start = Oscillator(frequency=68.0, damping=0.05, gain=1.0)
    models = {}
    for label, terms in (
        ("linear", ()),
        ("cubic spring", ("cubic",)),
        ("quadratic and cubic spring", ("quadratic", "cubic")),
        ("and quintic spring, damping that grows", ("quadratic", "cubic", "quintic", "damping_growth")),
    ):
        begin = time.perf_counter()
        found = fit_oscillator(
            train["extra.input"], train["extra.output"], SILVERBOX_RATE, start, terms=terms, name="silverbox"
        )
        seconds = time.perf_counter() - begin
        start = found.oscillator
        error = arrow["extra.output"] - start.simulate(arrow["extra.input"], SILVERBOX_RATE)
        models[label] = {
            "arrow_free_run_rmse_mV": round(1e3 * float(np.sqrt(np.mean(error**2))), 4),
            "arrow_first_25000_samples_rmse_mV": round(1e3 * float(np.sqrt(np.mean(error[:25000] ** 2))), 4),
            "multisines_rmse_mV": round(1e3 * found.rmse, 4),
            "seconds": round(seconds, 1),
            "parameters": {
                p.name: {
                    "value": p.value,
                    "interval_95": list(p.interval),
                    "unit": p.unit,
                    "status": p.status,
                }
                for p in found.estimate.parameters
            },
        }
        print(label, models[label]["arrow_free_run_rmse_mV"], "mV on the arrow")
    result = {
        "claim": "below 1 mV free-running on the arrow, fitted on the multisines",
        "command": "python benchmarks/silverbox.py",
        "environment": environment("numpy", "scipy"),
        "models": models,
    }
    print(write_result("silverbox", result))


if __name__ == "__main__":
    main()
