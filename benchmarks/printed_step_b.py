"""Do the intervals of Step B as printed hold? ``python benchmarks/printed_step_b.py --draws 40``.

One noise-free flight of another engine (``SMSID_ORACLE``) with the reference sensors' noise drawn again and
again; every parameter of pi_m is held against its true value. Needs about 8 s per draw.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import numpy as np  # noqa: E402
from _common import ROOT, environment, write_result  # noqa: E402
from scipy.stats import binom  # noqa: E402

from smsid.description import load_description  # noqa: E402
from smsid.identify.paper.exp2 import identify_momentum  # noqa: E402
from smsid.model import build_model  # noqa: E402
from smsid.recording import import_recording  # noqa: E402
from smsid.sensing import add_noise  # noqa: E402

FLIGHT = "exp2_modal3"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=40)
    options = parser.parse_args()
    description = load_description(ROOT / "urdf" / "paper_sms.toml")
    model = build_model(description)
    exact = import_recording(Path(os.environ["SMSID_ORACLE"]) / f"{FLIGHT}.npz", "oracle_exp2")
    sensors = [s for s in description.sensor if set(s.channels) <= set(exact.channels)]
    groups: dict[str, list[list[float]]] = {"exp2.step_b_printed": [], "exp2.step_b": []}
    off: list[float] = []
    for draw in range(options.draws):
        recording = add_noise(exact, sensors, np.random.default_rng(draw))
        found = identify_momentum(model, recording, model.mass)
        for group, z in groups.items():
            own = [p for p in found.parameters if p.group == group and p.nominal is not None]
            if own:
                z.append([(p.value - p.nominal) / p.sigma for p in own])
            if group == "exp2.step_b_printed":
                off += [p.relative_error(p.nominal) for p in own if p.status == "identifiable"]
        print(f"{draw + 1}/{options.draws}", flush=True)
    result: dict[str, object] = {"environment": environment("pin", "numpy", "scipy"), "flight": FLIGHT}
    for group, rows in groups.items():
        z = np.array(rows)
        inside = np.abs(z) < 1.959964
        low, high = binom.interval(0.99, len(z), 0.95)
        per = inside.sum(axis=0)
        result[group] = {
            "draws": len(z),
            "parameters": z.shape[1],
            "coverage": float(inside.mean()),
            "largest_z": float(np.abs(z).max()),
            "below_99_percent_band": int((per < low).sum()),
            "band": [int(low), int(high)],
        }
    result["identifiable_as_printed"] = {
        "count": len(off),
        "median_relative_error": float(np.median(off)),
        "largest_relative_error": float(np.max(off)),
    }
    print(write_result("printed_step_b", result))


if __name__ == "__main__":
    main()
