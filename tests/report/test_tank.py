"""The report of a tank test: force measured and fitted, models compared, the lag told two ways."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from lab import test_tank as case

from smsid.cli import main
from smsid.lab import compare_tank_models, tank_test
from smsid.recording import Recording, save_recording
from smsid.report import render
from smsid.report.tank import tank_report

from .pages import check_page

LARGEST = 5_000_000  # bytes


@pytest.fixture(scope="module")
def compared():
    test = tank_test(*case.simulated(0.0), cutoff=15.0)
    return test, compare_tank_models(test, ["rigid", "slosh"])


def part(report, name):
    return next(p for s in report.sections for p in s.parts if getattr(p, "name", "") == name)


def test_force_residual_and_scale_are_those_of_the_fits(compared, origin):
    test, found = compared
    report = tank_report("tank", test, found, origin)
    page = check_page(
        render(report), {"parameters", "known", "lag", "models", "residuals", "traces", "notes"}
    )
    assert {"rigid", "slosh", "tank.slosh_mass"} <= set(page.texts["th"]) | set(page.texts["button"])
    body = part(report, "traces").body
    rigid, slosh = body.traces
    assert body.traces[body.first] is slosh and found.named == "slosh"
    for t in body.traces:
        np.testing.assert_allclose(t.measured - t.simulated, t.residual, atol=1e-12)
        before = test.time < 0.95  # the container sets off at 1 s
        assert t.sigma == pytest.approx(np.sqrt(np.mean(slosh.residual[before] ** 2)), rel=0.05)
    np.testing.assert_array_equal(slosh.before, rigid.residual)
    lag = part(report, "lag").body
    for row in lag.rows:
        mark = row.items[0]
        assert mark.low < 1e3 * case.LAG < mark.high
    assert report.tone == "good" and "slosh at 2.5" in report.verdict


def test_a_rigid_fit_alone_is_no_good(compared, origin):
    test, _ = compared
    report = tank_report("tank", test, compare_tank_models(test, ["rigid"]), origin)
    assert report.tone == "warn" and "does not explain all of it" in report.verdict


def test_the_command_writes_it(tmp_path: Path, monkeypatch, capsys):
    (t1, force), (t2, place) = case.simulated(0.0)
    none = np.zeros_like(force)
    channels = {
        "hand.force": (t1, np.stack([none, force, none], axis=1)),
        "pose.position": (t2, np.stack([place, 0 * place, 0 * place], axis=1)),
    }
    save_recording(Recording.from_arrays(None, channels, name="tank"), tmp_path / "t.nc")
    command = ["lab", "tank", str(tmp_path / "t.nc"), "--force", "hand.force.y"]
    command += ["--position", "pose.position.x", "--models", "rigid,slosh", "-o", str(tmp_path / "e.json")]
    monkeypatch.setattr("sys.argv", ["smsid", *command, "--report", str(tmp_path / "report.html")])
    main()
    assert "report.html" in capsys.readouterr().out.replace("\n", "")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert len(text) < LARGEST
    page = check_page(text, {"parameters", "models", "residuals", "provenance"})
    assert any(t.endswith("t.nc") for texts in page.texts.values() for t in texts)  # among the inputs
