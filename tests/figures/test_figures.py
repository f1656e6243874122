"""Figures for papers: every kind, every format, what is drawn is what is in the file."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from smsid.diagnose import Diagnosis, save_diagnosis
from smsid.diagnose.result import SignificantTest
from smsid.errors import MissingDependencyError, NotIdentifiableError, SmsidError
from smsid.figures import KINDS, draw
from smsid.figures.draw import (
    Request,
    campaign_figure,
    estimate_figure,
    recording_figure,
    stabilisation_figure,
)
from smsid.identify.estimate import save_estimate
from smsid.recording import Recording, save_recording
from tests.report.test_builders import ESTIMATE, TESTS, records


@pytest.fixture
def recording() -> Recording:
    time = np.linspace(0.0, 10.0, 20_001)
    rate = np.column_stack([np.sin(time), np.cos(time), 0.1 * time])
    angles = np.column_stack([time, -time])
    return Recording.from_arrays(
        time,
        {"imu.angular_rate": rate, "encoder.joint_position": angles, "truth.slosh_position": rate},
        labels={"joint": ["shoulder", "elbow"]},
        name="log",
    )


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_every_format_is_what_it_says_and_the_same_each_time(recording, tmp_path, suffix):
    save_recording(recording, tmp_path / "log.nc")
    both = [draw("recording", Request(tmp_path / "log.nc"), tmp_path / f"{k}{suffix}") for k in "ab"]
    first = both[0].read_bytes()
    assert first.startswith({".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}[suffix])
    assert first == both[1].read_bytes()
    if suffix == ".svg":
        text = first.decode("utf-8")
        assert "imu.angular_rate" in text and "shoulder" in text and "truth" not in text


def test_curves_are_the_samples(recording):
    figure = recording_figure(recording, ["encoder.joint_position"])
    lines = figure.axes[0].get_lines()
    assert len(figure.axes) == 1 and [x.get_label() for x in lines] == ["shoulder", "elbow"]
    np.testing.assert_allclose(lines[1].get_ydata(), -lines[1].get_xdata())
    assert len(lines[0].get_xdata()) <= 4001 + 1
    with pytest.raises(SmsidError, match="has no gps"):
        recording_figure(recording, ["gps.position"])


def test_bars_of_an_estimate_are_its_intervals():
    figure = estimate_figure(ESTIMATE)
    ax = figure.axes[0]
    widths = {round(p.get_y() + p.get_height() / 2): p.get_width() for p in ax.patches}
    assert widths == pytest.approx(
        {k: 1.959964 * p.relative_sigma for k, p in enumerate(ESTIMATE.parameters)}
    )
    (dots,) = [x for x in ax.get_lines() if x.get_marker() == "o"]
    np.testing.assert_allclose(dots.get_xdata(), [1 / 49.0 * 49.0 / 50.0, 0.01 / 0.03, 0.1 / 10.1], rtol=1e-9)


def test_the_map_is_drawn_from_the_file(tmp_path):
    tests = tuple(SignificantTest(t.where, t.dependence, t.ratio, t.freedom, t.p_value) for t in TESTS)
    made = Diagnosis("craft", (), "explained", "It is.", tests={"nominal": tests, "extended": tests[1:3]})
    save_diagnosis(made, tmp_path / "d.json")
    path = draw("diagnosis", Request(tmp_path / "d.json"), tmp_path / "map.svg")
    text = path.read_text(encoding="utf-8")
    assert "torque of joint10" in text and "with the causes" in text
    save_diagnosis(Diagnosis("craft", (), "not_evaluated", "no command"), tmp_path / "d.json")
    with pytest.raises(SmsidError, match="no command"):
        draw("diagnosis", Request(tmp_path / "d.json"), tmp_path / "map.svg")


def test_coverage_stands_at_its_place():
    from smsid.campaign.summary import summarise

    summary = summarise(records(1.0))
    left, right = campaign_figure(summary).axes
    marks = [next(x for x in ax.get_lines() if x.get_marker() == "o").get_xdata()[0] for ax in (left, right)]
    assert marks == [summary["mass"].coverage, summary["mass"].ratio]


def test_what_cannot_be_drawn_is_refused_with_the_mend(recording, tmp_path, urdf, monkeypatch):
    save_recording(recording, tmp_path / "log.nc")
    save_estimate(ESTIMATE, tmp_path / "e.json")
    asked = Request(tmp_path / "log.nc")
    with pytest.raises(SmsidError, match=f"Choose one of {', '.join(KINDS)}"):
        draw("pie", asked, tmp_path / "a.png")
    with pytest.raises(SmsidError, match=r"End it in \.png"):
        draw("recording", asked, tmp_path / "a.gif")
    with pytest.raises(SmsidError, match="does not exist"):
        draw("recording", Request(tmp_path / "none.nc"), tmp_path / "a.png")
    with pytest.raises(SmsidError, match="--description"):
        draw("stabilisation", asked, tmp_path / "a.png")
    with pytest.raises(SmsidError):
        draw("campaign", Request(tmp_path / "e.json"), tmp_path / "a.png")
    assert not list(tmp_path.glob("a.*"))
    from smsid.description import load_description
    from smsid.model import build_model

    with pytest.raises(NotIdentifiableError, match="no modes"):
        stabilisation_figure(build_model(load_description(urdf / "paper_sms.toml")), recording)
    monkeypatch.setitem(__import__("sys").modules, "matplotlib", None)
    with pytest.raises(MissingDependencyError, match=r"smsid\[plot\]"):
        draw("recording", asked, tmp_path / "a.png")
