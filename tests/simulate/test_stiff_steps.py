"""Stiff motion: dry friction on a light link, against SciPy's LSODA of the one equation and the creep."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import Radau, solve_ivp

from smsid.errors import SimulationError
from smsid.simulate import Constant, Fourier, Inputs, simulate
from smsid.simulate._stiff_steps import Stiffness, StiffSteps

from .conftest import COULOMB, INERTIA, SMOOTHING


def test_below_its_friction_it_creeps(light):
    """Half of the friction's torque: w = s artanh(1/2), in some hundred steps."""
    found = simulate(light, Inputs(joint_torque=Constant([0.5 * COULOMB])), 1.0)
    assert found.steps < 300
    states = found.states(np.linspace(0.1, 1.0, 5))
    np.testing.assert_allclose(states.v[:, 0], SMOOTHING * np.arctanh(0.5), rtol=1e-8)


def test_sticks_and_slips_as_lsoda_says(light):
    """A torque that swings beyond the friction and back."""
    torque = Fourier(1.0, np.array([[1.5]]), np.array([[0.0]]), np.zeros(1))
    found = simulate(light, Inputs(joint_torque=torque), 2.0)
    assert found.steps < 5000

    def rate(t, y):
        return [y[1], (torque(t)[0] - COULOMB * np.tanh(y[1] / SMOOTHING)) / INERTIA]

    times = np.linspace(0.0, 2.0, 41)
    theirs = solve_ivp(rate, (0.0, 2.0), [0.0, 0.0], "LSODA", times, rtol=1e-10, atol=1e-12)
    states = found.states(times)
    np.testing.assert_allclose(states.v[:, 0], theirs.y[1], atol=1e-5 * np.abs(theirs.y[1]).max())


def test_steps_are_radaus():
    def rate(t, y, out):
        out[:] = -1e4 * (y - np.cos(t))
        return out

    start = np.array([0.3])
    ours = StiffSteps(rate, 0.0, start, 1.0, 1e-5, 1e-9, 1e-11)
    exact = {"rtol": 1e-9, "atol": 1e-11, "first_step": 1e-5, "jac": [[-1e4]]}
    theirs = Radau(lambda t, y: -1e4 * (y - np.cos(t)), 0.0, start, 1.0, **exact)
    for _ in range(10):
        piece = ours.step(np.inf)
        theirs.step()
        assert piece.t == pytest.approx(theirs.t, rel=1e-6)
        np.testing.assert_allclose(piece.y, theirs.y, rtol=1e-6)
        middle = 0.5 * (theirs.t_old + theirs.t)
        np.testing.assert_allclose(piece(middle), theirs.dense_output()(middle), rtol=1e-6)
    assert piece.t < 1.0


def test_what_fails_says_why():
    def rate(t, y, out):
        out[:] = np.nan if t > 0.5 else 0.0
        return out

    steps = StiffSteps(rate, 0.0, np.ones(2), 1.0, 0.4, 1e-6, 1e-9)
    with np.errstate(invalid="ignore"), pytest.raises(SimulationError, match=r"failed at t = 0\.\d+ s"):
        for _ in range(100):
            steps.step(0.3)


def test_is_stiff_after_fifteen_steps_at_the_boundary_but_for_calm_ones():
    stiffness = Stiffness()
    assert not any(stiffness.seen(7.0) for _ in range(14))
    assert not any(stiffness.seen(1.0) for _ in range(6))
    assert [stiffness.seen(7.0) for _ in range(15)].index(True) == 14
    stiffness.anew()
    assert not stiffness.seen(1.0) and stiffness.seen(7.0)
