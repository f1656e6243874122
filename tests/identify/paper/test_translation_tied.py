"""Exp. 1 whitened, tied, with biases: against Newton's equations, its spread against the Cramer-Rao bound."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.signal

from smsid.errors import NotIdentifiableError, SmsidError
from smsid.identify.paper._translation import identify_axis
from smsid.identify.paper._translation_tied import identify_axis_tied

from ..support import TANK, TWO_TANKS, M, fly_exp1
from .test_translation import axis_data, truth

CASES = pytest.mark.parametrize("panel", [False, True], ids=["rigid", "panel"])


def cramer_rao(rate: float, noise: float, panel: bool) -> np.ndarray:
    """Least standard deviations of M, m_s, k_s, b_s and for the panel rho, from the acceleration.

    By central differences of scipy's simulation of the transfer function (21); p is taken as exact.
    """
    data = axis_data((TANK,), panel, rate)

    def acceleration(theta: np.ndarray) -> np.ndarray:
        m, m_s, k, b = theta[:4]
        force = data.force - (theta[4] * data.panels[0].force if panel else 0.0)
        m_r = m - m_s
        top = np.array([1.0, b / m_s, k / m_s]) / m_r
        return scipy.signal.lsim((top, [1.0, b * m / (m_r * m_s), k * m / (m_r * m_s)]), force, data.time)[1]

    theta = truth((TANK,), panel)
    columns = []
    for i, value in enumerate(theta):
        step = 1e-4 * value * np.eye(len(theta))[i]
        columns.append((acceleration(theta + step) - acceleration(theta - step)) / (2e-4 * value))
    jacobian = np.array(columns).T
    return noise * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))


@CASES
@pytest.mark.parametrize("tanks", [(), (TANK,), TWO_TANKS], ids=["no tank", "one tank", "two tanks"])
def test_exact_recovery(tanks, panel: bool):
    """Only the trapezoids' second order in the step is left."""
    errors = []
    for rate in (50.0, 100.0):
        found = identify_axis_tied(axis_data(tanks, panel, rate), len(tanks))
        errors.append(np.abs(found.values / truth(tanks, panel) - 1.0))
    assert errors[1].max() < 1e-3
    if tanks:
        assert errors[0].max() / errors[1].max() == pytest.approx(4.0, rel=0.15)


@CASES
def test_biases_are_no_part_of_the_answer(panel: bool):
    """A hundred times the bias that spoils the regression as printed changes nothing."""
    size = 1e-3
    data = axis_data((TANK,), panel)
    moved = replace(data, acceleration=data.acceleration + size)
    if panel:
        (own,) = data.panels
        moved = replace(moved, panels=(replace(own, force=own.force - 0.7 * size * own.weights.sum()),))
    clean, found = (identify_axis_tied(d).values for d in (data, moved))
    np.testing.assert_allclose(found, clean, rtol=1e-6)


@CASES
def test_spread_is_cramer_raos(panel: bool):
    """80 seeds at 20 Hz: spread and predicted sigma both at the bound (8 % each; four of those allowed).

    The two columns of biases cost M up to a third where the panel bends, everything else a few per cent.
    """
    rng = np.random.default_rng(1)
    runs = [identify_axis_tied(axis_data((TANK,), panel, 20.0, 1e-4, rng)) for _ in range(80)]
    values = np.array([r.values for r in runs])
    predicted = np.mean([r.sigma for r in runs], axis=0)
    np.testing.assert_allclose(values.std(axis=0, ddof=1), predicted, rtol=0.32)
    bound = cramer_rao(20.0, 1e-4, panel)
    assert np.all(predicted > 0.97 * bound)
    assert np.all(predicted[1:4] < 1.1 * bound[1:4])
    assert predicted[0] < 1.4 * bound[0]
    off = (values.mean(axis=0) - truth((TANK,), panel)) / (predicted / np.sqrt(80))
    assert np.abs(off[:4]).max() < 4.0, off


