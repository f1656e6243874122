"""Reports as the commands write them, from short flights."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from smsid.arm import identify_arm, with_joint_effects
from smsid.cli import main
from smsid.description import load_description
from smsid.diagnose import DetectionThresholds, Diagnosis, DiagnosisRun, ProcessNoise, diagnose
from smsid.diagnose.hypotheses import propose
from smsid.diagnose.priors import nominal
from smsid.diagnose.stepwise import search
from smsid.effects import JointFriction
from smsid.estimation.measurements import measurements_of
from smsid.estimation.problem import CommandTiming, Problem
from smsid.experiments import fly, named_experiment
from smsid.model import build_model
from smsid.recording import save_recording
from smsid.report import render
from smsid.report.arm import arm_report
from smsid.report.diagnose import DiagnosisInputs, diagnose_report

from .pages import check_page, needs_chromium, run_page

LARGEST = 5_000_000  # bytes


@pytest.fixture(scope="module")
def identified(tmp_path_factory: pytest.TempPathFactory, urdf: Path) -> Path:
    """The report of an identification by the linear method, from a flight of Exp. 1 along x."""
    folder = tmp_path_factory.mktemp("identified")
    model = build_model(load_description(urdf / "paper_sms.toml"))
    flown = fly(model, named_experiment("exp1_xyz", model), np.random.default_rng(1)).recording
    save_recording(flown, folder / "exp1.nc")
    command = ["identify", str(urdf / "paper_sms.toml"), str(folder / "exp1.nc"), "--method", "paper"]
    command += ["-o", str(folder / "estimate.json"), "--report", str(folder / "report.html"), "--quiet"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["smsid", *command])
        main()
    return folder / "report.html"


def test_an_identification_has_every_section(identified):
    text = identified.read_text(encoding="utf-8")
    page = check_page(
        text,
        {"parameters", "known-single", "residuals", "traces", "spectra", "modes", "stabilisation-0"},
    )
    assert len(text) < LARGEST
    assert "tank.mass" in page.texts["th"]
    assert any("paper_sms.urdf" in t for t in page.texts["th"])
    assert any("--report" in t for t in page.texts["code"])
    assert page.texts["p"][0] == "Identification by the paper's linear method"
    assert any("parameters are identified to better than 10 %" in t for t in page.texts["p"])


@needs_chromium
def test_its_records_zoom_in_a_browser(identified, tmp_path):
    found = run_page(
        identified,
        """
        const plot = document.querySelector(".traces .plot");
        const before = plot.dataset.span;
        document.querySelector('[data-do="in"]').click();
        return [before, plot.dataset.span, document.querySelectorAll("svg path").length,
          document.documentElement.scrollWidth <= innerWidth];
        """,
        tmp_path,
        size="500,900",
    )
    before, after = ([float(x) for x in text.split()] for text in found[:2])
    assert after[1] - after[0] == pytest.approx(0.5 * (before[1] - before[0]))
    assert found[2] > 40  # curves, spectra and small residuals are all there
    assert found[3]


def test_a_search_shows_candidates_aliases_spectra_and_innovations(urdf, origin):
    described = load_description(urdf / "paper_sms.toml")
    world = build_model(described.with_effects(JointFriction(name="seal", joint="joint2", viscous=0.5)))
    plan = named_experiment("exp2", build_model(described)).model_copy(update={"duration": 6.0})
    recording = fly(world, plan, np.random.default_rng(3)).recording
    known = nominal(described, None)
    data = measurements_of(known.point.base, recording, described.effective_sensors()).thinned(6.0)
    problem = Problem(
        recording, data, np.array([], dtype=int), CommandTiming("linear", "right"), ProcessNoise()
    )
    every = propose(known.point, problem, known.unknowns)
    some = [c for c in every if c.family == "friction" and c.shape in ("viscous", "coulomb")][:6]
    found = search(known.point, problem, known.unknowns, some, DetectionThresholds(causes=1))
    assert found.causes
    result = Diagnosis("paper_sms", (recording.name,), "explained", "It lacks friction.")
    report = diagnose_report(
        DiagnosisRun(result, described, found), DiagnosisInputs(described, [recording], rate=6.0), origin
    )
    text = render(report)
    check_page(text, {"ranking", "alias-matrix", "spectra", "traces", "gain"})
    ranking = next(p for s in report.sections for p in s.parts if getattr(p, "name", "") == "ranking")
    winner = found.causes[0].score.candidate
    named = [r.name for r in ranking.body.rows if r.value.endswith("the cause")]
    assert named == [f"{winner.shape.replace('_', ' ')} at {winner.location}"]
    whole = ranking.body.rows[0].items[0].value
    assert whole == pytest.approx(1.0, abs=1e-6)  # the cause does all of what it does
    assert all(0.0 <= r.items[0].value <= whole for r in ranking.body.rows)
    places = next(p for s in report.sections for p in s.parts if getattr(p, "name", "") == "share-map")
    marked = [(r, c) for r, row in places.body.table() for c in row if c.marked]
    assert len(marked) == 1 and marked[0][0] == "torque of joint2" and marked[0][1].text == "100"
    assert "inf" not in {c.text for row in places.body.cells for c in row}
    story = next(s for s in report.sections if s.name == "story")
    assert "recording that was diagnosed" in story.summary  # no other was given
    matrix = next(p for s in report.sections for p in s.parts if getattr(p, "name", "") == "alias-matrix")
    values = np.array([[float(c.text) for c in row] for row in matrix.body.cells])
    np.testing.assert_allclose(values, values.T)
    assert (values.min() >= 0.0) and (values.max() <= 1.0)
    traces = next(p for s in report.sections for p in s.parts if getattr(p, "name", "") == "traces")
    encoder = next(t for t in traces.body.traces if t.name.startswith("encoder joint position"))
    np.testing.assert_allclose(encoder.measured - encoder.simulated, encoder.residual, atol=1e-12)


def test_real_arms_are_shown_by_their_torques(origin):
    datasets = pytest.importorskip("smsid.datasets")
    try:
        bare, log = datasets.tx40()
    except Exception as error:
        pytest.skip(f"no recording of a real arm: {error}")
    train = log.window(0.0, 2.9999).with_role("estimation").with_name("train")
    held = log.window(6.0, 7.5).with_role("validation").with_name("held")
    friction = with_joint_effects(
        bare, log.labels["joint"], "joint_friction", "motor_inertia", "torque_offset"
    )
    found = identify_arm(friction, train)
    report = arm_report(found, [train, held], origin)
    check_page(render(report), {"parameters", "residuals", "traces", "spectra"})
    figure = next(p for s in report.sections for p in s.parts if getattr(p, "name", "") == "traces")
    mine = [t for t in figure.body.traces if t.name.startswith("held: ")]
    left, whole = (np.concatenate([getattr(t, k) for t in mine]) for k in ("residual", "measured"))
    assert np.linalg.norm(left) / np.linalg.norm(whole) == pytest.approx(found.judge(held).relative, rel=1e-9)
    diagnosed = diagnose(friction, [train], validation=[held])
    page = render(diagnose_report(diagnosed, DiagnosisInputs(friction, [train], None, [held]), origin))
    check_page(page, {"map", "traces", "spectra", "gain"})


def test_a_refusal_leaves_a_report_too(urdf, tmp_path, monkeypatch):
    model = build_model(load_description(urdf / "paper_sms.toml"))
    plan = named_experiment("exp2", model).model_copy(update={"duration": 0.5})
    save_recording(fly(model, plan, np.random.default_rng(1)).recording, tmp_path / "short.nc")
    command = ["diagnose", str(urdf / "paper_sms.toml"), str(tmp_path / "short.nc"), "--quiet"]
    command += ["-o", str(tmp_path / "d.json"), "--report", str(tmp_path / "report.html")]
    monkeypatch.setattr("sys.argv", ["smsid", *command])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 4
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    page = check_page(text, {"causes", "gain", "provenance"})
    assert any(t.startswith("Not evaluated: ") and "samples" in t for t in page.texts["p"])
