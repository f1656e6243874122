# /// script
# dependencies = ["smsid[plot]"]
# ///
"""The paper end to end: describe, fly both experiments, identify, show what was found.

python examples/01_paper_end_to_end.py [folder]
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib
import numpy as np

from smsid.description import load_description
from smsid.experiments import fly, named_experiment
from smsid.identify import Estimate, identify
from smsid.model import build_model
from smsid.paths import urdf_folder

matplotlib.use("Agg")
from matplotlib import pyplot as plt


def draw(estimate: Estimate, file: Path) -> None:
    """Draw values with their 95 % intervals, relative to what flew."""
    shown = [p for p in estimate.parameters if p.status == "identifiable" and not p.small and p.nominal]
    shown = [p for p in shown if p.group in ("exp1", "modes", "exp2.step_b")][::-1]
    figure, axes = plt.subplots(figsize=(9, 0.28 * len(shown) + 1.5), layout="constrained")
    for row, p in enumerate(shown):
        off, half = 100 * (p.value / p.nominal - 1.0), 100 * 1.96 * p.sigma / abs(p.nominal)
        axes.errorbar(off, row, xerr=half, fmt="o", color="tab:blue", capsize=3)
    axes.axvline(0.0, color="0.6", linewidth=1)
    axes.set_xscale("symlog", linthresh=0.1)
    axes.set_yticks(range(len(shown)), [p.name[:50] for p in shown], fontsize=8)
    axes.set_xlabel("estimate over truth, less one [%], with 95 % interval")
    figure.savefig(file, dpi=120)


def main(folder: Path) -> None:
    description = load_description(urdf_folder() / "paper_sms.toml")
    model = build_model(description)
    rng = np.random.default_rng(1)
    recordings = [fly(model, named_experiment(name, model), rng).recording for name in ("exp1", "exp2")]
    estimate = identify(description, recordings).estimate
    for p in estimate.parameters:
        if p.group in ("exp1", "modes", "exp2.step_b"):
            low, high = p.interval
            print(f"{p.name[:60]:60s} {p.value:12.6g} {p.unit:8s} [{low:.5g}, {high:.5g}]  {p.status}")
    draw(estimate, folder / "paper.png")


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
    target.mkdir(parents=True, exist_ok=True)
    main(target)
