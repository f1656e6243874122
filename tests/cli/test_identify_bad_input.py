"""`smsid identify` on a recording with a hole: from the linear start to the refinement."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from likelihood import twin

from smsid.cli import main
from smsid.identify import load_estimate
from smsid.likelihood.combinations import effects_and_mass
from smsid.likelihood.parameters import Parameters
from smsid.recording import save_recording


def test_two_seconds_that_are_not_finite(tmp_path: Path, monkeypatch, capsys):
    recording = twin.noisy(twin.exp1((1, 1, 1), 60.0), 0)
    times = recording.time("imu.acceleration")
    channels = {}
    for name in ("imu.acceleration", "imu.angular_rate"):
        values = np.array(recording[name])
        values[(times >= 25.0) & (times <= 27.0)] = np.nan
        channels[name] = values
    file, out = tmp_path / "exp1.nc", tmp_path / "estimate.json"
    save_recording(recording.with_channels(channels), file)
    arguments = ["identify", str(twin.URDF / "paper_sms.toml"), str(file), "-o", str(out)]
    monkeypatch.setattr(sys, "argv", ["smsid", *arguments])
    try:
        main()
    except SystemExit as end:
        assert not end.code, capsys.readouterr().err
    text = " ".join(capsys.readouterr().out.split())
    assert "imu.acceleration bridged" in text
    assert "left out" in text
    at = Parameters.of(twin.model())
    truth = {c.name: c.value for c in effects_and_mass(at, at)}
    found = load_estimate(out)
    assert found.method == "maximum_likelihood"
    good = [p for p in found.parameters if p.name in truth and p.status == "identifiable"]
    assert {"total.mass", "tank.mass", "tank.stiffness.x", "panel.mode2.frequency"} <= {p.name for p in good}
    for p in good:
        assert abs(p.value - truth[p.name]) < 4.5 * p.sigma, f"{p.name}: {p.value} +- {p.sigma}"
