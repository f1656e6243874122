"""Oscillators fitted by simulation error, from another integrator's output; the Silverbox."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from smsid.datasets import have, silverbox
from smsid.datasets._recordings import SILVERBOX_RATE
from smsid.errors import NotIdentifiableError
from smsid.lab import Oscillator, fit_oscillator

RATE, N = 100.0, 2500


def multisine(seed):
    """Band-limited drive as sums of sines that can be evaluated anywhere."""
    rng = np.random.default_rng(seed)
    f, phase = rng.uniform(0.5, 20.0, 60), rng.uniform(0, 2 * np.pi, 60)
    return lambda t: 0.04 * np.sum(np.sin(2 * np.pi * f * np.asarray(t)[..., None] + phase), axis=-1)


def output(truth, drive):
    w = 2 * np.pi * truth.frequency

    def slope(t, s):
        x, v = s
        spring = x * (1.0 + truth.quadratic * x + truth.cubic * x * x)
        return [v, w * w * (truth.gain * float(drive(t)) - spring) - 2 * truth.damping * w * v]

    times = np.arange(N) / RATE
    done = solve_ivp(
        slope, (0.0, times[-1]), [0.0, 0.0], "DOP853", times, rtol=1e-8, atol=1e-10, max_step=0.01
    )
    return done.y[0] + truth.offset


TRUTH = Oscillator(frequency=8.0, damping=0.1, gain=1.2, quadratic=0.1, cubic=0.4, offset=0.02)


@pytest.fixture(scope="module")
def record():
    drive = multisine(1)
    return drive(np.arange(N) / RATE), output(TRUTH, drive)


def test_simulation_agrees_with_another_integrator(record):
    drive, measured = record
    late = slice(600, -100)
    error = (TRUTH.simulate(drive, RATE) - measured)[late]
    assert np.sqrt(np.mean(error**2)) < 3e-3 * np.std(measured)


def test_the_truth_is_found_within_intervals(record):
    drive, measured = record
    noisy = measured + 0.002 * np.random.default_rng(2).normal(size=N)
    start = Oscillator(frequency=7.8, damping=0.08, gain=1.0)
    found = fit_oscillator(drive, noisy, RATE, start, terms=("quadratic", "cubic"), pieces=2)
    for p in found.estimate.parameters:
        expected = getattr(TRUTH, p.name.split(".")[1])
        assert abs(p.value - expected) < max(4.0 * p.sigma, 2e-3 * abs(expected)), p.name
    assert found.rmse == pytest.approx(0.002, rel=0.1)


def test_quintic_spring_and_growing_damping_are_found():
    truth = Oscillator(8.0, 0.08, 1.2, cubic=0.3, quintic=0.2, damping_growth=0.8)
    drive = multisine(5)
    w = 2 * np.pi * truth.frequency

    def slope(t, s):
        x, v = s
        spring = x + 0.3 * x**3 + 0.2 * x**5
        return [v, w * w * (1.2 * float(drive(t)) - spring) - 2 * 0.08 * w * (1.0 + 0.8 * x * x) * v]

    times = np.arange(N) / RATE
    done = solve_ivp(
        slope, (0.0, times[-1]), [0.0, 0.0], "DOP853", times, rtol=1e-8, atol=1e-10, max_step=0.01
    )
    terms = ("cubic", "quintic", "damping_growth")
    start = Oscillator(8.0, 0.1, 1.2, cubic=0.3)
    found = fit_oscillator(drive(times), done.y[0], RATE, start, terms=terms, pieces=2)
    for name in terms:
        assert getattr(found.oscillator, name) == pytest.approx(getattr(truth, name), rel=0.1), name


def test_a_hardening_spring_is_missed_by_a_linear_model(record):
    drive, measured = record
    start = Oscillator(frequency=8.0, damping=0.1, gain=1.0)
    linear = fit_oscillator(drive, measured, RATE, start, pieces=2)
    cubic = fit_oscillator(drive, measured, RATE, linear.oscillator, terms=("quadratic", "cubic"), pieces=2)
    assert cubic.rmse < 0.1 * linear.rmse
    assert linear.estimate.parameters[-1].name == "oscillator.offset" and len(linear.estimate.parameters) == 4


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"pieces": 200}, "too short"),
        ({"terms": ("quartic",)}, "no term"),
        ({"start": Oscillator(8.0, 0.1, 1.0, cubic=-500.0)}, "runs away"),
    ],
)
def test_what_cannot_be_fitted_is_refused(record, change, text):
    drive, measured = record
    arguments = {"start": Oscillator(8.0, 0.1, 1.0), "pieces": 2, **change}
    with pytest.raises(NotIdentifiableError, match=text):
        fit_oscillator(drive, measured, RATE, **arguments)


def let_go(truth, seconds, begin, seed=0, noise=0.01):
    """An oscillator that was let go, integrated by another method."""
    w, times = 2 * np.pi * truth.frequency, np.arange(0.0, seconds, 1.0 / RATE)

    def slope(_, s):
        return [s[1], -w * w * s[0] * (1.0 + truth.cubic * s[0] ** 2) - 2 * truth.damping * w * s[1]]

    done = solve_ivp(slope, (0.0, seconds), [begin, 0.0], "DOP853", times, rtol=1e-9, atol=1e-11)
    return done.y[0] + truth.offset + noise * np.random.default_rng(seed).normal(size=times.size)


def test_a_hardening_spring_is_found_from_a_free_decay():
    truth = Oscillator(frequency=2.3, damping=0.012, gain=1.0, cubic=0.3, offset=0.4)
    scores = []
    for seed in range(8):
        measured = let_go(truth, 4.0, 1.0, seed)
        start = Oscillator(frequency=2.4, damping=0.02, gain=1.0)
        found = fit_oscillator(None, measured, RATE, start, terms=("cubic",), pieces=1).estimate
        names = [p.name.split(".")[1] for p in found.parameters]
        assert names == ["frequency", "damping", "cubic", "offset"]
        scores += [
            (p.value - getattr(truth, n)) / p.sigma for p, n in zip(found.parameters, names, strict=True)
        ]
        assert found["oscillator.cubic"].sigma < 0.01
    assert np.mean(np.abs(scores) < 1.96) > 0.8 and np.abs(scores).max() < 4.0


def test_a_driven_record_may_begin_anyhow_and_be_short(record):
    """Three seconds out of the middle, which does not begin at rest."""
    drive, measured = record
    part = slice(700, 1000)
    noisy = measured[part] + 0.002 * np.random.default_rng(3).normal(size=300)
    start = Oscillator(frequency=7.8, damping=0.08, gain=1.0)
    found = fit_oscillator(drive[part], noisy, RATE, start, terms=("quadratic", "cubic"), pieces=1)
    for p in found.estimate.parameters:
        expected = getattr(TRUTH, p.name.split(".")[1])
        assert abs(p.value - expected) < max(4.0 * p.sigma, 0.02 * abs(expected)), p.name


@pytest.mark.slow
def test_silverbox_below_one_millivolt_on_the_arrow():
    if not have("silverbox"):
        pytest.skip("SMSID_DATA has no copy of silverbox")
    train, arrow = silverbox(download=False)
    start = Oscillator(frequency=68.0, damping=0.05, gain=1.0)
    found = fit_oscillator(
        train["extra.input"], train["extra.output"], SILVERBOX_RATE, start, terms=("quadratic", "cubic")
    )
    assert found.oscillator.cubic > 0.0
    error = arrow["extra.output"] - found.oscillator.simulate(arrow["extra.input"], SILVERBOX_RATE)
    assert 1e3 * np.sqrt(np.mean(error**2)) < 1.0
