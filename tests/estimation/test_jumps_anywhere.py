"""Commands that jump between their samples: what a filter makes of them, against a world in plain numpy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from smsid.estimation._normal_equations import problem_at
from smsid.estimation._smoothed_motion import smoothed_runs
from smsid.estimation._smoother import smoothed_states
from smsid.estimation.flight import FlightOptions, flight_of
from smsid.estimation.identify_flights import identify_flights
from smsid.estimation.input_timing import timings
from smsid.estimation.kalman import KalmanFilter, run_filter
from smsid.estimation.parameter_vector import Point
from smsid.estimation.problem import CommandTiming
from smsid.estimation.unknowns import unknowns_of
from smsid.kernel.jit import SWITCH, numba
from smsid.recording import Recording
from tests.estimation.satellite import Satellite, guess, recorded, true_values

RIGID = Satellite(tank=(1e-9, 1e-9, 1e-9), panel=(1.0, 0.1, 1e-6, -1e-6))
EXACT, ANYWHERE = CommandTiming("held", "right"), CommandTiming("held", "right", anywhere=True)
STEP, EVERY = 0.01, 10  # [s] of the world, and of its samples that are read


def switching(rng: np.random.Generator, seconds: float, *, at_samples: bool):
    """Return a force and a torque that switch every other second or so, and the wheels' torque: at samples,
    or 1, 3, 5, 7 or 9 steps of the world after one.
    """
    times = np.cumsum(rng.uniform(1.0, 3.0, int(seconds)))
    if at_samples:
        times = np.round(times / (STEP * EVERY)) * STEP * EVERY - 1e-9
    else:
        times = (np.round(times / (2 * STEP)) * 2 + 1) * STEP - 1e-9
    size = rng.choice([-1.0, 1.0], (len(times) + 1, 2)) * rng.uniform(0.5, 1.0, (len(times) + 1, 2))

    def drive(t: float):
        thrust, turn = size[np.searchsorted(times, t)]
        return np.array([20.0, -10.0, 5.0]) * thrust, np.array([0.5, 0.25, -0.4]) * turn, np.zeros(3)

    return drive


def flown(seed: int, seconds: float = 40.0, *, at_samples: bool = False) -> Recording:
    rng = np.random.default_rng(seed)
    flight = RIGID.fly(seconds, switching(rng, seconds, at_samples=at_samples), step=STEP)
    return recorded(RIGID, flight, rng, every=EVERY)


@pytest.fixture(scope="module")
def described(tmp_path_factory):
    return guess(tmp_path_factory.mktemp("jumps"), RIGID, off=0.0, tank=False, panel=False)


@pytest.fixture(scope="module")
def true_point(described):
    """The satellite as it is: its inertias in the description are those without products."""
    begun, true = Point.of(described), true_values(RIGID, tank=False, panel=False)
    unknowns = list(unknowns_of(begun).unknowns)
    step = [true[u.name] - begun.value(u) for u in unknowns]
    return begun.moved([replace(u, lower=-np.inf, upper=np.inf) for u in unknowns], np.array(step))


def at_truth(true_point, recording, timing):
    flight = flight_of(true_point, recording, "flight", FlightOptions())
    problem = problem_at(true_point, flight)
    return true_point.model(), replace(problem, timing=timing)


def test_innovations_are_as_large_as_expected(true_point):
    """Twelve draws of flights: at the true parameters the normalised innovations have unit variance."""
    runs = [run_filter(*at_truth(true_point, flown(seed), ANYWHERE)) for seed in range(12)]
    late = [run_filter(*at_truth(true_point, flown(seed), EXACT)) for seed in range(3)]
    squares = np.concatenate([r.normalised[5:][r.used[5:]] ** 2 for r in runs])
    assert squares.mean() == pytest.approx(1.0, abs=5.0 * np.sqrt(2.0 / len(squares)) + 0.02)
    assert min(np.mean(r.normalised[5:][r.used[5:]] ** 2) for r in late) > 10.0


@pytest.mark.parametrize("at_samples", [True, False])
def test_the_likelihood_tells(true_point, at_samples):
    for seed in range(4):
        recording = flown(seed, at_samples=at_samples)
        exact, anywhere = (
            run_filter(*at_truth(true_point, recording, t)).log_likelihood for t in (EXACT, ANYWHERE)
        )
        assert (exact > anywhere) == at_samples


@pytest.mark.parametrize("slower", [1, 4])
def test_momentum_is_as_uncertain_as_the_time_of_a_switch(true_point, slower):
    """One switch, nothing read afterwards: the rate after it errs by the change times a uniform time."""
    times, n = np.arange(0.0, 2.0, 0.1), slower * 2
    force = np.zeros((len(times[::n]), 3))
    force[2:, 0] = 30.0
    channels = {
        "gyro.angular_rate": (times, np.zeros((len(times), 3))),
        "command.force": (times[::n], force),
    }
    recording = Recording.from_arrays(None, channels, name="one")
    model, problem = at_truth(true_point, recording, ANYWHERE)
    kalman, sudden = (KalmanFilter(model, replace(problem, timing=t)) for t in (ANYWHERE, EXACT))
    edges = np.asarray(problem.data.times, dtype=float)
    known = [smoothed_states(model, x.problem).covariance[-1, model.nv, model.nv] for x in (kalman, sudden)]
    spread, span = known[0] - known[1], 0.1 * n
    mass = true_values(RIGID, tank=False, panel=False)["bus.m"]
    after = edges[-1] - times[2 * n]
    assert after > 0.0
    assert spread == pytest.approx((30.0 / mass * span) ** 2 / 12.0, rel=0.05)


def test_compiled_and_plain_are_the_same(true_point, monkeypatch):
    if numba is None:
        pytest.skip("numba is not installed")
    model, problem = at_truth(true_point, flown(1, 10.0), ANYWHERE)
    found = []
    for switch in ("1", "0"):
        monkeypatch.setenv(SWITCH, switch)
        found.append(run_filter(model, problem))
    np.testing.assert_allclose(found[0].innovations, found[1].innovations, atol=1e-7)
    assert found[0].log_likelihood == pytest.approx(found[1].log_likelihood, abs=1e-6)


def test_both_smoothers_find_the_same_motion(true_point):
    model, problem = at_truth(true_point, flown(2, 10.0), ANYWHERE)
    other = smoothed_states(model, problem)
    for samples in (7, 2000):
        runs = list(smoothed_runs(KalmanFilter(model, problem), samples))
        found = np.concatenate([r.along.states.v for r in runs])
        predicted = np.concatenate([r.ran.states.v for r in runs])
        moved = np.abs(other.states.v - predicted).max(axis=0)
        np.testing.assert_allclose((found - other.states.v) / (moved + 1e-12), 0.0, atol=1e-6)


def test_asked_where_nothing_is_told(described):
    recording = flown(1, 5.0)
    assert ANYWHERE in timings(recording)
    assert timings(recording.with_provenance({"inputs": "held", "acceleration": "right"})) == (EXACT,)


@pytest.mark.parametrize("at_samples", [True, False])
def test_identified_with_the_right_intervals(tmp_path, at_samples):
    described = guess(tmp_path, RIGID, off=0.1, tank=False, panel=False)
    found = identify_flights(described, [flown(5, 60.0, at_samples=at_samples)])
    truth, off = true_values(RIGID, tank=False, panel=False), []
    for p in found.estimate.parameters:
        if p.name in truth and p.status == "identifiable":
            off.append((p.value - truth[p.name]) / p.sigma)
    assert len(off) >= 8
    assert np.abs(off).max() < 3.5
    assert found.quality.judgement == "explained"
    told = any("jump between their samples" in n for n in found.estimate.notes)
    assert told != at_samples
