"""The noise of torques beside what is fitted to them, against what it is and a restricted likelihood."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.optimize import minimize
from scipy.signal import lfilter

from smsid.diagnose.torque.noise import blocks_of, likeliest_noise
from smsid.diagnose.torque.whitening import Whitening, _autoregression

N, TAKEN = 200, 30
SLOW = np.cos(np.pi * np.arange(TAKEN) * (np.arange(N)[:, None] + 0.5) / N)
"""What a fit takes: the slowest 30 of 200 frequencies."""


def learnt(design, torque, *, shared):
    near = np.zeros(torque.shape, dtype=bool)
    return likeliest_noise(blocks_of(design, torque, shared=shared), np.zeros(torque.shape[1]), near)


def coloured(rng, joints=1, memory=0.4):
    return lfilter([1.0], [1.0, -memory], rng.standard_normal((N + 50, joints)), axis=0)[50:]


@pytest.mark.parametrize("shared", [True, False])
def test_white_noise_is_as_large_as_what_is_left_says_for_what_was_taken(shared):
    """The restricted likelihood of white noise is largest at the squares left by the degrees of freedom."""
    rng = np.random.default_rng(7)
    design, scale = rng.standard_normal((N, 2, 20)), np.array([0.1, 5.0])
    torque = design @ rng.standard_normal(20) + scale * rng.standard_normal((N, 2))
    found = learnt(design, torque, shared=shared)
    assert not found.coefficients.any()
    if shared:
        whitened, target = (design / scale[:, None]).reshape(2 * N, 20), (torque / scale).ravel()
        left = target - whitened @ np.linalg.lstsq(whitened, target, rcond=None)[0]
        np.testing.assert_allclose(found.sigma, scale * np.sqrt(left @ left / (2 * N - 20)), rtol=0.1)
    else:
        for j in range(2):
            left = torque[:, j] - design[:, j] @ np.linalg.lstsq(design[:, j], torque[:, j], rcond=None)[0]
            # six instants begin the autoregression
            assert found.sigma[j] == pytest.approx(np.sqrt(left @ left / (N - 20)), rel=0.03)


def test_slow_noise_that_a_fit_takes_is_not_missed():
    """What is left alone said that slow noise is less than half as large as it was."""
    rng = np.random.default_rng(3)
    truth, restricted, plain = 1.0 / (1.0 - 0.4), [], []
    nowhere = np.zeros((N, 1), dtype=bool)
    for _ in range(60):
        noise = coloured(rng)
        restricted.append(learnt(SLOW[:, None], noise, shared=False).slow[0] / truth)
        left = noise - SLOW @ np.linalg.lstsq(SLOW, noise, rcond=None)[0]
        plain.append(Whitening.of(left, [np.zeros((N, 0))], np.zeros(1), nowhere).slow[0] / truth)
    assert np.exp(np.mean(np.log(restricted))) == pytest.approx(1.0, abs=0.1)
    assert np.exp(np.mean(np.log(plain))) < 0.7


def test_its_restricted_likelihood_is_the_largest():
    """Against a direct search of the dense one, of one coefficient and a variance."""
    torque = coloured(np.random.default_rng(5), memory=0.6)
    found = learnt(SLOW[:, None], torque, shared=False)
    assert np.count_nonzero(found.coefficients) == 1

    def less(x):
        covariance = x[1] ** 2 / (1.0 - x[0] ** 2) * toeplitz(x[0] ** np.arange(N))
        inverse = np.linalg.inv(covariance)
        inner = SLOW.T @ inverse @ SLOW
        left = torque - SLOW @ np.linalg.solve(inner, SLOW.T @ inverse @ torque)
        logs = np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(inner)[1]
        return 0.5 * (logs + float(left[:, 0] @ inverse @ left[:, 0]))

    best = minimize(less, [0.3, 1.2], method="Nelder-Mead", bounds=[(0.0, 0.99), (0.3, 3.0)]).x
    assert found.coefficients[0, 0] == pytest.approx(best[0], abs=0.05)
    assert found.sigma[0] == pytest.approx(best[1], rel=0.03)


def test_an_autoregression_of_several_series_is_of_the_sum_of_their_squares():
    x = coloured(np.random.default_rng(2), memory=0.7)
    assert _autoregression(np.hstack([x, -x]), 4)[0] == pytest.approx(0.7, abs=0.1)
    np.testing.assert_allclose(_autoregression(np.hstack([x, 0.0 * x]), 4), _autoregression(x, 4))
    assert not _autoregression(np.zeros((N, 2)), 4).any()
