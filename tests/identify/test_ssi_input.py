"""Subspace identification with a known input: its poles are those from that input on."""

import numpy as np
import pytest
import scipy.signal
from pyoma2.functions.ssi import SSI, build_hank

from smsid.errors import NotIdentifiableError, SmsidError
from smsid.identify.ssi import ssi_cov
from smsid.identify.ssi_decimate import decimate
from smsid.identify.ssi_input import ssi_cov_input
from smsid.identify.stabilisation import stable_modes

RATE = 20.0
CLAMPED = 2 * np.pi * np.array([0.4, 1.3]) * (-0.01 + 1j * np.sqrt(1 - 0.01**2))
PARTICIPATION = np.array([5.0, 2.5])
SHAPES = np.array([[0.5, 1.0], [-0.8, 1.0]])
MASS = 100.0


def discrete_panel():
    """Discrete-time system with the poles of the clamped panel, base acceleration in, two outputs."""
    A = np.zeros((4, 4))
    B = np.zeros((4, 1))
    C = np.zeros((2, 4))
    D = np.zeros((2, 1))
    for k, pole in enumerate(CLAMPED):
        w2, damping = abs(pole) ** 2, -2 * pole.real
        rows = slice(2 * k, 2 * k + 2)
        A[rows, rows] = [[0, 1], [-w2, -damping]]
        B[rows, 0] = [0, -PARTICIPATION[k]]
        C[:, rows] = SHAPES[k][:, None] * np.array([-w2, -damping])
        D[:, 0] -= SHAPES[k] * PARTICIPATION[k]
    return scipy.signal.StateSpace(A, B, C, D).to_discrete(1 / RATE)


def spacecraft(samples, seed=0):
    """Free base pushed by white thrust: base acceleration, panel's raw acceleration, coupled frequencies."""
    panel_mass = np.diag([MASS, 1.0, 1.0])
    panel_mass[0, 1:] = panel_mass[1:, 0] = PARTICIPATION
    inverse = np.linalg.inv(panel_mass)
    K = np.diag([0.0, *np.abs(CLAMPED) ** 2])
    D = np.diag([0.0, *(-2 * CLAMPED.real)])
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-inverse @ K, -inverse @ D]])
    B = np.r_[np.zeros(3), inverse[:, 0]][:, None]
    C = np.hstack([-inverse @ K, -inverse @ D])
    fine = 4
    force = np.repeat(np.random.default_rng(seed).normal(size=samples), fine)[:, None]
    system = scipy.signal.StateSpace(A, B, C, inverse[:, :1]).to_discrete(1 / RATE / fine)
    acceleration, _ = decimate(scipy.signal.dlsim(system, force)[1], RATE * fine, fine)
    values = np.linalg.eigvals(A)
    coupled = np.sort(np.abs(values[values.imag > 0.1])) / 2 / np.pi
    base = acceleration[:, 0]
    return base, base[:, None] + acceleration[:, 1:] @ SHAPES, coupled


def test_exact_without_noise():
    u = np.random.default_rng(0).normal(size=(200, 1))
    y = scipy.signal.dlsim(discrete_panel(), u)[1]
    (poles,) = ssi_cov_input(y, u, RATE, block_rows=10, orders=[4])
    np.testing.assert_allclose(poles.values, CLAMPED, rtol=1e-8)


def test_constant_biases_have_no_effect():
    u = np.random.default_rng(1).normal(size=(200, 1))
    y = scipy.signal.dlsim(discrete_panel(), u)[1]
    (poles,) = ssi_cov_input(y + np.array([20.0, -7.0]), u + 3.0, RATE, block_rows=10, orders=[4])
    np.testing.assert_allclose(poles.values, CLAMPED, rtol=1e-7)


def test_units_of_input_and_output_do_not_matter():
    u = np.random.default_rng(2).normal(size=(200, 1))
    y = scipy.signal.dlsim(discrete_panel(), u)[1]
    (poles,) = ssi_cov_input(1e6 * y, 1e-6 * u, RATE, block_rows=10, orders=[4])
    np.testing.assert_allclose(poles.values, CLAMPED, rtol=1e-8)


def test_coloured_input_does_not_bias_the_poles():
    """An input with a strong pole of its own: output-only finds that pole, known-input does not."""
    rng = np.random.default_rng(3)
    pole = np.exp((-0.02 + 2j * np.pi * 0.8) / RATE)
    white = rng.normal(size=20_000)
    u = scipy.signal.lfilter([1.0], np.poly([pole, pole.conj()]).real, white)[:, None]
    y = scipy.signal.dlsim(discrete_panel(), u)[1]
    y = y + 0.01 * y.std() * rng.normal(size=y.shape)
    known = stable_modes(ssi_cov_input(y, u, RATE, block_rows=20, orders=range(2, 14, 2)), RATE)
    np.testing.assert_allclose([m.frequency for m in known], np.abs(CLAMPED) / 2 / np.pi, rtol=1e-3)
    blind = stable_modes(ssi_cov(y, RATE, block_rows=20, orders=range(2, 14, 2)), RATE)
    assert min(abs(m.frequency - 0.8) for m in blind) < 0.01


def test_clamped_from_base_acceleration_coupled_from_outputs_alone():
    base, panel, coupled = spacecraft(40_000)
    orders = range(2, 14, 2)
    known = stable_modes(ssi_cov_input(panel - base[:, None], base, RATE, block_rows=20, orders=orders), RATE)
    blind = stable_modes(ssi_cov(panel, RATE, block_rows=20, orders=orders), RATE)
    clamped = np.abs(CLAMPED) / 2 / np.pi
    assert np.all(coupled / clamped - 1 > 0.03)
    np.testing.assert_allclose([m.frequency for m in known], clamped, rtol=1e-3)
    np.testing.assert_allclose([m.frequency for m in blind], coupled, rtol=1e-2)


def test_same_poles_as_pyoma_with_known_input():
    u = np.random.default_rng(4).normal(size=(4000, 1))
    y = scipy.signal.dlsim(discrete_panel(), u)[1]
    y = y + 0.02 * y.std() * np.random.default_rng(5).normal(size=y.shape)
    hankel, _ = build_hank(y.T, y.T, 15, "IOcov", U=u.T)
    _, transitions, _ = SSI(hankel, 15, 4, step=2)
    theirs = np.log(np.linalg.eigvals(transitions[2]).astype(complex)) * RATE
    theirs = theirs[theirs.imag > 0]
    (poles,) = ssi_cov_input(y, u, RATE, block_rows=15, orders=[4])
    np.testing.assert_allclose(poles.frequency, np.sort(np.abs(theirs)) / 2 / np.pi, rtol=5e-3)
    np.testing.assert_allclose(poles.values, CLAMPED, rtol=2e-3)


def test_refusals():
    rng = np.random.default_rng(6)
    u = rng.normal(size=(300, 1))
    with pytest.raises(NotIdentifiableError, match="projected"):
        ssi_cov_input(2.0 * u, u, RATE, block_rows=10, orders=[2])
    with pytest.raises(NotIdentifiableError, match="columns"):
        ssi_cov_input(u, u, RATE, block_rows=80, orders=[2])
    with pytest.raises(SmsidError, match="samples"):
        ssi_cov_input(u[1:], u, RATE, block_rows=10, orders=[2])
    with pytest.raises(NotIdentifiableError, match="finite"):
        ssi_cov_input(u, np.full_like(u, np.inf), RATE, block_rows=10, orders=[2])
