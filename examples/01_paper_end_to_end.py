# /// script
# dependencies = ["smsid"]
# ///
"""The paper end to end: describe, fly both experiments, identify, print what was found.

python examples/01_paper_end_to_end.py
"""

from __future__ import annotations

import numpy as np

from smsid.description import load_description
from smsid.experiments import fly, named_experiment
from smsid.identify.pipeline import identify
from smsid.model import build_model
from smsid.paths import urdf_folder


def main() -> None:
    description = load_description(urdf_folder() / "paper_sms.toml")
    model = build_model(description)
    rng = np.random.default_rng(1)
    recordings = [fly(model, named_experiment(name, model), rng).recording for name in ("exp1", "exp2")]
    estimate = identify(description, recordings).estimate
    for p in estimate.parameters:
        if p.group in ("exp1", "modes", "exp2.step_b"):
            low, high = p.interval
            print(f"{p.name[:60]:60s} {p.value:12.6g} {p.unit:8s} [{low:.5g}, {high:.5g}]  {p.status}")


if __name__ == "__main__":
    main()
