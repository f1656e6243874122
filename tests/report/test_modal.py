"""The report of an ambient test: correlations measured and fitted, spectrum, stabilisation diagram."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lab import test_modal as case

from smsid.cli import main
from smsid.lab import ambient_modes
from smsid.recording import Recording, save_recording
from smsid.report import render
from smsid.report.modal import correlation_traces, modal_report

from .pages import check_page

LARGEST = 5_000_000  # bytes


@pytest.fixture(scope="module")
def rig():
    """Outputs of two close modes with a machine's sine beside them, and what is found."""
    y = case.structure(case.CLOSE, seed=5, sine=9.1)
    return y, ambient_modes(y, case.RATE, highest_frequency=10.0)


def part(report, name):
    return next(
        q
        for s in report.sections
        for p in s.parts
        for q in (p, *getattr(p, "figures", ()))
        if getattr(q, "name", "") == name
    )


def test_modes_explain_the_correlations_to_their_scatter(rig):
    y, found = rig
    traces = correlation_traces(y, case.RATE, found)
    assert len(traces) == 3
    strongest = int(np.argmax(np.var(y, axis=0)))
    assert traces[0].name == f"output {strongest + 1}"
    x = y[:, strongest] - y[:, strongest].mean()
    for t in traces:
        assert t.whitened_rms < 1.5
    t = traces[0]
    step = round(case.RATE / found.rate)
    for k in (0, 3, 10):  # beside a correlation computed one product at a time
        lag = round(t.time[k] * case.RATE)
        assert lag == (k + 1) * step
        direct = x[lag:] @ x[:-lag] / (x @ x)
        assert t.measured[k] == pytest.approx(direct, abs=0.02)


def test_without_the_modes_the_correlations_are_not_explained(rig):
    y, found = rig
    less = replace(found, modes=found.modes[:1], harmonics=())
    assert correlation_traces(y, case.RATE, less)[0].whitened_rms > 2.0


def test_the_report_has_modes_harmonic_and_diagram(rig, origin):
    y, found = rig
    report = modal_report("rig", "phone.acceleration", y, case.RATE, 10.0, found, origin)
    text = render(report)
    names = {"parameters", "known", "residuals", "traces", "spectrum", "psd", "diagram", "stabilisation-0"}
    page = check_page(text, names)
    assert len(text) < LARGEST
    assert {"mode1.frequency", "mode2.damping", "mode2.frequency - mode1.frequency"} <= set(page.texts["th"])
    assert "9.1 Hz: harmonics, no modes" in report.verdict
    spectrum = part(report, "psd").body
    lines = [float(label.split()[0]) for label, _, _ in spectrum.labels()]
    assert lines == pytest.approx([7.0, 7.3, 9.1], rel=0.01)
    diagram = part(report, "stabilisation-0").body
    rings = diagram.marks[-1]
    for mode in found.modes:  # stable poles stand about every mode, at several orders
        near = np.abs(rings.x - mode.frequency) < 0.01 * mode.frequency
        assert len(set(rings.y[near])) >= 3


def test_the_command_writes_it(tmp_path: Path, monkeypatch):
    y = case.structure(case.CLOSE[:1])
    times = np.arange(len(y)) / case.RATE
    save_recording(Recording.from_arrays(times, {"phone.acceleration": y}, name="beam"), tmp_path / "m.nc")
    command = ["lab", "modal", str(tmp_path / "m.nc"), "--highest", "10", "-o", str(tmp_path / "e.json")]
    command += ["--report", str(tmp_path / "report.html"), "--quiet"]
    monkeypatch.setattr("sys.argv", ["smsid", *command])
    main()
    page = check_page((tmp_path / "report.html").read_text(encoding="utf-8"), {"residuals", "diagram"})
    assert any(t.endswith("m.nc") for texts in page.texts.values() for t in texts)  # among the inputs
    assert page.texts["p"][0] == "Modes from ambient vibration"
