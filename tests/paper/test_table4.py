"""The study of Table 4: cases, summaries, orderings, the command."""

from __future__ import annotations

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from smsid.cli.control import control_command
from smsid.control.controller_file import load_controller
from smsid.control.reduced import ReducedDynamics, perturb_bodies
from smsid.description import load_description
from smsid.errors import ControlError
from smsid.model import SpacecraftModel, build_model
from smsid.paper import table4_study
from smsid.paper.table4 import Run, Study, Variant, cases
from smsid.paper.table4_study import improvements, orderings, summarise
from smsid.paths import urdf_folder

URDF = urdf_folder()
APP = typer.Typer()
APP.command()(control_command)
DESCRIPTION = str(URDF / "paper_sms.toml")


def paper() -> SpacecraftModel:
    return build_model(load_description(URDF / "paper_sms.toml"))


def two_arms() -> SpacecraftModel:
    return build_model(load_description(URDF / "two_arm_sms.toml"))


def run(case, controller, draw, base, joints=1e-3, **saturated) -> Run:
    return Run("main", case, controller, draw, base, joints, saturated)


def test_rows_stand_beside_the_paper_s_numbers():
    runs = [run("D", "pd", d, 1e-4 * (1 + d), 1e-3) for d in range(5)] + [run("D", "hinf", 0, 1e-5, x=3)]
    rows = summarise(runs, cases())
    assert [(r["case"], r["controller"], r["draws"]) for r in rows] == [("D", "pd", 5), ("D", "hinf", 1)]
    np.testing.assert_allclose(rows[0]["e_base"]["median"], 3e-4)
    np.testing.assert_allclose(rows[0]["e_base"]["interval"], [1.1e-4, 4.9e-4])
    assert rows[0]["e_base_paper"] == pytest.approx(np.radians(1.70e-4)) and rows[0]["runs_at_a_limit"] == 0
    assert rows[1]["runs_at_a_limit"] == 1


def test_orderings_are_told_with_their_share_and_can_fail():
    runs = []
    for d in range(40):
        runs += [run("D", "pd", d, 1e-4, 1e-3), run("C", "pd", d, 2e-4, 1e-3 if d % 2 else 2e-3)]
        runs += [run("D", "hinf", d, 3e-4, 1e-4)]
    found = {(r["smaller"], r["larger"]): r for r in orderings(runs)}
    assert found["D pd", "C pd"]["e_base"] == {"share": 1.0, "median_ratio": 0.5, "verdict": "holds"}
    assert found["D pd", "C pd"]["e_joints"]["verdict"] == "undecided"
    assert found["D hinf", "D pd"]["e_base"]["verdict"] == "fails"
    assert found["D hinf", "D pd"]["e_joints"]["verdict"] == "holds"
    assert ("C pd", "B pd") not in found
    few = [r for r in runs if r.draw < 4]
    assert orderings(few)[0]["e_base"] == {"share": 1.0, "median_ratio": 0.5, "verdict": "undecided"}


def test_improvements_are_those_of_the_medians():
    runs = [run("D", "pd", 0, 1.70e-4, 5.60e-3), run("B", "pd", 0, 1.94e-4, 7.10e-3)]
    (found,) = improvements(runs)
    np.testing.assert_allclose(found["lower_percent"], found["paper"], atol=0.1)


def test_a_study_flies_and_repeats_itself():
    """Twice the same draw is the same flight; another draw is not; the same pattern at 20 % hurts more."""
    study = Study(paper(), Variant(rate=10.0, noise=0.0))
    d, b = cases()[0], cases()[2]
    first, again, other, worse = (study.fly(c, "pd", k) for c, k in ((d, 0), (d, 0), (d, 1), (b, 0)))
    assert first == again and first.joints != other.joints
    assert worse.joints > 3.0 * first.joints
    with pytest.raises(ControlError, match="no controller 'x'"):
        study.fly(d, "x", 0)
    with pytest.raises(ControlError, match="past its limit"):
        Study(paper(), Variant(start=(3.0, 0.0, 0.0)))


@pytest.mark.parametrize("controller", ["pd", "hinf"])
def test_flights_in_threads_are_those_flown_alone(controller):
    """With noise, delay and wheels at their limit."""
    study = Study(paper(), Variant(rate=10.0, noise=20.0, delay=1))
    case = cases()[2]
    alone = [study.fly(case, controller, d) for d in (0, 1)]
    together = study.fly_many(case, controller, (0, 1))
    assert any(r.saturated for r in alone) or controller == "hinf"
    for a, b in zip(alone, together, strict=True):
        assert a.saturated == b.saturated
        assert (a.base, a.joints) == (b.base, b.joints)


def test_case_d_flies_with_the_models_given():
    exact = ReducedDynamics(paper())
    wrong = perturb_bodies(exact, 0.2, np.random.default_rng(0))
    study = Study(paper(), Variant(rate=10.0, noise=0.0), identified=(exact, wrong))
    good, bad = study.fly_many(cases()[0], "pd", (0, 1))
    assert bad.joints > 5.0 * good.joints
    assert study.fly(cases()[0], "pd", 2).joints == pytest.approx(good.joints, rel=1e-9)


def test_a_study_flies_at_the_rate_and_with_the_sensors_asked_for(monkeypatch):
    monkeypatch.setattr(table4_study, "cases", lambda: cases()[:1])
    d = load_description(URDF / "paper_sms.toml")
    heard: list[str] = []
    asked = {"rate": 25.0, "crossover": 8.0, "integrated_gyro": True}
    found = table4_study.fly_study(d, None, 1, tell=heard.append, **asked)
    assert (found["rate"], found["crossover"], found["sensors"]) == (25.0, 8.0, "integrated gyro")
    assert len(heard) == 2 and [r["controller"] for r in found["rows"]] == ["pd", "hinf"]
    assert found["rows"][1]["e_base"]["median"] < 1e-5  # with the described attitude noise it is above 3e-5
    assert len(table4_study.study_cells(found)) == 2


def invoke(*arguments: str):
    return CliRunner().invoke(APP, [str(a) for a in arguments])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "Neither an estimate nor an uncertainty"),
        (("--uncertainty", "0.05", "--gains", "4"), "no pair of gains"),
        (("--uncertainty", "0.05", "--gains", "4,-4"), "K_D is not positive definite"),
        (("--tune", "--uncertainty", "0.05"), "no estimate is given"),
        (("--study", "table4", "--draws", "0"), "0 draws"),
    ],
)
def test_the_command_refuses_bad_input(arguments, words):
    result = invoke(DESCRIPTION, *arguments)
    assert isinstance(result.exception, ControlError) and words in str(result.exception)


def test_a_broken_controller_file_is_refused(tmp_path):
    with pytest.raises(ControlError, match="does not exist"):
        load_controller(tmp_path / "none.json")
    for text in ("{", '{"kind": "controller", "schema": 1}'):
        (tmp_path / "x.json").write_text(text)
        with pytest.raises(ControlError, match=r"not valid JSON|cannot be read"):
            load_controller(tmp_path / "x.json")
    for text, words in (
        ("[]", "no controller of schema"),
        ('{"kind": "estimate", "schema": 1}', "'estimate', no controller"),
    ):
        (tmp_path / "x.json").write_text(text)
        with pytest.raises(ControlError, match=words):
            load_controller(tmp_path / "x.json")
