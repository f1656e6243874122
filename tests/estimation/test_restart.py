"""A maximum far from the description is asked whether a likelier one lies nearer."""

import numpy as np

from smsid.estimation._maximum import maximise
from smsid.estimation._restart import guess_sigma, likeliest_of_restarts
from smsid.estimation.flight import flight_of
from smsid.estimation.identify_flights import identify_flights
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.estimation.unknowns import unknowns_of
from tests.estimation.satellite import Satellite, burns_and_wheels, guess, recorded


def _wheels(t):
    return np.zeros(3), np.zeros(3), 0.1 * np.sin(2 * np.pi * np.array([0.05, 0.083, 0.031]) * t)


def _searched(folder, begin):
    """Return the maximum a search comes to that begins with the panel's frequency there, and the flight."""
    truth = Satellite()
    recording = recorded(truth, truth.fly(40.0, burns_and_wheels), np.random.default_rng(1))
    point = Point.of(guess(folder, truth, off=0.02))
    unknowns = unknowns_of(point).unknowns
    flights = [flight_of(point, recording, "flight")]
    step = np.array([begin - u.nominal if u.name == "panel.mode1.frequency" else 0.0 for u in unknowns])
    return maximise(point.moved(unknowns, step), unknowns, flights)[0], flights


def test_a_search_that_was_caught_far_away_comes_back(tmp_path):
    near, flights = _searched(tmp_path, 0.22)
    caught, _ = _searched(tmp_path, 0.9)
    frequency = next(u for u in caught.unknowns if u.name == "panel.mode1.frequency")
    assert caught.point.value(frequency) > 0.3 and caught.objective > near.objective + 10.0
    found, on_the_way = likeliest_of_restarts(caught, flights)
    assert found.objective < near.objective + 0.5 and on_the_way
    assert abs(found.point.value(frequency) - 0.22) < 0.01
    again, nothing = likeliest_of_restarts(found, flights)
    assert again is found and not nothing


def test_wheels_alone_do_not_end_where_the_panel_moves_nobody(tmp_path):
    """The search that is begun as described ends at a translation of 0.004 +- 0.014, *identifiable*."""
    truth = Satellite()
    recording = recorded(truth, truth.fly(50.0, _wheels), np.random.default_rng([1, 91]))
    found = identify_flights(guess(tmp_path, truth, off=0.3), [recording]).estimate
    low, high = found["panel.mode1.translation.z"].interval
    assert low < 2.6 < high


def test_a_first_guess_is_believed_to_a_third_and_only_an_effects():
    def sigma(kind, nominal, prior):
        return guess_sigma(Unknown(name="x", kind=kind, unit="", nominal=nominal, sigma=prior, scale=1.0))

    assert sigma("effect", -10.0, 100.0) == 3.0
    assert sigma("effect", -10.0, 1.0) == 1.0
    assert sigma("effect", 0.0, 7.0) == 7.0
    assert sigma("body", 10.0, 100.0) == 100.0
