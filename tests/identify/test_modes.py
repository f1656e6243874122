"""Poles, mode shapes and the modal assurance criterion."""

import numpy as np
import pytest
from pyoma2.functions.gen import MAC

from smsid.identify.modes import Poles, mac, real_shape


def test_poles_in_hertz():
    poles = Poles(
        2, np.array([2 * np.pi * 0.5 * (-0.02 + 1j * np.sqrt(1 - 0.02**2))]), np.ones((1, 1)), np.ones(1)
    )
    assert poles.frequency == pytest.approx([0.5])
    assert poles.damping == pytest.approx([0.02])


def test_mac_equals_pyoma():
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 3, 4)) + 1j * rng.normal(size=(2, 3, 4))
    np.testing.assert_allclose(mac(a, b), np.abs(MAC(a.T, b.T)), rtol=1e-12)
    np.testing.assert_allclose(np.diag(mac(a, a * 3j)), 1.0)


def test_real_shape_undoes_the_complex_factor():
    shape = np.array([0.2, -0.5, 1.0])
    factors = np.array([1.0, 1j, -2 + 0.3j])
    np.testing.assert_allclose(real_shape(factors[:, None] * shape), shape, atol=1e-12)
