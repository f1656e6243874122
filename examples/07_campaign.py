# /// script
# dependencies = ["smsid[plot]"]
# ///
"""A small Monte Carlo campaign: does the method's interval hold when noise and spacecraft are drawn anew?

python examples/07_campaign.py [folder]; given the same folder again, it goes on where it stopped
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib

from smsid.campaign import Campaign, CampaignStore, prepare, read_store, run_campaign, save_summary, summarise
from smsid.campaign.vary import Variation
from smsid.paths import urdf_folder

matplotlib.use("Agg")
from matplotlib import pyplot as plt

RUNS = 6  # more, and the bands get narrow


def main(folder: Path) -> None:
    """Run the campaign and draw errors over their predicted standard deviation."""
    campaign = Campaign(
        name="tank",
        description="paper_sms.toml",
        folder=urdf_folder(),
        experiments=("exp1_x",),
        runs=RUNS,
        seed=7,
        truth=(Variation(parameters=("tank.mass", "tank.stiffness.*"), relative=0.1),),
    )
    prepared = prepare(campaign)
    with CampaignStore(folder / "campaign.jsonl", prepared) as store:
        run_campaign(prepared, store, backend="serial", progress=lambda p: print(f"{p.done} of {p.total}"))
    _, records = read_store(folder / "campaign.jsonl")
    summary = summarise(records)
    save_summary(summary, folder / "summary.json")

    shown = [p for p in summary.parameters if p.spread is not None and p.mean_sigma and p.truth is not None]
    figure, axes = plt.subplots(figsize=(8, 4.5), layout="constrained")
    for row, p in enumerate(shown):
        print(f"{p.name:22s} spread over prediction {p.ratio or 0:.2f}, covered {p.covered} of {p.runs}")
        axes.errorbar(p.mean_error / p.mean_sigma, row, xerr=p.spread / p.mean_sigma, fmt="o", capsize=3)
    axes.axvspan(-1.0, 1.0, color="0.9")
    axes.set_yticks(range(len(shown)), [p.name for p in shown])
    axes.set_xlabel(f"mean error and spread of {RUNS} runs, over the predicted standard deviation")
    figure.savefig(folder / "campaign.png", dpi=120)


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
    target.mkdir(parents=True, exist_ok=True)
    main(target)
