"""Intervals along a bent ridge: against a grid, and of a tank that a short flight hardly tells."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from smsid._statistics import NORMAL95
from smsid.estimation.identify_flights import _with_profile_interval
from smsid.estimation.likelihood_profile import POORLY_KNOWN, BentInterval, Profile, _Follower, loosely_told
from smsid.identify.estimate import classify

FALL = 0.5 * NORMAL95**2
VALUES = np.linspace(-0.9, 0.9, 13)


def cost(x, y):
    """A ridge along y, x = y + 2 y^2, which falls faster to one side."""
    return 0.5 * ((x - y - 2.0 * y**2) / 0.1) ** 2 + 0.5 * (y * (1.0 + 0.3 * y) / 0.3) ** 2


def profile(values=VALUES, open_=(False, False)):
    ridge = values + 2.0 * values**2
    return Profile("y", 1, np.column_stack([ridge, values]), cost(ridge, values), open_)


@pytest.mark.parametrize("row", [(1.0, 0.0), (0.0, 1.0), (1.0, -1.0)])
def test_it_is_that_of_a_grid(row):
    x, y = np.meshgrid(np.linspace(-1.5, 3.5, 2501), np.linspace(-1.2, 1.2, 1201))
    inside = (row[0] * x + row[1] * y)[cost(x, y) <= FALL]
    low, high = profile().interval(np.array(row), (row[0] * 0.1) ** 2, FALL)
    assert (low, high) == pytest.approx((inside.min(), inside.max()), abs=0.02)


def test_where_the_likelihood_does_not_fall_there_is_no_end():
    row = np.array([-1.0, -1.0])  # falls where y grows
    low, high = profile(VALUES[VALUES > -0.2], (False, True)).interval(row, 0.0, FALL)
    assert low == -np.inf and np.isfinite(high)


def test_a_profile_that_could_not_be_followed_is_not_said_to_have_no_end():
    """Where slopes mislead the search of the others, nothing is known but that the likelihood is bent."""
    lone = Profile("y", 1, np.zeros((1, 2)), np.zeros(1), (True, True))
    assert not lone.followed and profile().followed
    told = classify("x", 160.0, "kg", 0.003, "maximum_likelihood")
    bent = BentInterval("y", lone.interval(np.array([1.0, 0.0]), 0.0, FALL), lone.followed)
    found = _with_profile_interval(told, bent)
    assert found.status == "not_identifiable" and found.sigma == 0.003
    assert found.interval == (-np.inf, np.inf)
    assert "along y, and could not be followed" in found.note
    assert "no end" not in found.note and "cannot be told" not in found.note
    followed = _with_profile_interval(told, BentInterval("y", (-np.inf, 1.0)))
    assert "interval from its profile along y, which has no end" in followed.note


def test_asked_about_are_parameters_through_which_poorly_known_quantities_vary():
    covariance = np.diag([1.0, 4.0, 9.0])
    gradient = np.array([[1.0, 0.1, 0.0], [0.0, 1.0, 0.1], [0.0, 1.0, 0.2], [3.0, 1.5, 1.0]])
    assert loosely_told(covariance, gradient, np.array([0.5, 0.2, 0.3, 0.4]) * POORLY_KNOWN) == []
    assert loosely_told(covariance, gradient, np.array([2.0, 5.0, 4.0, 9.0]) * POORLY_KNOWN) == [1, 0]


def test_at_a_bound_that_the_maximum_is_at_it_has_no_point_of_its_own(monkeypatch):
    """The others moved, the parameter could not."""
    below = [(np.array([0.4, 0.0]), 0.3)], False
    above = [(np.array([1.0, 1.0]), 1.0), (np.array([2.2, 2.0]), 2.2)], True
    monkeypatch.setattr(_Follower, "side", lambda self, i, side: below if side < 0.0 else above)
    found = SimpleNamespace(unknowns=(SimpleNamespace(name="x"), SimpleNamespace(name="y")))
    along = _Follower(found, None, np.eye(2), FALL, 1.0).profile(1)  # pyright: ignore
    low, high = along.interval(np.array([0.0, 1.0]), 0.0, FALL)
    assert low == -np.inf and 1.0 < high < 2.0
