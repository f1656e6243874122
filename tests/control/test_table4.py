"""The study of Table 4: cases, summaries, orderings, the command."""

from __future__ import annotations

import json

import numpy as np
import pytest
import typer
from control_cases import URDF, paper
from typer.testing import CliRunner

from smsid.control.command import control_command
from smsid.control.controller_file import load_controller
from smsid.control.robust_term import rigid_loop
from smsid.control.statespace import hinf_norm
from smsid.control.table4 import Run, Study, Variant, cases, improvements, orderings, summarise
from smsid.errors import ControlError
from smsid.identify.estimate import Estimate, judged, save_estimate

APP = typer.Typer()
APP.command()(control_command)
DESCRIPTION = str(URDF / "paper_sms.toml")


def run(case, controller, draw, base, joints=1e-3, **saturated) -> Run:
    return Run("main", case, controller, draw, base, joints, saturated)


def test_rows_stand_beside_the_paper_s_numbers():
    runs = [run("D", "pd", d, 1e-4 * (1 + d), 1e-3) for d in range(5)] + [run("D", "hinf", 0, 1e-5, x=3)]
    rows = summarise(runs, cases())
    assert [(r["case"], r["controller"], r["draws"]) for r in rows] == [("D", "pd", 5), ("D", "hinf", 1)]
    np.testing.assert_allclose(rows[0]["e_base"]["median"], 3e-4)
    np.testing.assert_allclose(rows[0]["e_base"]["interval"], [1.1e-4, 4.9e-4])
    assert rows[0]["e_base_paper"] == 1.70e-4 and rows[0]["runs_at_a_limit"] == 0
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


def invoke(*arguments: str):
    return CliRunner().invoke(APP, [str(a) for a in arguments])


def test_the_command_designs_from_an_estimate(tmp_path):
    found = (judged("bus.Ixx", 1500.0, "kg m^2", 5.0, "exp2.step_b"), judged("M", 2256.8, "kg", 1.0, "exp1"))
    save_estimate(Estimate("paper_sms", "paper", found), tmp_path / "estimate.json")
    output = tmp_path / "controller.json"
    result = invoke(DESCRIPTION, tmp_path / "estimate.json", "--gains", "1,2", "--rate", "10", "-o", output)
    assert result.exit_code == 0, result.exception
    document = json.loads(output.read_text())
    np.testing.assert_allclose(document["weights"]["uncertainty"]["value"], 1.959964 * 5.0 / 1500.0)
    assert document["gamma"] <= 1.0 + 1e-6 and document["coordinates"][3:] == ["joint1", "joint2", "joint3"]
    gains, term = load_controller(output)
    loop = rigid_loop(gains.proportional, gains.derivative, term)
    assert loop.stable and hinf_norm(loop)[0] < np.inf
    np.testing.assert_allclose(np.diag(gains.derivative), 2.0)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "Neither an estimate nor an uncertainty"),
        (("--uncertainty", "0.05", "--gains", "4"), "no pair of gains"),
        (("--uncertainty", "0.05", "--gains", "4,-4"), "K_D is not positive definite"),
        (("--study", "table5"), "no study 'table5'"),
        (("--study", "table4", "--draws", "0"), "0 draws"),
    ],
)
def test_the_command_refuses_bad_input(arguments, words):
    result = invoke(DESCRIPTION, *arguments)
    assert isinstance(result.exception, ControlError) and words in str(result.exception)


def test_a_broken_controller_file_is_refused(tmp_path):
    with pytest.raises(ControlError, match="does not exist"):
        load_controller(tmp_path / "none.json")
    for text in ("{", "[]", '{"kind": "controller", "schema": 1}'):
        (tmp_path / "x.json").write_text(text)
        with pytest.raises(ControlError, match="cannot be read"):
            load_controller(tmp_path / "x.json")
    (tmp_path / "x.json").write_text('{"kind": "estimate", "schema": 1}')
    with pytest.raises(ControlError, match="no controller of schema"):
        load_controller(tmp_path / "x.json")