def test_better_than_as_printed():
    """Every predicted sigma, and k_s by more than two."""
    data = axis_data((TANK,), True, 100.0, 1e-4, np.random.default_rng(3))
    tied, printed = identify_axis_tied(data), identify_axis(data)
    assert np.all(tied.sigma < printed.sigma)
    assert tied["k_s"][1] < 0.5 * printed["k_s"][1]


def test_two_tanks_with_noise():
    """40 seeds (11 % each, four of those allowed), ten times the noise at which the printed one is linear."""
    rng = np.random.default_rng(4)
    runs = [identify_axis_tied(axis_data(TWO_TANKS, False, 20.0, 1e-5, rng), 2) for _ in range(40)]
    values = np.array([r.values for r in runs])
    np.testing.assert_allclose(values.std(axis=0, ddof=1), np.mean([r.sigma for r in runs], axis=0), rtol=0.3)


def test_a_wandering_bias_widens_the_interval():
    """Spread over 80 draws of a Gauss-Markov bias without other noise, as predicted."""
    rng = np.random.default_rng(5)
    sigma, correlation = 1e-6, 300.0
    data = replace(axis_data((TANK,), False, 20.0, 1e-12), drift=sigma, drift_time=correlation)
    decay = np.exp(-1.0 / (20.0 * correlation))
    runs = []
    for _ in range(80):
        kicks = sigma * np.sqrt(1.0 - decay**2) * rng.standard_normal(len(data.time))
        kicks[0] = sigma * rng.standard_normal()
        drift = scipy.signal.lfilter([1.0], [1.0, -decay], kicks)
        runs.append(identify_axis_tied(replace(data, acceleration=data.acceleration + drift)))
    spread = np.std([r.values for r in runs], axis=0, ddof=1)
    np.testing.assert_allclose(spread, np.mean([r.sigma for r in runs], axis=0), rtol=0.32)


def test_slosh_hidden_by_noise_is_told():
    """1 m/s2 of noise beside 0.018 of signal: refused, or an interval that says so."""
    refused = 0
    for seed in range(10):
        data = axis_data((TANK,), False, 20.0, 1.0, np.random.default_rng(seed))
        try:
            found = identify_axis_tied(data)
        except NotIdentifiableError as error:
            assert error.advice
            refused += 1
            continue
        assert found["m_s"][1] > 0.1 * abs(found["m_s"][0])
    assert refused > 0


def test_two_tanks_alike_are_one():
    """Equal frequencies: the mass of both in one, and a second tank with no mass to speak of."""
    found = identify_axis_tied(axis_data((TANK, TANK), False, rng=np.random.default_rng(0), noise=1e-5), 2)
    assert found["M"][0] == pytest.approx(M, rel=1e-3)
    masses = sorted((found[f"m_s{i}"] for i in "12"), key=lambda m: m[0])
    assert masses[1][0] == pytest.approx(2 * TANK[0], rel=0.01)
    assert abs(masses[0][0]) < 4.0 * masses[0][1]


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"force": np.zeros(12001)}, NotIdentifiableError, "No thrust acts along x"),
        ({"noise": 0.0}, SmsidError, "needs it positive"),
    ],
)
def test_refusals(change, error, message: str):
    with pytest.raises(error, match=message):
        identify_axis_tied(replace(axis_data((TANK,), False), **change))


def test_wrong_sign_of_thrust_is_told():
    data = axis_data((TANK,), False)
    with pytest.raises(NotIdentifiableError, match="along x"):
        identify_axis_tied(replace(data, force=-data.force))


def test_the_flight_is_the_papers():
    """Guard of the analytic flight that all of this rests on: the first acceleration is force over m_r."""
    _, force, acceleration = fly_exp1((TANK,))
    assert acceleration[1, 0] == pytest.approx(force[1] / (M - TANK[0]), rel=1e-4)
