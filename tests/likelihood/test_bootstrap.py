"""The covariance from the Fisher information against the spread of fits to noise drawn anew."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from smsid.likelihood import refine
from smsid.likelihood.bootstrap import bootstrap

from . import twin

KNOWN = ("total.mass", "tank.mass", "tank.stiffness.x", "tank.damping.x", "panel.linear_density")


@pytest.mark.parametrize("draws", [8, pytest.param(100, marks=pytest.mark.slow)])
def test_spread_is_that_of_the_covariance(draws: int):
    found = refine(twin.description(), [twin.noisy(twin.exp1((1, 1, 1), 30.0), 0)])
    spread = bootstrap(found, draws, np.random.default_rng(0)).sigma
    # chance, family-wise 0.1 %
    low, high = np.sqrt(chi2.ppf([1e-4, 1 - 1e-4], draws - 1) / (draws - 1))
    for name in KNOWN:
        ratio = spread[name] / found.estimate[name].sigma
        assert low < ratio < high, f"{name}: {ratio:.2f}"
