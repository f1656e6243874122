"""Intervals at a bound: against a grid, and by how often they hold the truth."""

import numpy as np
import pytest
from scipy.optimize import nnls
from scipy.stats import norm

from smsid.estimation._profile_interval import profile_limit

DESIGN = np.array([[1.0, 0.6], [0.0, 0.8], [0.3, -0.2], [0.5, 0.5]])
ROOM = np.array([[0.0, np.inf], [0.0, np.inf]])


def cost(x, y):
    return 0.5 * float(np.sum((y - DESIGN @ x) ** 2))


def estimated(y):
    """Return the most likely parameters, none negative, and the upper limit of the first."""
    x, _ = nnls(DESIGN, y)
    room = np.array([[-v, np.inf] for v in x])
    return x, x[0] + profile_limit(DESIGN.T @ DESIGN, DESIGN.T @ (y - DESIGN @ x), room, 0)


@pytest.mark.parametrize("seed", range(5))
def test_the_limit_is_where_a_grid_has_it(seed):
    """Both parameters bound: the other one leaves its bound on the way."""
    y = np.random.default_rng(seed).standard_normal(4) - np.array([0.5, 0.0, 0.0, 0.5])
    x, limit = estimated(y)
    others = np.linspace(0.0, 6.0, 6001)
    profile = min(cost(np.array([limit, o]), y) for o in others)
    assert profile - cost(x, y) == pytest.approx(0.5 * norm.ppf(0.975) ** 2, abs=1e-4)


@pytest.mark.parametrize("truth", [(0.0, 0.0), (0.0, 2.0), (0.7, 0.0), (0.7, 1.0), (2.0, 0.5)])
def test_an_interval_at_a_bound_holds_the_truth_as_often_as_it_says(truth):
    """Draws whose estimate is at zero, or is not: together 95 % at least, as no symmetric interval does."""
    rng, draws, held = np.random.default_rng(7), 600, 0
    sigma = float(np.sqrt(np.linalg.inv(DESIGN.T @ DESIGN)[0, 0]))
    for _ in range(draws):
        x, limit = estimated(DESIGN @ truth + rng.standard_normal(4))
        low = 0.0 if x[0] == 0.0 else max(0.0, x[0] - 1.959964 * sigma)
        held += low <= truth[0] <= (limit if x[0] == 0.0 else x[0] + 1.959964 * sigma)
    assert held / draws > 0.95 - 2.0 * np.sqrt(0.05 * 0.95 / draws)
