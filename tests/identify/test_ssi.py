"""Output-only SSI-COV against known systems and against pyOMA-2."""

import numpy as np
import pytest
import scipy.linalg
import scipy.signal
from pyoma2.functions.ssi import SSI, build_hank

from smsid.errors import NotIdentifiableError, SmsidError
from smsid.identify.modes import mac
from smsid.identify.ssi import ssi_cov
from smsid.identify.stabilisation import stable_modes

RATE = 10.0
MASS = np.diag([2.0, 1.0, 1.5])
STIFFNESS = np.array([[90.0, -30.0, 0.0], [-30.0, 70.0, -40.0], [0.0, -40.0, 40.0]])
DAMPING = 0.05 * MASS + 0.002 * STIFFNESS


def chain():
    """Three masses in a row: discrete A, B (force on each), C, D (accelerations), and the true modes."""
    minv = np.linalg.inv(MASS)
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-minv @ STIFFNESS, -minv @ DAMPING]])
    B = np.vstack([np.zeros((3, 3)), minv])
    C = np.hstack([-minv @ STIFFNESS, -minv @ DAMPING])
    values, vectors = np.linalg.eig(A)
    keep = np.flatnonzero(values.imag > 0)
    keep = keep[np.argsort(np.abs(values[keep]))]
    system = scipy.signal.StateSpace(A, B, C, minv).to_discrete(1 / RATE)
    return system, values[keep], (C @ vectors[:, keep]).T


def ambient(samples, seed=0):
    system, values, shapes = chain()
    force = np.random.default_rng(seed).normal(size=(samples, 3))
    return scipy.signal.dlsim(system, force)[1], values, shapes


def free_response(samples):
    system, values, shapes = chain()
    x = np.random.default_rng(1).normal(size=6)
    return scipy.signal.dlsim(system, np.zeros((samples, 3)), x0=x)[1], values, shapes


def test_white_noise_excitation_gives_the_modes():
    y, values, shapes = ambient(40_000)
    modes = stable_modes(ssi_cov(y, RATE, block_rows=15, orders=range(2, 16, 2)), RATE)
    assert len(modes) == 3
    np.testing.assert_allclose([m.frequency for m in modes], np.abs(values) / 2 / np.pi, rtol=5e-3)
    np.testing.assert_allclose([m.damping for m in modes], -values.real / np.abs(values), rtol=0.25)
    for mode, shape in zip(modes, shapes, strict=True):
        assert mac(mode.shape, shape)[0, 0] > 0.999


def test_short_free_response_is_exact():
    """Two periods of the lowest mode suffice: the Hankel covariance keeps the rank a Toeplitz one loses."""
    y, values, shapes = free_response(40)
    (poles,) = ssi_cov(y, RATE, block_rows=5, orders=[6])
    np.testing.assert_allclose(poles.values, values, rtol=1e-7)
    np.testing.assert_allclose(np.diag(mac(poles.shapes, shapes)), 1.0, rtol=1e-9)


def test_constant_bias_has_no_effect():
    y, values, _ = free_response(60)
    (poles,) = ssi_cov(y + np.array([3.0, -2.0, 10.0]), RATE, block_rows=5, orders=[6])
    np.testing.assert_allclose(poles.values, values, rtol=1e-6)


def test_a_single_output():
    y, values, _ = free_response(120)
    (poles,) = ssi_cov(y[:, 0], RATE, block_rows=10, orders=[6])
    np.testing.assert_allclose(poles.values, values, rtol=1e-4)


def test_contributions_of_a_free_response_name_the_strong_mode():
    system, values, _ = chain()
    _, vectors = np.linalg.eig(np.asarray(system.A))
    discrete = np.exp(values[1] / RATE)
    k = np.argmin(np.abs(np.linalg.eigvals(np.asarray(system.A)) - discrete))
    y = scipy.signal.dlsim(system, np.zeros((200, 3)), x0=vectors[:, k].real)[1]
    y = y + 1e-6 * free_response(200)[0]
    (poles,) = ssi_cov(y, RATE, block_rows=10, orders=[6])
    assert np.argmax(poles.contributions) == 1
    assert poles.contributions[1] > 0.99


def test_same_poles_as_pyoma_on_the_same_record():
    """pyOMA-2 uses one column less and keeps the mean: the poles agree far better than they are known."""
    y, *_ = ambient(20_000, seed=2)
    y = y - y.mean(axis=0)
    hankel, _ = build_hank(y.T, y.T, 12, "cov")
    _, transitions, _ = SSI(hankel, 12, 10, step=2)
    for poles in ssi_cov(y, RATE, block_rows=12, orders=[6, 8, 10]):
        theirs = np.log(np.linalg.eigvals(transitions[poles.order // 2]).astype(complex)) * RATE
        theirs = theirs[theirs.imag > 0]
        true = np.sort(np.abs(chain()[1]))
        for value in true:
            ours = poles.values[np.argmin(np.abs(np.abs(poles.values) - value))]
            assert np.min(np.abs(theirs - ours)) < 1e-3 * value


def test_same_poles_as_pyoma_on_a_free_response():
    y, *_ = free_response(80)
    hankel, _ = build_hank(y.T, y.T, 8, "cov")
    _, transitions, _ = SSI(hankel, 8, 6, step=2)
    theirs = np.log(np.linalg.eigvals(transitions[3]).astype(complex)) * RATE
    theirs = theirs[theirs.imag > 0]
    (poles,) = ssi_cov(y, RATE, block_rows=8, orders=[6])
    np.testing.assert_allclose(poles.values, theirs[np.argsort(np.abs(theirs))], rtol=1e-6)


def test_refusals():
    y = np.random.default_rng(3).normal(size=(100, 2))
    with pytest.raises(NotIdentifiableError, match="columns"):
        ssi_cov(y, RATE, block_rows=45, orders=[2])
    with pytest.raises(NotIdentifiableError, match="constant"):
        ssi_cov(np.ones((100, 2)), RATE, block_rows=5, orders=[2])
    with pytest.raises(SmsidError, match="orders"):
        ssi_cov(y, RATE, block_rows=5, orders=[20])
    y[30, 1] = np.nan
    with pytest.raises(NotIdentifiableError) as caught:
        ssi_cov(y, RATE, block_rows=5, orders=[2])
    assert caught.value.evidence["samples"].tolist() == [30]
