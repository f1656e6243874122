"""Silverbox: from a linear oscillator fitted on the multisines to the terms it lacks; error on the arrow.

The diagnosis sees the multisines only; the arrow judges, free-running from rest.

    python benchmarks/silverbox.py
"""

from __future__ import annotations

import json

import numpy as np
from _common import environment, write_result

from smsid.datasets import silverbox
from smsid.datasets._recordings import SILVERBOX_RATE
from smsid.lab import Oscillator
from smsid.lab.oscillator_diagnosis import NAMES, diagnose_oscillator

EARLY = 25_000  # samples of the arrow whose amplitude the multisines reach


def main() -> None:
    train, arrow = silverbox()
    start = Oscillator(frequency=68.0, damping=0.05, gain=1.0)
    found = diagnose_oscillator(
        train["extra.input"],
        train["extra.output"],
        SILVERBOX_RATE,
        start,
        name="silverbox",
        validation=("arrow", arrow["extra.input"], arrow["extra.output"]),
    )
    models = {}
    for terms, fit in found.fits.items():
        error = arrow["extra.output"] - fit.oscillator.simulate(arrow["extra.input"], SILVERBOX_RATE)
        label = "linear" if not terms else f"and {NAMES[terms[-1]][1]}"
        models[label] = {
            "arrow_free_run_rmse_mV": _mv(error),
            "arrow_without_its_mean_mV": _mv(error - error.mean()),
            "arrow_first_25000_samples_rmse_mV": _mv(error[:EARLY]),
            "multisines_rmse_mV": round(1e3 * fit.rmse, 4),
            "parameters": {
                p.name: {
                    "value": p.value,
                    "interval_95": list(p.interval),
                    "unit": p.unit,
                    "status": p.status,
                }
                for p in fit.estimate.parameters
            },
        }
        print(label, models[label]["arrow_free_run_rmse_mV"], "mV on the arrow")
    diagnosis = json.loads(found.diagnosis.to_json())
    result = {
        "claim": "the hardening spring is named; below 1 mV on the arrow, fitted on the multisines",
        "command": "python benchmarks/silverbox.py",
        "environment": environment("numpy", "scipy"),
        "models": models,
        "diagnosis": {k: diagnosis[k] for k in ("verdict", "sentence", "causes", "remaining", "gain")},
        "seconds_of_cpu": round(sum(found.diagnosis.timing.values()), 1),
    }
    print(write_result("silverbox", result))
    print(found.diagnosis.sentence)


def _mv(error: np.ndarray) -> float:
    return round(1e3 * float(np.sqrt(np.mean(error**2))), 4)


if __name__ == "__main__":
    main()
