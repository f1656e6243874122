"""Free decays of a few seconds and one channel."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

from smsid.cli.app import app
from smsid.errors import NotIdentifiableError
from smsid.identify.estimate import load_estimate
from smsid.lab.decay import free_decay
from smsid.recording import Recording, save_recording

RATE = 100.0


def decay(frequency=2.3, damping=0.012, seconds=4.0, noise=0.02, seed=0, drift=0.3) -> np.ndarray:
    """An oscillator let go, integrated."""
    omega = 2.0 * np.pi * frequency
    t = np.arange(0.0, seconds, 1.0 / RATE)

    def rates(_, x):
        return [x[1], -(omega**2) * x[0] - 2.0 * damping * omega * x[1]]

    x = solve_ivp(rates, (0.0, seconds), [1.0, 0.0], t_eval=t, rtol=1e-9, atol=1e-11).y[0]
    return x + drift * t / seconds + 0.4 + noise * np.random.default_rng(seed).normal(size=t.size)


def test_frequency_and_damping_are_inside_their_intervals():
    scores = []
    for seed in range(20):
        (mode,) = free_decay(decay(seed=seed), RATE).modes
        scores += [(mode.frequency - 2.3) / mode.frequency_sigma, (mode.damping - 0.012) / mode.damping_sigma]
        assert mode.damping_sigma < 0.001
    assert np.mean(np.abs(scores) < 1.96) >= 0.875
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.4


def test_two_modes_are_told_apart():
    both = decay() + 0.5 * decay(5.1, 0.02, seed=1)
    found = free_decay(both, RATE)
    assert [round(m.frequency, 1) for m in found.modes] == [2.3, 5.1]
    assert found.noise == pytest.approx(0.02 * np.sqrt(1.25), rel=0.15)


@pytest.mark.parametrize("what", ["noise", "drift", "constant", "short"])
def test_what_does_not_decay_is_refused_with_a_reason(what):
    rng = np.random.default_rng(5)
    t = np.arange(400) / RATE
    signal = {
        "noise": rng.normal(size=400),
        "drift": 0.3 * t + 1e-3 * rng.normal(size=400),
        "constant": np.ones(400),
        "short": np.ones(5),
    }[what]
    with pytest.raises(NotIdentifiableError) as caught:
        free_decay(signal, RATE)
    assert caught.value.advice


def test_the_command_takes_a_free_decay(tmp_path):
    t = np.arange(0.0, 4.0, 1.0 / RATE)
    units = {"extra.deflection": "mm"}
    log = Recording.from_arrays(t, {"extra.deflection": decay()[:, None]}, units=units, name="tip")
    save_recording(log, tmp_path / "tip.nc")
    arguments = ["lab", "modal", tmp_path / "tip.nc", "--highest", "10", "-o", tmp_path / "m.json"]
    shown = CliRunner().invoke(app, [str(x) for x in arguments])
    assert shown.exit_code == 0, shown.output
    assert "free decay" in shown.output and "mode1.frequency" in shown.output


def test_the_oscillator_takes_a_channel_that_was_let_go(tmp_path):
    t, units = np.arange(0.0, 4.0, 1.0 / RATE), {"extra.output": "mm"}
    log = Recording.from_arrays(t, {"extra.output": decay(drift=0.0)[:, None]}, units=units, name="tip")
    save_recording(log, tmp_path / "tip.nc")
    arguments = ["lab", "oscillator", str(tmp_path / "tip.nc"), "-o", str(tmp_path / "o.json")]
    shown = CliRunner().invoke(app, arguments)
    assert shown.exit_code == 0, shown.output
    found = load_estimate(tmp_path / "o.json")
    for name, value in (("frequency", 2.3), ("damping", 0.012)):
        p = found[f"oscillator.{name}"]
        assert abs(p.value - value) < 4.0 * p.sigma < 0.1 * value
    refused = CliRunner().invoke(app, [*arguments, "--diagnose", str(tmp_path / "d.json")])
    assert "let go" in str(refused.exception)
