"""Commands from end to end that take a while: a diagnosis with its report, the study of Table 4."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from report.pages import check_page

from smsid.cli import main
from smsid.description import load_description
from smsid.effects import JointFriction
from smsid.experiments import fly, named_experiment
from smsid.identify.estimate import Estimate, classify, save_estimate
from smsid.model import build_model
from smsid.recording import save_recording

LARGEST = 5_000_000  # bytes
VISCOUS = 0.5  # [N m s/rad]


@pytest.fixture
def call(monkeypatch, capsys):
    """Run the command line in this process: exit code and stdout."""

    def run(*words: str | Path) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["smsid", *map(str, words)])
        try:
            main()
            code = 0
        except SystemExit as left:
            code = int(left.code or 0)
        return code, capsys.readouterr().out

    return run


@pytest.fixture
def estimate(tmp_path: Path) -> Path:
    """An estimate of the described values, as good as one of Exp. 1 is."""
    known = (
        classify("total.mass", 2256.8, "kg", 0.2, "exp1", nominal=2256.8),
        classify("tank.mass", 49.6, "kg", 0.1, "exp1", nominal=49.6),
        classify("panel.linear_density", 16.2, "kg/m", 0.05, "exp1", nominal=16.2),
    )
    save_estimate(Estimate("paper_sms", "paper", known), tmp_path / "estimate.json")
    return tmp_path / "estimate.json"


@pytest.mark.parametrize(("verdict", "seconds"), [("adequate", 6.0), ("explained", 8.0)])
def test_a_diagnosis_that_succeeds_leaves_its_report(verdict, seconds, urdf, estimate, tmp_path, call):
    """A few seconds of Exp. 2, in the second case of a spacecraft whose second joint rubs."""
    described = load_description(urdf / "paper_sms.toml")
    seal = JointFriction(name="seal", joint="joint2", viscous=VISCOUS)
    model = build_model(described if verdict == "adequate" else described.with_effects(seal))
    plan = named_experiment("exp2", build_model(described)).model_copy(update={"duration": seconds})
    recording, report = tmp_path / "exp2.nc", tmp_path / "report.html"
    save_recording(fly(model, plan, np.random.default_rng(3)).recording, recording)
    words = ["diagnose", urdf / "paper_sms.toml", recording, "--estimate", estimate, "--json"]
    code, told = call(*words, "-o", tmp_path / "d.json", "--report", report)
    document = json.loads(told)
    assert (code, document["diagnosis"]["verdict"]) == (0, verdict)
    extended = tmp_path / "extended.toml"
    written = [tmp_path / "d.json", *([extended] if verdict == "explained" else []), report]
    assert document["written"] == [str(p) for p in written]
    text = report.read_text(encoding="utf-8")
    assert len(text) < LARGEST
    page = check_page(text, {"causes", "map", "spectra", "residuals", "traces", "gain", "provenance"})
    assert any(t.startswith(verdict.capitalize()) for t in page.texts["p"])
    if verdict == "adequate":
        assert "No cause is needed: nothing significant is left." in page.texts["p"]
        assert not extended.exists()
        return
    (cause,) = document["diagnosis"]["causes"]
    assert (cause["effect"], cause["location"]) == ("joint_friction", "joint2")
    (parameter,) = cause["parameters"]
    assert abs(parameter["value"] - VISCOUS) < 4.0 * parameter["sigma"]
    found = load_description(extended).get_effect(parameter["name"].partition(".")[0])
    assert isinstance(found, JointFriction) and found.viscous == pytest.approx(parameter["value"])


@pytest.mark.slow
def test_the_study_of_table_4_leaves_its_report(urdf, tmp_path, call):
    """Every case of the paper flown once with each controller, on an estimate of both experiments."""
    flights, estimate = [tmp_path / "exp1.nc", tmp_path / "exp2.nc"], tmp_path / "estimate.json"
    for flight in flights:
        assert call("simulate", urdf / "paper_sms.toml", flight.stem, "-o", flight)[0] == 0
    assert call("identify", urdf / "paper_sms.toml", *flights, "--method", "paper", "-o", estimate)[0] == 0
    words = ["control", urdf / "paper_sms.toml", estimate, "--study", "table4", "--draws", "1", "--json"]
    code, told = call(*words, "-o", tmp_path / "table4.json", "--report", tmp_path / "report.html")
    assert code == 0
    study = json.loads(told)["study"]
    assert study == json.loads((tmp_path / "table4.json").read_text())
    assert study["case_D"] == "the estimate's model"
    assert len(study["rows"]) == 14 and {r["draws"] for r in study["rows"]} == {1}
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert len(text) < LARGEST
    page = check_page(text, {"errors-base", "errors-joints", "orderings", "provenance"})
    told = [t for texts in page.texts.values() for t in texts]
    assert any("estimate.json" in t for t in told)
    for better in study["improvements"]:  # how much lower case D is, beside what the paper prints
        assert any(f"(D) against ({better['against']}), {better['controller']}" in t for t in told)
