"""Linear systems: norm against SLICOT and closed forms, loops, discretisation."""

from __future__ import annotations

import control
import numpy as np
import pytest
from control_cases import slicot_norm

from smsid.control._statespace import StateSpace, hinf_norm, lower_lft, stack
from smsid.errors import ControlError


def random_stable(rng, n=6, m=3, p=2):
    a = rng.standard_normal((n, n))
    a -= (np.linalg.eigvals(a).real.max() + 0.05 + rng.random()) * np.eye(n)
    d = rng.standard_normal((p, m)) if rng.random() < 0.7 else np.zeros((p, m))
    return StateSpace(a, rng.standard_normal((n, m)), rng.standard_normal((p, n)), d)


def test_the_norm_is_slicot_s():
    rng = np.random.default_rng(0)
    for _ in range(60):
        s = random_stable(rng)
        np.testing.assert_allclose(hinf_norm(s)[0], slicot_norm(s), rtol=1e-6)


def test_the_norm_of_a_light_oscillator():
    """Its peak 1 / (2 zeta sqrt(1 - zeta^2)) is far narrower than any sweep."""
    for zeta in (1e-2, 1e-4, 1e-6):
        s = StateSpace(
            np.array([[0, 1], [-1, -2 * zeta]]),
            np.array([[0], [1.0]]),
            np.array([[1.0, 0]]),
            np.zeros((1, 1)),
        )
        norm, at = hinf_norm(s)
        np.testing.assert_allclose(norm, 1.0 / (2 * zeta * np.sqrt(1 - zeta**2)), rtol=1e-6)
        np.testing.assert_allclose(at, np.sqrt(1 - 2 * zeta**2), rtol=1e-3)


def test_an_unstable_system_has_no_norm():
    s = StateSpace(np.array([[0.1]]), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1)))
    assert hinf_norm(s)[0] == np.inf


def test_loops_are_those_of_python_control():
    rng = np.random.default_rng(1)
    for _ in range(10):
        plant, k = random_stable(rng, 4, 4, 5), random_stable(rng, 3, 3, 2)
        found = lower_lft(plant, k)
        exact = control.ss(plant.a, plant.b, plant.c, plant.d).lft(control.ss(k.a, k.b, k.c, k.d))
        for w in (0.1, 1.0, 7.0):
            np.testing.assert_allclose(found.response(np.array([w]))[0], exact(1j * w), rtol=1e-8, atol=1e-10)


def test_tustin_and_stacking():
    rng = np.random.default_rng(2)
    s, r = random_stable(rng, 3, 2, 2), random_stable(rng, 2, 1, 1)
    both = stack([s, r])
    w = np.array([0.3])
    np.testing.assert_allclose(both.response(w)[0, :2, :2], s.response(w)[0], rtol=1e-12)
    np.testing.assert_allclose(both.response(w)[0, 2:, 2:], r.response(w)[0], rtol=1e-12)
    period = 0.01
    exact = control.ss(s.a, s.b, s.c, s.d).sample(period, method="tustin")
    found = s.sampled(period)
    assert found.stable
    np.testing.assert_allclose(found.response(w)[0], exact(np.exp(0.3j * period)), rtol=1e-9)


def test_bad_shapes_are_refused():
    with pytest.raises(ControlError, match="`b` of a linear system has shape"):
        StateSpace(np.eye(2), np.ones((1, 1)), np.ones((1, 2)), np.zeros((1, 1)))
    s = StateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1)))
    with pytest.raises(ControlError, match="not well posed"):
        lower_lft(StateSpace(-np.eye(1), np.ones((1, 2)), np.ones((2, 1)), np.ones((2, 2))), s)
    with pytest.raises(ControlError, match="does not fit a plant"):
        lower_lft(s, StateSpace(np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((1, 0)), np.ones((1, 2))))


def test_balancing_changes_units_of_states_only():
    rng = np.random.default_rng(3)
    plain = StateSpace(
        rng.standard_normal((4, 4)), *(rng.standard_normal(s) for s in ((4, 2), (3, 4), (3, 2)))
    )
    t = np.array([1e-7, 1.0, 1e6, 1e3])
    odd = StateSpace(plain.a * t / t[:, None], plain.b / t[:, None], plain.c * t, plain.d)
    even, omega = odd.balance_states(), np.array([0.1, 1.0, 10.0])
    np.testing.assert_allclose(even.response(omega), plain.response(omega), rtol=1e-9)
    sizes = np.linalg.norm(even.b, axis=1)
    assert (
        sizes.max() / sizes.min()
        < 1e2
        < 1e9
        < np.ptp(np.linalg.norm(odd.b, axis=1)) / np.linalg.norm(odd.b, axis=1).min()
    )
    assert (
        StateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1)))
        .balance_states()
        .order
        == 0
    )
