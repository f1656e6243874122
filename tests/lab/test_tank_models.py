"""The model of a tank that a test asks for."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.lab import compare_tank_models, tank_test

from .test_tank import move, simulated


def test_a_solid_load_needs_no_slosh():
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 9.0, 0.002)
    acceleration = np.gradient(np.gradient(move(t), t), t)
    force = 1.7 * acceleration + 0.01 * rng.normal(size=t.size)
    test = tank_test((t, force), (t, move(t)), cutoff=15.0)
    found = compare_tank_models(test, ("rigid", "slosh"))
    assert found.named == "rigid" and not found.sloshes and not found.amplitude


@pytest.mark.parametrize(
    ("softening", "named", "models"),
    [
        (0.0, "slosh", ("rigid", "slosh")),
        pytest.param(0.0, "slosh", ("rigid", "slosh", "softening inertia"), marks=pytest.mark.slow),
        pytest.param(200.0, "softening inertia", ("slosh", "softening inertia"), marks=pytest.mark.slow),
    ],
)
def test_slosh_is_named_from_a_rigid_start(softening, named, models):
    test = tank_test(*simulated(softening), cutoff=15.0)
    found = compare_tank_models(test, models)
    assert found.named == named and found.sloshes and found.amplitude == (softening > 0.0)
    assert max(found.gains.values()) > 100.0
