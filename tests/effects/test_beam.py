"""The cantilever against tabulated values and quadrature."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from smsid.effects.mode import Cantilever, clamped_free_roots

# Blevins, Formulas for Natural Frequency and Mode Shape (1979), table 8-1, clamped-free
ROOTS = (1.87510407, 4.69409113, 7.85475744, 10.99554073, 14.13716839)
SIGMA = (0.734095514, 1.018467319, 0.999224497, 1.000033553, 0.999998550)
PARTICIPATION = (0.7830, 0.4339, 0.2544)  # of the mass, as sqrt of the effective mass fraction

BEAM = Cantilever.with_modes(6.0, 6)


def test_roots_are_the_tabulated_ones():
    np.testing.assert_allclose(clamped_free_roots(5), ROOTS, atol=5e-9)


def test_roots_solve_the_characteristic_equation():
    x = clamped_free_roots(8)
    rounding = 4 * np.finfo(float).eps * x * np.cosh(x)  # of x itself, times the slope
    assert np.all(np.abs(np.cos(x) * np.cosh(x) + 1.0) < rounding)
    np.testing.assert_allclose(x[5:], (2 * np.arange(6, 9) - 1) * np.pi / 2, atol=1e-6)


def test_coefficients_and_participation_are_the_tabulated_ones():
    beam = Cantilever.with_modes(1.0, 5)
    np.testing.assert_allclose(beam.mean_shape, 2 * np.array(SIGMA) / np.array(ROOTS), rtol=1e-8)
    np.testing.assert_allclose(beam.mean_shape[:3], PARTICIPATION, atol=5e-5)


def test_frequency_of_a_printed_panel():
    """Table 2 of the paper: 0.046, 0.286, 0.801 Hz for the 2 mm panel."""
    stiffness, density = 70e9 * 3.0 * 0.002**3 / 12.0, 2700.0 * 3.0 * 0.002
    hertz = BEAM.angular_frequencies(stiffness, density)[:3] / (2 * np.pi)
    np.testing.assert_allclose(hertz, [0.0457, 0.2864, 0.8018], atol=5e-5)


@pytest.mark.parametrize("i", range(6))
@pytest.mark.parametrize("j", range(6))
def test_shapes_are_orthonormal(i, j):
    length = BEAM.length
    value, _ = quad(lambda x: BEAM.shape(x)[i] * BEAM.shape(x)[j], 0.0, length, epsabs=1e-12, limit=200)
    assert value / length == pytest.approx(float(i == j), abs=1e-11)


@pytest.mark.parametrize("k", range(6))
def test_means_are_the_integrals_of_the_shape(k):
    length = BEAM.length
    mean, _ = quad(lambda x: BEAM.shape(x)[k], 0.0, length, epsabs=1e-13, limit=200)
    moment, _ = quad(lambda x: x * BEAM.shape(x)[k], 0.0, length, epsabs=1e-13, limit=200)
    assert BEAM.mean_shape[k] == pytest.approx(mean / length, abs=1e-12)
    assert BEAM.mean_moment[k] == pytest.approx(moment / length, abs=1e-12)


@pytest.mark.parametrize("k", range(6))
def test_shapes_bend_as_the_beam_equation_says(k):
    """Clamped at the root, free at the tip, and of fourth derivative (root / length)^4 times the shape."""
    h = 1e-4 * BEAM.length

    def difference(x: float, weights: list[float], order: int) -> float:
        points = x + h * (np.arange(len(weights)) - (len(weights) - 1) / 2)
        return float(np.array(weights) @ BEAM.shape(points)[:, k] / h**order)

    scale = (BEAM.roots[k] / BEAM.length) ** np.arange(5)
    assert BEAM.shape(0.0)[k] == pytest.approx(0.0, abs=1e-13)
    assert difference(0.0, [-0.5, 0.0, 0.5], 1) == pytest.approx(0.0, abs=1e-5 * scale[1])
    assert difference(BEAM.length, [1.0, -2.0, 1.0], 2) == pytest.approx(0.0, abs=1e-4 * scale[2])
    h = 2e-3 * BEAM.length
    middle = 0.37 * BEAM.length
    fourth = difference(middle, [1.0, -4.0, 6.0, -4.0, 1.0], 4)
    assert fourth == pytest.approx(scale[4] * BEAM.shape(middle)[k], abs=2e-3 * scale[4])


def test_effective_masses_of_many_modes_add_up_to_the_mass():
    found = Cantilever.with_modes(2.0, 200).mean_shape ** 2
    assert 1.0 - found.sum() == pytest.approx(4 / np.pi**2 / 200, rel=1e-2)  # tail of 4 / root^2
    assert found.sum() < 1.0


def test_high_modes_do_not_cancel():
    beam = Cantilever.with_modes(1.0, 20)
    np.testing.assert_allclose(np.abs(beam.shape(1.0)), 2.0, rtol=1e-9)  # a free end moves by twice the mean
