"""What noise once more does to the intervals of Step B as printed."""

from __future__ import annotations

import numpy as np

from smsid.identify.exp2_errors import _of_replicates
from smsid.identify.momentum import NOTHING, Regression
from smsid.identify.tls import TlsSolution


def test_moves_of_replicates_hold_scatter_and_bias():
    """A result off by its bias and scattering by more than it says: the interval holds 95 % over draws."""
    rng = np.random.default_rng(0)
    bias, spread, said = np.array([0.0, 3.0, 0.5]), np.array([1.0, 1.0, 4.0]), 0.5 * np.eye(3)
    base = Regression(NOTHING, TlsSolution(np.zeros(3), said, 1.0, np.ones(3), 1.0, 9, ""), ())
    inside = []
    for _ in range(2000):
        moves = [bias + spread * rng.standard_normal(3) for _ in range(8)]
        sigma = _of_replicates(base, moves).sigma
        inside.append(np.abs(bias + spread * rng.standard_normal(3)) < 1.96 * sigma)
    share = np.mean(inside, axis=0)
    assert (share > 0.90).all() and share[0] < 0.98, share
    quiet = _of_replicates(base, [np.zeros(3)] * 8)
    np.testing.assert_allclose(quiet.sigma, np.sqrt(0.5))
