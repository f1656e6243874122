"""A tank in a flight too short for it: the maximum is found, and nothing is claimed that does not hold."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from smsid.estimation._normal_equations import objective_of
from smsid.estimation.identify_flights import identify_flights
from smsid.estimation.parameter_vector import Point
from tests.estimation.satellite import Satellite, guess, recorded, true_values

SMALL = Satellite(
    centre=(0.0, 0.0, 0.0),
    inertia=((80.0, 0.0, 0.0), (0.0, 95.0, 0.0), (0.0, 0.0, 70.0)),
    panel=(1.0, 0.1, 1e-6, -1e-6),
)
SIGNS = np.random.default_rng(0).choice([-1.0, 0.0, 1.0], (10, 6))


def burns(t):
    """Forces and torques that change every second."""
    signs = SIGNS[min(int(t + 1e-6), len(SIGNS) - 1)]
    return 4.0 * signs[:3], 0.2 * signs[3:], np.zeros(3)


@pytest.fixture(scope="module")
def description(tmp_path_factory):
    return guess(tmp_path_factory.mktemp("craft"), SMALL, off=0.0, panel=False)


@pytest.fixture(scope="module")
def found(description):
    """A third of the tank's period, from a start 20 % off."""
    made = recorded(SMALL, SMALL.fly(10.0, burns), np.random.default_rng([0, 3]))
    tank = description.get_effect("tank")
    start = description.with_effects(tank.with_values({"tank.mass": SMALL.tank[0] / 1.2}))
    return identify_flights(start, [made], bodies=False)


def test_nothing_near_is_more_likely_not_even_the_truth(description, found):
    """Slopes along the filter's states halt hundreds of units of the log-likelihood below."""
    truth = objective_of(Point.of(description), found.found.unknowns, found.flights)
    assert found.found.objective < truth
    assert found.quality.judgement == "explained"


def test_deviations_are_those_that_the_covariance_says(found):
    truth = true_values(SMALL, panel=False)
    own = [k for k, p in enumerate(found.estimate.parameters) if p.name.startswith("tank.")]
    off = np.array([found.estimate.parameters[k].value for k in own])
    off -= [truth[found.estimate.parameters[k].name] for k in own]
    square = off @ np.linalg.solve(found.covariance[np.ix_(own, own)], off)
    assert chi2.ppf(0.001, len(own)) < square < chi2.ppf(0.999, len(own))


def test_what_is_poorly_known_and_bent_is_not_called_identifiable(found):
    assert found.estimate["tank.mass"].relative_sigma > 0.1
    assert found.estimate["tank.mass"].status == "not_identifiable"
