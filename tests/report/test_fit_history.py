"""The convergence of a fit, from the command's own report and from its figure."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from smsid.cli import main
from smsid.description import load_description, save_description
from smsid.effects.slosh import Slosh
from smsid.experiments import fly, named_experiment
from smsid.identify.estimate import Iteration, load_estimate
from smsid.model import build_model
from smsid.recording import save_recording
from smsid.report.identify import convergence_section

from .pages import check_page


@pytest.fixture(scope="module")
def refined(tmp_path_factory: pytest.TempPathFactory, urdf: Path) -> Path:
    """Folder of a refinement that starts from a tank described too heavy, with its report."""
    folder = tmp_path_factory.mktemp("refined")
    described = load_description(urdf / "paper_sms.toml")
    model = build_model(described)
    plan = named_experiment("exp1_xyz", model)
    save_recording(fly(model, plan, np.random.default_rng(1)).recording, folder / "exp1.nc")
    tank = next(e for e in described.effect if isinstance(e, Slosh))
    heavy = described.with_effects(tank.model_copy(update={"mass": 1.2 * tank.mass}))
    save_description(heavy, folder / "heavy.toml")
    command = ["identify", str(folder / "heavy.toml"), str(folder / "exp1.nc"), "--quiet"]
    command += ["-o", str(folder / "estimate.json"), "--report", str(folder / "report.html")]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["smsid", *command])
        main()
    return folder


def test_the_report_of_a_refinement_shows_its_convergence(refined):
    text = (refined / "report.html").read_text(encoding="utf-8")
    page = check_page(text, {"convergence", "fit-cost", "fit-steps"})
    assert "Convergence of the fit" in page.texts["h2"]


def test_the_last_cost_in_the_saved_estimate_is_the_smallest(refined):
    found = load_estimate(refined / "estimate.json")
    assert len(found.history) > 1
    assert found.history[-1].cost == min(x.cost for x in found.history)
    assert found.history[0].step is None
    per_sample = found.conditions["sum of squares / samples"]
    assert found.history[-1].cost == pytest.approx(per_sample, rel=1e-9)


def test_points_stand_at_the_costs_and_steps():
    history = (Iteration(500.0, None), Iteration(2.0, 30.0), Iteration(1.5, None), Iteration(1.0, 0.02))
    (section,) = convergence_section(history)
    (grid,) = section.parts
    cost, steps = (f.body for f in grid.figures)
    np.testing.assert_array_equal(cost.marks[-1].x, [0, 1, 2, 3])
    np.testing.assert_array_equal(cost.marks[-1].y, [500.0, 2.0, 1.5, 1.0])
    np.testing.assert_array_equal(steps.marks[-1].y, [np.nan, 30.0, np.nan, 0.02])
    assert cost.y.log and [label for label, _, _ in cost.labels()] == ["searched again"]
    assert [label for _, label in cost.x.ticks] == ["0", "1", "2", "3"]
    assert (cost.y.at(1.0), cost.y.at(500.0)) == pytest.approx((0.04 / 1.08, 1.04 / 1.08))


def test_a_method_without_iterations_has_no_such_section():
    assert convergence_section(()) == []
