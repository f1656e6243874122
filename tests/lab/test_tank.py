"""Slosh from a tank test: a simulated tank by another integrator, and water carried by a robot."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline

from smsid.datasets import have
from smsid.errors import NotIdentifiableError, RecordingError
from smsid.lab import cylinder_slosh, fit_tank, tank_test

MASS, RIGID, FREQUENCY, DAMPING, LAG = 0.2, 1.5, 2.5, 0.01, 0.018


def move(t, duration=0.7, length=0.3, begin=1.0):
    """Rest to rest, with continuous jerk."""
    s = np.clip((t - begin) / duration, 0.0, 1.0)
    return length * s**4 * (35 - 84 * s + 70 * s**2 - 20 * s**3)


def simulated(softening, *, noise=0.01, seed=0):
    """Force (with its clock) and motion of a tank, by SciPy's DOP853."""
    fine = np.linspace(0.0, 9.0, 9001)
    acceleration = make_interp_spline(fine, move(fine), k=5).derivative(2)
    w = 2 * np.pi * FREQUENCY

    def slope(t, s):
        x, v = s
        a = float(acceleration(t))
        inertia = 1.0 + softening * x * x
        return [v, -(a + 2 * DAMPING * w * v + w * w * x + softening * x * v * v) / inertia]

    done = solve_ivp(slope, (0.0, 9.0), [0.0, 0.0], "DOP853", fine, rtol=1e-9, atol=1e-12, max_step=0.01)
    absolute = acceleration(fine) + np.array([slope(t, s)[1] for t, s in zip(fine, done.y.T, strict=True)])
    force = RIGID * acceleration(fine) + MASS * absolute
    rng = np.random.default_rng(seed)
    t1, t2 = np.arange(0.1, 8.9, 0.002), np.arange(0.0, 9.0, 0.004)
    t1 = t1 + 1e-4 * rng.normal(size=t1.size)
    measured = np.interp(t1 - LAG, fine, force) + noise * rng.normal(size=t1.size) - 0.03
    return (t1, measured), (t2, move(t2))


def value(fit, name):
    return fit.estimate[f"tank.{name}"]


@pytest.mark.parametrize(("softening", "kind"), [(0.0, "slosh"), (200.0, "softening inertia")])
def test_a_simulated_tank_is_found_within_intervals(softening, kind):
    found = fit_tank(tank_test(*simulated(softening), cutoff=15.0), kind)
    truth = {"slosh_mass": MASS, "frequency": FREQUENCY, "damping": DAMPING, "lag": LAG}
    for name, expected in truth.items():
        p = value(found, name)
        assert abs(p.value - expected) < max(4.0 * p.sigma, 0.003 * expected), name
        assert p.sigma < 0.05 * expected
    if softening:
        assert value(found, "softening").value == pytest.approx(softening, rel=0.1)


@pytest.mark.slow
def test_likelihood_names_what_is_there():
    for softening, better, worse in ((0.0, "slosh", "rigid"), (200.0, "softening inertia", "slosh")):
        test = tank_test(*simulated(softening), cutoff=15.0)
        good, bad = (fit_tank(test, kind) for kind in (better, worse))
        assert good.log_likelihood > bad.log_likelihood + 100.0
        assert good.ring_down < 0.5 * bad.ring_down


@pytest.mark.slow
def test_a_linear_tank_shows_no_significant_softening():
    p = value(fit_tank(tank_test(*simulated(0.0), cutoff=15.0), "softening inertia"), "softening")
    assert abs(p.value) < 4.0 * p.sigma + 5.0


def test_theory_of_the_cylinder_in_its_limits():
    """Deep liquid: g 1.841 / R; the mass goes to 0.455 of the liquid to a depth of one radius."""
    frequency, mass = cylinder_slosh(0.5, 5.0)
    assert (2 * np.pi * frequency) ** 2 == pytest.approx(9.81 * 1.8411838 / 0.5, rel=1e-6)
    assert mass == pytest.approx(0.4546 * 1000 * np.pi * 0.5**3, rel=1e-3)


def test_too_short_a_ring_down_and_unlike_signals_are_refused():
    (t1, f), (t2, p) = simulated(0.0)
    with pytest.raises(NotIdentifiableError, match="ring-down"):
        fit_tank(tank_test((t1[t1 < 2.5], f[t1 < 2.5]), (t2, p)), "slosh")
    with pytest.raises(RecordingError, match="not alike"):
        tank_test((t1, np.random.default_rng(0).normal(size=t1.size)), (t2, p))


def test_water_carried_by_a_robot_agrees_with_theory():
    pytest.importorskip("rosbags", reason="needs the extra bags")
    if not have("antisloshing"):
        pytest.skip("SMSID_DATA has no copy of antisloshing")
    from pathlib import Path
    from sys import path

    path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
    from antisloshing import FILL, RADIUS, hand_positions

    test = tank_test(*hand_positions())
    fits = {kind: fit_tank(test, kind) for kind in ("rigid", "slosh", "softening inertia")}
    theory = cylinder_slosh(RADIUS, FILL)
    best = fits["softening inertia"]
    assert 3.02 * 0.995 < value(best, "frequency").value < 3.05 * 1.005
    assert value(best, "slosh_mass").value == pytest.approx(theory[1], rel=0.06)
    assert value(best, "softening").interval[0] > 0.0
    assert fits["rigid"].ring_down > 3.0 * fits["slosh"].ring_down > 4.0 * best.ring_down
    assert 0.01 < value(best, "lag").value < 0.032 and 0.01 < test.lag.value < 0.032


def test_a_model_driven_to_a_bound_says_so():
    """A softening that a linear model lacks drives its lag to where cross-correlation stops it."""
    linear = fit_tank(tank_test(*simulated(200.0), cutoff=15.0), "slosh")
    assert any("tank.lag ended at a bound" in note for note in linear.estimate.notes)
    free = fit_tank(tank_test(*simulated(0.0), cutoff=15.0), "slosh")
    assert not any("bound" in note for note in free.estimate.notes)
