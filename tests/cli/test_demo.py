"""The demonstration finds what was hidden, and its page says so with the figures of its files."""

from __future__ import annotations

import json
import re

import pytest

from smsid.cli.demo import wrong_guess
from smsid.datasets import demonstration
from smsid.description import load_description
from smsid.model import build_model
from smsid.recording import load_recording
from tests.cli.test_commands import run


def test_it_needs_nothing_but_the_package():
    which = demonstration()
    description = load_description(which.description)
    assert not any(e.kind == which.hidden["effect"] for e in description.effect)
    for path, role in ((which.estimation, "estimation"), (which.validation, "validation")):
        recording = load_recording(path)
        recording.check()
        assert recording.role == role and path.stat().st_size < 300_000
        assert "MuJoCo" in recording.provenance["simulated_by"]


def test_the_guess_is_off_and_can_exist(urdf, tmp_path):
    true = load_description(urdf / "paper_sms.toml")
    guess = build_model(wrong_guess(true, tmp_path))
    off = guess.mass / build_model(true).mass - 1.0
    assert 0.01 < abs(off) < 0.1
    tank = load_description(tmp_path / "paper_guess.toml").get_effect("tank")
    assert tank.mass == pytest.approx(1.06 * 49.6)


@pytest.mark.slow
def test_the_page_names_what_was_hidden(tmp_path):
    done = run("demo", "--output", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "In plain words: joint2 has viscous friction" in page
    assert "The interval found holds it." in page
    for wrong in ("infinity", "∞", "nan %", "error 480"):
        assert wrong not in page
    found = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert [c["location"] for c in found["causes"]] == ["joint2"]
    # what is four thousand of its standard deviations away from nothing is told so
    (cause,) = found["causes"]
    (value,) = (p for p in cause["parameters"] if p["name"].endswith("viscous"))
    assert cause["evidence"]["likelihood_ratio"] == pytest.approx(
        (value["value"] / value["sigma"]) ** 2, rel=0.5
    )
    assert cause["evidence"]["p_value"] < 1e-6 and cause["evidence"]["information_gain"] > 0.0
    assert load_description(tmp_path / "out" / "extended.toml").get_effect("joint_friction_joint2")
    for target in re.findall(r'<a href="([^"#][^"]*)"', page):
        assert (tmp_path / "out" / target).exists(), target
