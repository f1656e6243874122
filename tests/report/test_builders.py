"""Each command's report has its sections, its verdict, and the numbers of its result."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from smsid.campaign.outcome import Outcome, RunRecord
from smsid.campaign.summary import summarise
from smsid.control.robustness import Robustness
from smsid.diagnose import (
    Alias,
    ChannelGain,
    Diagnosis,
    DiagnosisRun,
    FoundCause,
    Gain,
    Limit,
    SignificantTest,
    Value,
)
from smsid.identify.estimate import Estimate, classify
from smsid.paper.table4_study import study_report
from smsid.report import render
from smsid.report._spectra import spectrum_grid
from smsid.report._traces import Trace
from smsid.report.campaign import campaign_report, normalised_errors
from smsid.report.control import _robust
from smsid.report.diagnose import DiagnosisInputs, diagnose_report, shorten
from smsid.report.diagnosis_map import diagnosis_map, evidence
from smsid.report.parameters import correlations, identifiability, parameter_table

from .pages import check_page

ESTIMATE = Estimate(
    "craft",
    "paper",
    (
        classify("tank.mass", 49.0, "kg", 0.5, "exp1", nominal=50.0),
        classify("tank.damping.x", 0.02, "N s/m", 0.02, "exp1", nominal=0.03),
        classify("link1.m + link2.m", 10.0, "kg", 0.1, "exp2.step_b", nominal=10.1),
    ),
)


def test_parameters_say_what_is_known_beside_what():
    table = parameter_table("t", ESTIMATE.parameters)
    row = dict(zip(table.columns, table.rows[0], strict=True))
    assert row["#value"].value == 49.0 and row["#described"].value == 50.0
    assert row["#95 % interval"].text == "± 0.98"
    assert [r[-1].text for r in table.rows] == ["identifiable", "not identifiable", "identifiable"]


def test_bars_end_at_the_interval_and_marks_at_the_error():
    figure = identifiability("x", ESTIMATE.parameters)
    bar, described = figure.body.rows[0].items
    assert bar.value == pytest.approx(1.96 * 0.5 / 49.0, rel=1e-3)
    assert described.value == pytest.approx(1.0 / 50.0)


def test_correlations_show_the_pairs_that_move_together():
    rng = np.random.default_rng(0)
    x = rng.standard_normal((4000, 3))
    x[:, 1] = x[:, 0] + 0.1 * x[:, 1]
    figure = correlations("c", ESTIMATE.parameters, np.cov(x.T))
    marked = {(i, j) for i, row in enumerate(figure.body.cells) for j, c in enumerate(row) if c.marked}
    assert marked == {(0, 1), (1, 0)}
    assert float(figure.body.cells[0][1].text) == pytest.approx(np.corrcoef(x.T)[0, 1], abs=0.006)


def test_spectra_of_white_noise_are_one_and_a_tone_stands_out():
    rng = np.random.default_rng(1)
    time = np.arange(8000) / 50.0
    noise = 0.3 * rng.standard_normal(len(time))
    tone = noise + np.sin(2 * np.pi * 4.0 * time)
    own = Trace("a", "m", time, tone, noise * 0, noise, 0.3, tone)
    grid = spectrum_grid("s", {"a": (own,)})
    band, before, after = grid.figures[0].body.marks
    assert np.mean(after.y) == pytest.approx(1.0, abs=0.05)
    inside = (after.y > band.low[0]) & (after.y < band.high[0])
    assert np.mean(inside) > 0.9
    assert before.x[np.argmax(before.y)] == pytest.approx(4.0, abs=0.2)


def remaining(where: str, dependence: str, ratio: float, freedom: int, tests: int = 4) -> SignificantTest:
    p = min(1.0, tests * float(chi2.sf(ratio, freedom)))
    return SignificantTest(where, dependence, ratio, freedom, p)


TESTS = (
    remaining("torque of joint2", "rate", 80.0, 3),
    remaining("torque of joint10", "rate", 2.0, 3),
    remaining("imu.acceleration[x]", "its own past", 9.0, 8),
    remaining("imu.acceleration[z]", "its own past", 400.0, 8),
)


def test_the_map_has_the_strongest_test_of_every_cell_and_marks_what_is_significant():
    body = diagnosis_map("m", "map", TESTS).body
    assert body.rows == ["torque of joint2", "torque of joint10", "imu.acceleration"]
    assert body.columns == ["rate", "its own past (frequency)"]
    assert [[c.marked for c in row] for row in body.cells] == [[True, False], [False, False], [False, True]]
    assert float(body.cells[0][0].text) == pytest.approx(-math.log10(4 * chi2.sf(80.0, 3)), abs=0.5)
    assert body.cells[1][1].step == -1
    assert evidence(TESTS[3], 4) == pytest.approx(-math.log10(4 * chi2.sf(400.0, 8)), rel=1e-6)


def test_evidence_survives_where_p_is_too_small_for_a_float():
    assert evidence(remaining("a", "b", 1e5, 3), 1) > 1e4
    assert evidence(remaining("a", "b", 5.0, 0), 1) == 0.0


@pytest.fixture
def diagnosis() -> Diagnosis:
    alias = Alias("joint_friction", "joint2", "friction", "coulomb", 0.97, "move the joint at several rates")
    cause = FoundCause(
        "joint_friction",
        "joint2",
        "friction",
        "viscous",
        (Value("seal.viscous", 0.05, 0.002, "N m s/rad"),),
        (alias,),
        {"likelihood_ratio": 600.0, "freedom": 1.0, "p_value": 1e-100},
    )
    gain = Gain(
        "val",
        9000,
        1.7,
        1.5,
        1.0,
        2e4,
        1e4,
        100.0,
        (ChannelGain("imu.angular_rate", "rad/s", 3e-5, 1e-5, 9e-6),),
    )
    return Diagnosis(
        "craft",
        ("rec", "val"),
        "explained",
        "The simulation lacks viscous friction at joint2: viscous = 0.05 +- 0.002 N m s/rad.",
        priors="by default",
        causes=(cause,),
        gain=gain,
        remaining=TESTS[:1],
        limits=(Limit("payload", "tool", "mass", "payload.mass", 0.3, "kg"),),
        tests={"nominal": TESTS, "extended": TESTS[1:3]},
    )


def test_a_diagnosis_tells_cause_map_gain_and_limits(diagnosis, origin):
    report = diagnose_report(DiagnosisRun(diagnosis, None), DiagnosisInputs(None, ()), origin)
    names = {"causes", "map", "map-before", "map-after", "gain", "gain-chart", "remaining", "limits", "notes"}
    page = check_page(render(report), names)
    assert report.tone == "good"
    assert report.verdict.startswith("Explained. In plain words: joint2 has viscous friction")
    assert (
        "0.0500 ± 0.0039 N\N{NO-BREAK SPACE}m\N{NO-BREAK SPACE}s/rad" in report.verdict
    )  # 95 %, not one standard deviation
    cells = page.texts["td"]
    assert {"± 0.0039", "move the joint at several rates", "0.97"} <= set(cells)
    assert report.sections[1].summary == "2 of 4 tests significant before, 0 after"
    assert ("excess explained, held out", "99.5 %") in report.glance


def test_what_is_not_evaluated_is_said_to_be_so(origin):
    found = Diagnosis(
        "craft", ("rec",), "not_evaluated", "The recording has no command.", gain_reason="no data"
    )
    report = diagnose_report(DiagnosisRun(found, None), DiagnosisInputs(None, ()), origin)
    text = render(report)
    check_page(text, {"causes", "gain"})
    assert report.tone == "neutral" and "Not evaluated: The recording has no command." in text
    assert 'id="map"' not in text


def test_a_long_list_of_causes_is_shortened_on_top_only():
    sentence = "; ".join(f"cause number {k} at some joint with a value" for k in range(12))
    assert len(shorten(sentence)) < 290
    assert shorten(sentence).endswith("more, below.")
    assert shorten("one; two") == "one; two"


def records(scale: float, runs: int = 200) -> list[RunRecord]:
    rng = np.random.default_rng(5)
    out = []
    for k in range(runs):
        value = 10.0 + scale * rng.standard_normal()
        outcome = Outcome(name="mass", value=value, unit="kg", truth=10.0, sigma=1.0, status="identifiable")
        out.append(RunRecord(run=k, status="ok", outcomes=(outcome,), seconds=0.1))
    return out


@pytest.mark.parametrize(("scale", "tone"), [(1.0, "good"), (2.0, "bad")])
def test_a_campaign_says_whether_intervals_hold(scale, tone, origin):
    found = records(scale)
    report = campaign_report("study", summarise(found), found, origin)
    names = {"coverage-chart", "ratio-chart", "running-coverage", "running-bias", "quantiles", "parameters"}
    check_page(render(report), names)
    assert report.tone == tone
    assert ("do not hold (mass)" in report.verdict) == (tone == "bad")
    _, z = normalised_errors(found)["mass"]
    assert (kstest(z, "norm").pvalue > 0.01) == (tone == "good")


def test_a_campaign_without_results_is_no_verdict(origin):
    lost = [
        RunRecord.model_validate({"run": 0, "status": "failed", "error": {"type": "E", "message": "<m>"}})
    ]
    report = campaign_report("study", summarise(lost), lost, origin)
    text = render(report)
    assert report.tone == "neutral" and "&lt;m&gt;" in text
    check_page(text, {"failures"})


def test_the_study_of_table_4_stands_beside_the_paper(origin):
    def row(case: str, controller: str, e: float) -> dict:
        found = {"median": e, "interval": [0.9 * e, 1.1 * e]}
        return {
            "case": case, "note": "5 %", "K_P": 4.0, "K_D": 4.0, "controller": controller, "draws": 5,
            "runs_at_a_limit": 0, "e_base": found, "e_joints": found, "e_base_paper": 2 * e,
        }  # fmt: skip

    claim = {"share": 1.0, "median_ratio": 0.5, "verdict": "holds"}
    study = {
        "case_D": "the estimate's model",
        "rows": [row("D", "pd", 1e-4), row("C", "hinf", 2e-4)],
        "orderings": [{"smaller": "D pd", "larger": "C pd", "e_base": claim, "e_joints": claim}],
        "improvements": [
            {"controller": "pd", "against": "B", "lower_percent": [1.0, 2.0], "paper": (3.0, 4.0)}
        ],
    }
    report = study_report(json.loads(json.dumps(study)), "craft", origin)
    check_page(render(report), {"errors-base", "errors-joints", "orderings"})
    assert report.tone == "good" and "2 hold" in report.verdict
    for e in ("e_base", "e_joints"):
        study["orderings"][0][e] = {**claim, "verdict": "undecided"}
    undecided = study_report(study, "craft", origin)
    assert undecided.tone == "neutral" and "More draws decide" in undecided.verdict
    mark, paper = report.sections[0].parts[0].body.rows[0].items
    assert (mark.low, mark.value, mark.high, paper.value) == pytest.approx((9e-5, 1e-4, 1.1e-4, 2e-4))


def test_the_worst_parameters_stand_to_either_side():
    found = Robustness(0.4, 1.0, 0.1, 0.01, {"a": 1.0, "b": -0.5, "c": 0.1}, 100, 0, 0.02)
    _, figure = _robust(found)
    chart = figure.body
    assert [chart.span(r.items[0].start, r.items[0].value) for r in chart.rows] == [
        pytest.approx((50.0, 50 / 1.1), abs=0.02),
        pytest.approx((50 - 25 / 1.1, 25 / 1.1), abs=0.02),
        pytest.approx((50.0, 5 / 1.1), abs=0.02),
    ]
    assert not replace(found, unstable=1).stable


def test_how_far_a_zero_description_is_off_is_no_share():
    p = classify("link1.Ixy", 0.03, "kg m^2", 0.01, "exp2.step_b", nominal=0.0)
    items = identifiability("x", [p]).body.rows[0].items
    assert len(items) == 1  # nothing is a share of zero: the bar alone
    assert not any("∞" in cell.text or "inf" in cell.text for cell in parameter_table("t", [p]).rows[0])
