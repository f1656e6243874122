"""A recursion along the first axis against `scipy.signal.lfilter`."""

import numpy as np
import pytest
from scipy.signal import lfilter

from smsid._recursion import filter_recursively

SECOND = np.array([0.02, 0.04, 0.03]), np.array([1.0, -1.9, 0.95])


@pytest.mark.parametrize("b, a", [SECOND, (np.ones(1), np.array([1.0, -0.99])), (SECOND[0], np.ones(1))])
@pytest.mark.parametrize("shape", [(1000,), (1000, 3), (1000, 2, 2), (2, 3), (1,), (0, 2), (5, 0)])
def test_it_is_lfilter(b, a, shape):
    x = np.random.default_rng(0).standard_normal(shape)
    wanted = lfilter(b, a, x, axis=0) if x.size else x
    np.testing.assert_allclose(filter_recursively(b, a, x), wanted, rtol=1e-12, atol=1e-12)


def test_it_begins_with_a_state():
    x, state = (
        np.random.default_rng(0).standard_normal((1000, 3)),
        np.array([[1.0, 2.0, 3.0], [-1.0, 0.0, 4.0]]),
    )
    wanted, _ = lfilter(*SECOND, x, axis=0, zi=state)
    np.testing.assert_allclose(filter_recursively(*SECOND, x, state), wanted, rtol=1e-12, atol=1e-12)
