"""A torque that nobody recorded is a random walk in continuous time, however often it is looked at."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from smsid.effects import SensorScale
from smsid.estimation import flight_search, kalman
from smsid.estimation._differences import difference_equations
from smsid.estimation._normal_equations import normal_equations, objective_of
from smsid.estimation._smoother import predicted_covariances
from smsid.estimation.flight import flight_of
from smsid.estimation.identify_flights import identify_flights
from smsid.estimation.kalman import KalmanFilter
from smsid.estimation.parameter_vector import Point
from smsid.estimation.problem import CommandTiming, UnknownInput
from smsid.estimation.unknowns import unknowns_of
from smsid.recording import Recording
from tests.estimation.satellite import NOISE, Satellite, guess, recorded, true_values

WALK, SECONDS = 0.02, 2.4


def grown(folder, step, timing=None, slope=0.0):
    """Return the covariance after a flight at rest of which nothing is read, all known at its start."""
    times = np.arange(round(SECONDS / step) + 1) * step
    rates = np.zeros((len(times), 3))
    channels = {"gyro.angular_rate": rates, "tacho.wheel_rate": rates}
    point = Point.of(guess(folder, Satellite(), tank=False, panel=False))
    recording = Recording.from_arrays(times, channels, labels={"wheel": ("rw1", "rw2", "rw3")}, name="rest")
    problem = flight_of(point, recording, "rest").problem
    unread = replace(problem.data, values=np.full_like(problem.data.values, np.nan))
    wheel = problem.begin.v.size - 3
    known = replace(problem.begin, covariance=np.zeros_like(problem.begin.covariance))
    inputs = (UnknownInput(wheel, 0.0, WALK, motor=True, slope=slope),)
    problem = replace(problem, data=unread, begin=known, unknown_inputs=inputs, locked=np.zeros(0, dtype=int))
    problem = replace(problem, timing=timing or CommandTiming("linear"))
    model = point.model()
    filtering = KalmanFilter(model, problem)
    first = filtering.covariance
    run = filtering.advance(len(times))
    whole = predicted_covariances(
        run, first, problem.data.sigma**2, filtering.input_noise, filtering.forces.walk
    )
    inverse = pin.computeMinverse(model.pin, model.pin.createData(), model.home)[wheel, wheel]
    return filtering.covariance, whole[-1], model.nv + wheel, inverse


@pytest.mark.parametrize("step", [0.05, 0.1])
@pytest.mark.parametrize("plain", [True, False])
def test_what_a_walk_does_is_its_integral_at_any_rate_of_samples(tmp_path, step, plain, monkeypatch):
    if plain:
        monkeypatch.setattr(kalman, "compiled_model", lambda base: None)
    filtered, smoothed, rate, inverse = grown(tmp_path, step)
    np.testing.assert_allclose(filtered, smoothed, rtol=1e-9, atol=1e-18)
    expected = (
        WALK**2
        * SECONDS
        * np.array(
            [[(inverse * SECONDS) ** 2 / 3.0, inverse * SECONDS / 2.0], [inverse * SECONDS / 2.0, 1.0]]
        )
    )
    own = [rate, len(filtered) - 1]
    np.testing.assert_allclose(filtered[np.ix_(own, own)], expected, rtol=1e-6)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("plain", [True, False])
def test_a_motor_that_is_held_jumps_at_the_samples(tmp_path, side, plain, monkeypatch):
    """By the sum over the jumps, each of which drives the wheel until the end."""
    if plain:
        monkeypatch.setattr(kalman, "compiled_model", lambda base: None)
    step = 0.1
    filtered, smoothed, rate, inverse = grown(tmp_path, step, CommandTiming("held", side))
    np.testing.assert_allclose(filtered, smoothed, rtol=1e-9, atol=1e-18)
    jumps = step * (np.arange(round(SECONDS / step)) + (side == "right"))
    drives = inverse * (SECONDS - jumps)
    across = drives.sum()
    expected = WALK**2 * step * np.array([[drives @ drives, across], [across, len(jumps)]])
    own = [rate, len(filtered) - 1]
    np.testing.assert_allclose(filtered[np.ix_(own, own)], expected, rtol=1e-6)


@pytest.mark.parametrize("plain", [True, False])
def test_a_rate_that_wanders_jumps_at_the_samples_and_the_torque_goes_straight(tmp_path, plain, monkeypatch):
    """By the sum over the jumps, from each of which the torque climbs until the end."""
    if plain:
        monkeypatch.setattr(kalman, "compiled_model", lambda base: None)
    step = 0.1
    filtered, smoothed, rate, inverse = grown(tmp_path, step, slope=1e-12)
    np.testing.assert_allclose(filtered, smoothed, rtol=1e-9, atol=1e-18)
    left = SECONDS - step * np.arange(round(SECONDS / step))
    one = np.array([inverse * left**2 / 2.0, left, np.ones_like(left)])
    own = [rate, len(filtered) - 2, len(filtered) - 1]
    np.testing.assert_allclose(filtered[np.ix_(own, own)], WALK**2 * step * one @ one.T, rtol=1e-6)


def turning(t):
    return np.zeros(3), np.zeros(3), 0.1 * np.sin(np.array([0.9, 1.3, 1.7]) * t)


class Silent:
    """A generator of noise that there is none of."""

    def normal(self, mean, sigma, size):
        return np.full(size, mean)


def test_a_filter_that_follows_wheels_does_not_lag_behind_them(tmp_path):
    """Readings without an error, taken for noisy: what a torque that is too smooth misses stays in inertias.

    With the likeliest walk of their rate (`LIVELY` one) by 1.1 to 1.4 standard deviations of that noise.
    """
    truth = Satellite(tank=(1e-9, 1e-9, 1e-9), panel=(1.0, 0.1, 1e-6, -1e-6))
    without = ("st.attitude", "gyro.acceleration", "command.force", "command.torque", "command.wheel_torque")
    recording = recorded(truth, truth.fly(30.0, turning), Silent(), without=without)
    description = guess(tmp_path, truth, tank=False, panel=False)
    flight = flight_of(Point.of(description), recording, "turning")
    assert all(u.slope > 0.0 for u in flight.problem.unknown_inputs)
    told = [p for p in identify_flights(description, [recording]).estimate.parameters if not p.note]
    true = true_values(truth, tank=False, panel=False)
    off = [(p.value - true[p.name]) / p.sigma for p in told if p.name in true]
    assert len(off) == 6
    np.testing.assert_allclose(off, 0.0, atol=0.3)


def test_how_far_a_torque_may_wander_is_no_evidence_for_a_scale(tmp_path, monkeypatch):
    """Wheels that follow their measured rates: a flight's likelihood is of what else is read beside these.

    With theirs it grew by ln(1 + scale) a sample where the scale falls, as the walk is wider than the torque:
    half a standard deviation and more off in the mean of draws.
    """
    monkeypatch.setitem(NOISE, "wheel_rate", 1e-3)  # a better measure of momentum than the gyro
    truth = Satellite(tank=(1e-9, 1e-9, 1e-9), panel=(1.0, 0.1, 1e-6, -1e-6))
    scale = SensorScale(
        name="scale", sensor="tacho", quantity="wheel_rate", component="rw1", error=0.0, prior={"error": 0.1}
    )
    point = Point.of(guess(tmp_path, truth, off=0.0, tank=False, panel=False).with_effects(scale))
    rng = np.random.default_rng(1)
    recording = recorded(truth, truth.fly(60.0, turning), rng, without=("gyro.acceleration",))
    flight = flight_of(point, recording, "turning")
    unknowns = [u for u in unknowns_of(point).unknowns if u.name == "scale.error"]
    found = normal_equations(point, unknowns, [flight])
    exact = difference_equations(found, [flight])
    apart = (exact.slope - found.slope) / np.sqrt(found.gram[0, 0])
    assert abs(float(apart[0])) < 0.02
    wide = [
        replace(u, sigma=3.0 * u.sigma, walk=3.0 * u.walk, slope=3.0 * u.slope)
        for u in flight.problem.unknown_inputs
    ]
    wider = replace(flight, problem=replace(flight.problem, unknown_inputs=tuple(wide)))
    gained = objective_of(point, unknowns, [wider]) - found.objective
    assert abs(gained) < 0.5  # of 3 ln(3) a sample


def test_noise_of_wheels_beside_a_recorded_command_is_not_taken_for_motion(tmp_path):
    """A panel's mode and what goes with it were 4 sigma off, in the mean over torques of too lively a walk.

    In every draw to the same side: the mean of draws is asked.
    """
    truth = Satellite(tank=(1e-9, 1e-9, 1e-9))

    def pushed_and_turned(t):
        push = (2.0 if t < 6.0 else -2.0) if t < 12.0 else 0.0
        return np.array([0.0, 0.0, push]), np.zeros(3), 0.08 * np.sin(np.array([0.31, 0.52, 0.19]) * t)

    flown, true = truth.fly(30.0, pushed_and_turned), true_values(truth, tank=False)
    names = ["panel.mode1.frequency", "panel.mode1.translation.z", "panel.mode1.rotation.y", "bus.mx"]
    off = []
    for seed in range(2):
        recording = recorded(truth, flown, np.random.default_rng([seed, 17]))
        found = identify_flights(guess(tmp_path, truth, tank=False), [recording])
        assert found.quality.judgement == "explained"
        assert all(f.problem.profiled for f in found.flights)
        own = [found.estimate[n] for n in names]
        off.append([(p.value - true[p.name]) / p.sigma for p in own])
    assert np.abs(np.mean(off, axis=0)).max() < 3.0 / np.sqrt(len(off)), off


def test_where_torques_do_not_tell_a_note_says_what_values_are(tmp_path, monkeypatch):
    truth = Satellite(tank=(1e-9, 1e-9, 1e-9), panel=(1.0, 0.1, 1e-6, -1e-6))
    without = ("st.attitude", "gyro.acceleration", "command.force", "command.torque", "command.wheel_torque")
    recording = recorded(truth, truth.fly(30.0, turning), np.random.default_rng(1), without=without)
    description, said = guess(tmp_path, truth, tank=False, panel=False), []
    for told in (True, False):
        monkeypatch.setattr(flight_search, "are_told_by_torques", lambda *_, told=told: told)
        found = identify_flights(description, [recording])
        assert all(f.problem.averaged is not told for f in found.flights)
        said.append([n for n in found.estimate.notes if "in the mean over torques" in n])
    assert [len(n) for n in said] == [0, 1]
