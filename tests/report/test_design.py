"""The report of a design: its signals, what they will tell, and what they use of the limits."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from smsid.cli import main
from smsid.description import load_description
from smsid.design import Limits
from smsid.design.model_discrimination import Discrimination, Separation
from smsid.experiments import Experiment, LimitUse, StepProfile, thrust_experiment
from smsid.model import build_model
from smsid.report import render
from smsid.report.design import design_report, signal_grids, signal_points, verdict

from .pages import check_page, needs_chromium, run_page

LARGEST = 5_000_000  # bytes


@pytest.fixture(scope="module")
def designed(tmp_path_factory: pytest.TempPathFactory, urdf: Path) -> Path:
    """Folder of a short thrust for the damping of the slosh, with its report and JSON."""
    folder = tmp_path_factory.mktemp("designed")
    command = ["design", str(urdf / "paper_sms.toml"), "--for", "tank.damping.x", "--stroke", "0.1"]
    command += ["--duration", "12", "-o", str(folder / "e.toml"), "--report", str(folder / "report.html")]
    with pytest.MonkeyPatch.context() as patch, (folder / "out.json").open("w") as out:
        patch.setattr("sys.argv", ["smsid", *command, "--json"])
        patch.setattr("sys.stdout", out)
        main()
    return folder


def test_the_command_writes_it_with_every_section(designed):
    text = (designed / "report.html").read_text(encoding="utf-8")
    page = check_page(
        text, {"precision", "sigmas", "signals", "force-0", "limits", "limit-chart", "provenance"}
    )
    assert len(text) < LARGEST
    document = json.loads((designed / "out.json").read_text())
    assert str(designed / "report.html") in document["written"]
    assert {"tank.damping.x", "stroke of tank"} <= set(page.texts["th"])
    assert any("paper_sms.urdf" in t for t in page.texts["th"])  # the inputs' sums
    assert "none stated" in page.texts["td"]  # of the panel's tip


@needs_chromium
def test_it_fits_a_narrow_window(designed, tmp_path):
    script = (
        "return [document.documentElement.scrollWidth, innerWidth, document.querySelectorAll('.plot').length]"
    )
    wide, window, plots = run_page(designed / "report.html", script, tmp_path, size="420,900")
    assert wide <= window
    assert plots > 0


def test_steps_are_drawn_upright_and_at_their_height():
    signal = StepProfile(times=(0.0, 2.0, 5.0), values=((3.0,), (-1.0,), (0.0,))).signal()
    times, values = signal_points(signal, 10.0)
    assert (times[0], times[-1]) == (0.0, 10.0)
    for jump, before, after in ((2.0, 3.0, -1.0), (5.0, -1.0, 0.0)):
        k = int(np.flatnonzero(times == jump)[0])
        assert jump - times[k - 1] < 1e-9
        assert (values[k - 1, 0], values[k, 0]) == (before, after)


def test_only_what_is_commanded_is_drawn_with_the_reference_behind(urdf):
    model = build_model(load_description(urdf / "paper_sms.toml"))
    one, other = thrust_experiment("x", force=3.0, duration=12.0), thrust_experiment("xz", force=2.0)
    (grid,) = signal_grids(model, one, other)
    assert [f.title for f in grid.figures] == ["along x", "along z"]
    both, alone = (f.body for f in grid.figures)
    assert [(m.label, m.y.max(), m.x[-1]) for m in both.marks] == [
        ("before", 2.0, 120.0),
        ("designed", 3.0, 12.0),
    ]
    assert [m.label for m in alone.marks] == ["before"]


def separation(*uses: LimitUse) -> Separation:
    one = Experiment(name="separate", note="thrust", duration=20.0)
    rows = (Discrimination("viscous at joint2", "viscous", "N m s/rad", 0.02, 0.08),)
    return Separation(one, rows, 0.5, one, 0.9, uses, 7)


def test_limits_stand_with_their_margin_and_a_passed_one_is_the_verdict(urdf, origin):
    model = build_model(load_description(urdf / "paper_sms.toml"))
    uses = (
        LimitUse("free", 3.0, None, "m"),
        LimitUse("stroke", 0.2, 0.5, "m"),
        LimitUse("force", 39.0, 40.0, "N"),
    )
    limits = Limits(margin=0.1)
    report = design_report(separation(*uses[:2]), model, limits, None, origin)
    check_page(render(report), {"detection", "limit-chart"})
    assert report.tone == "good" and "4 times smaller" in report.verdict
    chart, table = next(s for s in report.sections if s.name == "limits").parts
    assert [(r.name, r.items[0].value) for r in chart.body.rows] == [("stroke", pytest.approx(0.4))]
    assert chart.body.rules[0][0] == pytest.approx(0.9)
    row = dict(zip(table.columns, table.rows[0], strict=True))
    assert (row["quantity"].text, row["#margin left"].value) == ("stroke", pytest.approx(0.3))
    sentence, tone = verdict(separation(*uses), limits)
    assert tone == "bad" and "force: 39 N (limit 40 N)" in sentence
