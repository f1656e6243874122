"""Flights that begin with a tank a metre off its place: explained, whatever was taken for known of it."""

import numpy as np
import pytest

from smsid.estimation import flight_search, moving_start
from smsid.estimation.flight import FlightOptions, flight_of
from smsid.estimation.identify_flights import identify_flights
from smsid.estimation.initial_state import InitialPrior
from smsid.estimation.parameter_vector import Point
from tests.estimation.satellite import Satellite, guess, recorded, true_values

TRUTH = Satellite(panel=(1.0, 0.1, 1e-6, -1e-6))
SLOSH = np.array([2.6, -2.2, 2.4])  # [m] as it begins


def driven(t):
    t = 0.1 * np.floor(10.0 * t + 1e-6)
    torque = 0.05 * np.sin(2 * np.pi * np.array([0.04, 0.06, 0.09]) * t + [0, 1, 2])
    return np.zeros(3), torque, 0.1 * np.sin(2 * np.pi * np.array([0.05, 0.083, 0.031]) * t)


@pytest.fixture(scope="module")
def sloshing():
    start = np.zeros(24)
    start[6], start[13:16] = 1.0, SLOSH
    return recorded(TRUTH, TRUTH.fly(30.0, driven, start=start), np.random.default_rng(4))


def offsets(folder, recording):
    found = identify_flights(guess(folder, TRUTH, off=0.05, panel=False), [recording], cad=0.05)
    true = true_values(TRUTH, panel=False)
    told = [p for p in found.estimate.parameters if p.status == "identifiable" and p.name in true]
    return found, {p.name: (p.value - true[p.name]) / p.sigma for p in told}


def test_a_tank_that_moves_as_a_flight_begins_is_inside_its_intervals(tmp_path, sloshing, monkeypatch):
    """Kept near rest, it would be heavier or stiffer instead."""
    found, off = offsets(tmp_path, sloshing)
    assert found.quality.judgement == "explained"
    assert any("move as it begins" in n for n in found.estimate.notes)
    assert {"tank.mass", "tank.stiffness.x", "tank.damping.x"} <= set(off)
    assert max(map(abs, off.values())) < 3.0
    monkeypatch.setattr(flight_search, "with_moving_start", lambda point, flight, share: flight)
    _, kept = offsets(tmp_path, sloshing)
    assert max(map(abs, kept.values())) > 3.0


@pytest.mark.parametrize(("rests", "begun"), [(False, True), (True, False)])
def test_it_is_begun_where_it_is_unless_somebody_says_that_it_rests(tmp_path, sloshing, rests, begun):
    point = Point.of(guess(tmp_path, TRUTH, off=0.0, panel=False))
    options = FlightOptions(initial=InitialPrior(at_rest=rests))
    flight = flight_of(point, sloshing, "flight", options)
    moved = moving_start.with_moving_start(point, flight, 0.3)  # bodies are guesses
    assert (moved is not flight) is begun
    if begun:
        hidden = moving_start.hidden_coordinates(flight.model)
        np.testing.assert_allclose(moved.problem.begin.q[hidden + 1], SLOSH, atol=0.8)
        np.testing.assert_array_equal(moved.problem.begin.covariance, flight.problem.begin.covariance)


def test_a_flight_that_begins_at_rest_is_left_alone(tmp_path):
    point = Point.of(guess(tmp_path, TRUTH, off=0.0, panel=False))
    recording = recorded(TRUTH, TRUTH.fly(20.0, driven), np.random.default_rng(4))
    flight = flight_of(point, recording, "flight", FlightOptions())
    assert moving_start.with_moving_start(point, flight, 0.0) is flight
