"""What noise once more says of intervals, with few replicates of it."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.identify.paper.noise_replicates import covariance_of_moves, small_sample_factor

REPLICATES = 8


def test_few_replicates_ask_for_a_wider_interval():
    """Student's t: 2.306 instead of 1.960 with 8, and 95 % over draws come out."""
    assert small_sample_factor(REPLICATES) == pytest.approx(2.306 / 1.960, rel=1e-3)
    assert small_sample_factor(10_000) == pytest.approx(1.0, abs=1e-3)
    rng = np.random.default_rng(1)
    sigma = small_sample_factor(REPLICATES) * np.sqrt(
        np.mean(rng.standard_normal((20_000, REPLICATES)) ** 2, 1)
    )
    assert np.mean(np.abs(rng.standard_normal(20_000)) < 1.959964 * sigma) == pytest.approx(0.95, abs=0.006)


def test_moves_of_replicates_hold_scatter_and_bias():
    """A result off by its bias and scattering by more than it says: the interval holds 95 % over draws."""
    rng = np.random.default_rng(0)
    bias, spread, said = np.array([0.0, 3.0, 0.5]), np.array([1.0, 1.0, 4.0]), 0.5 * np.eye(3)
    inside = []
    for _ in range(2000):
        moves = [bias + spread * rng.standard_normal(3) for _ in range(REPLICATES)]
        sigma = np.sqrt(np.diag(covariance_of_moves(said, moves)))
        inside.append(np.abs(bias + spread * rng.standard_normal(3)) < 1.96 * sigma)
    share = np.mean(inside, axis=0)
    assert (share > 0.93).all() and share[0] < 0.985, share
    quiet = covariance_of_moves(said, [np.zeros(3)] * REPLICATES)
    np.testing.assert_allclose(quiet, said)
