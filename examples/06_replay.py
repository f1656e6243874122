# /// script
# dependencies = ["smsid[view]"]
# ///
"""A flight as it was measured, and the same commands simulated with a heavier tank, in one page to play.

python examples/06_replay.py [folder], then open replay.html in a browser
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from smsid.description import load_description
from smsid.experiments import fly, named_experiment
from smsid.model import build_model
from smsid.paths import urdf_folder
from smsid.view import export_html, replay


def main(folder: Path) -> None:
    """Fly twice and write the page."""
    described = load_description(urdf_folder() / "paper_sms.toml")
    tank = next(e for e in described.effect if e.kind == "slosh")
    others = [e for e in described.effect if e is not tank]
    heavier = described.model_copy(
        update={"effect": (tank.model_copy(update={"mass": 1.5 * tank.mass}), *others)}
    )
    model = build_model(described)
    plan = named_experiment("exp2", model).model_copy(update={"duration": 30.0})
    measured = fly(model, plan, np.random.default_rng(1)).recording
    simulated = fly(build_model(heavier), plan, np.random.default_rng(2)).trajectory
    played = replay(model, measured, beside=[("with a heavier tank", simulated)], label="measured", fps=10.0)
    for note in played.notes:
        print("note:", note)
    page = export_html(played, folder / "replay.html", title="measured, and with a heavier tank")
    print(f"wrote {page}, {page.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
    target.mkdir(parents=True, exist_ok=True)
    main(target)
