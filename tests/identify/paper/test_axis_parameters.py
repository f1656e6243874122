"""Partial fractions of Exp. 1's transfer function: one to one, sensitivities exact, poor cases told."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import residue

from smsid.identify.paper._axis_parameters import (
    fractions,
    kinds_of,
    parameter_names,
    physical,
    regression_parameters,
    sensitivity,
    tied_parameters,
    without_tanks,
)

GRID = pytest.mark.parametrize(
    ("tanks", "panel"), [(n, p) for n in range(4) for p in (False, True)], ids=lambda x: str(x)
)


def random_theta(tanks: int, panel: bool, seed: int = 0) -> np.ndarray:
    """Tanks of well separated rising frequencies; c_i not m_i beta_i, as noise leaves it."""
    rng = np.random.default_rng(seed)
    own = [[(i + 1.0) ** 2, 0.1 * rng.uniform(1, 2), *rng.uniform(1, 2, 2)] for i in range(tanks)]
    return np.array([rng.uniform(5, 9), *np.ravel(own), *rng.uniform(1, 2, (1 + 2 * tanks) * panel)])


@GRID
def test_one_to_one(tanks: int, panel: bool):
    theta, kinds = random_theta(tanks, panel), kinds_of(tanks, panel)
    assert len(theta) == len(kinds)
    pi = regression_parameters(theta, kinds, tanks)
    np.testing.assert_allclose(fractions(pi, kinds, tanks), theta, rtol=1e-8)


@GRID
def test_sensitivity(tanks: int, panel: bool):
    """Against central differences, which lose half the digits."""
    theta, kinds = random_theta(tanks, panel), kinds_of(tanks, panel)
    step = 1e-6 * np.diag(theta)
    up, down = ([regression_parameters(theta + s * row, kinds, tanks) for row in step] for s in (1, -1))
    numeric = (np.array(up) - np.array(down)).T / (2e-6 * theta)
    exact = sensitivity(theta, kinds, tanks)
    np.testing.assert_allclose(exact, numeric, atol=1e-7 * np.abs(exact).max())


def test_fractions_are_scipys():
    """m_r Q/P - m_r of three tanks, expanded by scipy.signal.residue."""
    kinds = kinds_of(3, False)
    theta = random_theta(3, False)
    value = dict(zip(kinds, regression_parameters(theta, kinds, 3), strict=True))
    m_r = 1 / value["f", 0]
    p = np.array([1, *(m_r * value["f", j] for j in range(1, 7))])
    q = np.array([1, *(value["a", j] for j in range(1, 7))])
    found, poles, _ = residue(m_r * (q - p), p)
    for i in range(3):
        kappa, beta, mass, c = theta[1 + 4 * i : 5 + 4 * i]
        k = int(np.argmin(np.abs(poles - (-beta / 2 + 1j * np.sqrt(kappa - beta**2 / 4)))))
        assert abs(poles[k]) ** 2 == pytest.approx(kappa)
        assert 2 * found[k].real == pytest.approx(c)
        assert -2 * (found[k] * np.conj(poles[k])).real / kappa == pytest.approx(mass)


def test_an_overdamped_tank_is_one_tank():
    """One tank needs no complex roots."""
    kinds, theta = kinds_of(1, False), np.array([10.0, 1.0, 5.0, 2.0, 10.0])
    np.testing.assert_allclose(fractions(regression_parameters(theta, kinds, 1), kinds, 1), theta)


def test_two_overdamped_tanks_are_not_a_number_but_the_mass_is():
    kinds = kinds_of(2, True)
    theta = np.array([10.0, 1.0, 5.0, 2.0, 3.0, 2.0, 5.0, 4.0, 1.0, 0.7, *np.ones(4)])
    pi = regression_parameters(theta, kinds, 2)
    assert np.isnan(fractions(pi, kinds, 2)).all()
    values, jacobian = without_tanks(pi, kinds, 2)
    assert values[[0, -1]] == pytest.approx([16.0, 0.7])
    assert np.isnan(values[1:-1]).all()
    for k in range(len(pi)):
        h = 1e-6 * pi[k] * np.eye(len(pi))[k]
        slope = (without_tanks(pi + h, kinds, 2)[0] - without_tanks(pi - h, kinds, 2)[0]) / (2 * h[k])
        np.testing.assert_allclose(
            jacobian[[0, -1], k], slope[[0, -1]], rtol=1e-6, atol=1e-6 * abs(values[0])
        )


@GRID
def test_physical_parameters(tanks: int, panel: bool):
    theta = random_theta(tanks, panel)
    values, jacobian = physical(theta, tanks, panel)
    assert len(values) == len(parameter_names(tanks, ("rho",) if panel else (), None))
    masses = theta[3 : 1 + 4 * tanks : 4]
    assert values[0] == pytest.approx(theta[0] + masses.sum())
    np.testing.assert_allclose(values[1 : 1 + 3 * tanks : 3], masses)
    np.testing.assert_allclose(values[2 : 1 + 3 * tanks : 3], masses * theta[1 : 1 + 4 * tanks : 4])
    step = 1e-6 * np.eye(len(theta))
    numeric = [
        (physical(theta + h, tanks, panel)[0] - physical(theta - h, tanks, panel)[0]) / 2e-6 for h in step
    ]
    np.testing.assert_allclose(jacobian, np.array(numeric).T, atol=1e-7)


@GRID
def test_tied_parameters_are_the_products(tanks: int, panel: bool):
    """(24) and (27) with c_i = m_i beta_i and the panel's force beside the thrust at every degree."""
    kinds = kinds_of(tanks, panel)
    rng = np.random.default_rng(1)
    own = [[(i + 1.0) ** 2, *rng.uniform(0.1, 2, 2)] for i in range(tanks)]
    rho = 1.3
    unknowns = np.array([7.0, *np.ravel(own), *([rho / 7.0] if panel else [])])
    pi = dict(zip(kinds, tied_parameters(unknowns, kinds, tanks), strict=True))
    for j in range(2 * tanks + 1):
        if panel:
            assert pi["p", j] == pytest.approx(rho * pi["f", j], rel=1e-12)
    s = 0.3 + 0.7j  # the transfer function at some point, from the masses themselves
    apparent = 7.0 + sum(m * (beta * s + kappa) / (s * s + beta * s + kappa) for kappa, beta, m in own)
    top = sum(pi["f", j] * s**-j for j in range(2 * tanks + 1))
    bottom = 1.0 + sum(pi["a", j] * s**-j for j in range(1, 2 * tanks + 1))
    assert bottom / top == pytest.approx(apparent, rel=1e-12)
