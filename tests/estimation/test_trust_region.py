"""Steps of a fit on functions whose lowest points are known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from smsid.estimation import _trust_region as trust_region
from smsid.estimation._trust_region import descend
from smsid.estimation.parameter_vector import Unknown

BEND = 100.0  # of Rosenbrock's valley


@dataclass(frozen=True)
class Place:
    """A point of two parameters without bounds, at which every body can exist."""

    x: np.ndarray

    def value(self, unknown):
        return float(self.x[unknown.column])

    def bounds(self, unknown):
        return -np.inf, np.inf

    def physical(self):
        return True


class Valley:
    """Normal equations of Rosenbrock's function, half the squares of 10 (y - x^2) and 1 - x."""

    unknowns = tuple(Unknown(n, "effect", "1", 0.0, np.inf, 1.0, column=i) for i, n in enumerate("xy"))
    scales = np.ones(2)

    def __init__(self, x):
        self.point: Any = Place(np.asarray(x, dtype=float))
        a, b = self.point.x
        left = np.array([np.sqrt(BEND) * (b - a * a), 1.0 - a])
        slopes = np.array([[-2.0 * np.sqrt(BEND) * a, np.sqrt(BEND)], [-1.0, 0.0]])
        self.gram, self.slope = slopes.T @ slopes, -slopes.T @ left
        self.objective = 0.5 * float(left @ left)


@pytest.fixture
def looked(monkeypatch):
    """Return where was looked."""
    seen = []

    def look(point):
        there = Valley(point.x)
        seen.append(tuple(point.x))
        return there.objective, lambda: there

    monkeypatch.setattr(trust_region, "retract", lambda point, unknowns, step: Place(point.x + step))
    return seen, look


def test_a_step_along_a_bent_valley_goes_on_to_its_floor(looked):
    """The first step of Gauss and Newton from (-1, 1) is to (1, -3), far up its side."""
    seen, look = looked
    found, radius = descend(Valley((-1.0, 1.0)), np.inf, 8, look)
    assert found is not None and radius > 2.0
    np.testing.assert_allclose(seen, [(1.0, -3.0), (1.0, 1.0)], atol=1e-8)
    assert found.objective == pytest.approx(0.0, abs=1e-15)


def test_no_step_leads_up(looked):
    """Whatever the start, each step is lower than the last, to the lowest point within few."""
    _, look = looked
    rng = np.random.default_rng(5)
    for start in rng.uniform(-3.0, 3.0, (20, 2)):
        found, radius, before = Valley(start), np.inf, np.inf
        for _ in range(60):
            if found.objective < 1e-12:
                break
            assert found.objective < before
            before = found.objective
            better, radius = descend(found, radius, 8, look)
            assert better is not None
            found = better
        np.testing.assert_allclose(found.point.x, 1.0, atol=1e-4)


def test_where_nothing_is_to_be_gained_no_step_is_taken(looked):
    _, look = looked
    assert descend(Valley((1.0, 1.0)), np.inf, 3, look)[0] is None
