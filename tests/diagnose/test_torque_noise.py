"""The noise of torques beside what is fitted to them, against what it is."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from smsid.diagnose.torque._noise import fit_all_joints, fit_each_joint
from smsid.diagnose.torque.whitening import Whitening, _autoregression, share_taken

N, TAKEN = 200, 30
SLOW = np.cos(np.pi * np.arange(TAKEN) * (np.arange(N)[:, None] + 0.5) / N)
"""What a fit takes: the slowest 30 of 200 frequencies."""


def learnt(residual, taken):
    return Whitening.of(residual, taken, np.zeros(len(taken)), np.zeros(residual.shape, dtype=bool))


def coloured(rng, joints=1, memory=0.4):
    return lfilter([1.0], [1.0, -memory], rng.standard_normal((N + 50, joints)), axis=0)[50:]


@pytest.mark.parametrize("fitted", [fit_each_joint, fit_all_joints])
def test_white_noise_is_as_large_as_what_is_left_says_for_what_was_taken(fitted):
    rng = np.random.default_rng(7)
    design, scale = rng.standard_normal((N, 2, 20)), np.array([0.1, 5.0])
    noise = scale * rng.standard_normal((N, 2))
    found = learnt(*fitted(design, design @ rng.standard_normal(20) + noise))
    assert not found.coefficients.any()
    np.testing.assert_allclose(found.sigma, np.sqrt(np.mean(noise**2, axis=0)), rtol=0.06)
    np.testing.assert_allclose(found.slow, found.sigma)


@pytest.mark.parametrize("memory", [0.0, 0.4])
def test_slow_noise_that_a_fit_takes_is_not_missed(memory):
    """An autoregression of what is left alone said that slow noise was less than half as large as it was: of
    120 recordings of 6 s with nothing hidden, 35 had something left that no cause explained.
    """
    rng, found, plain = np.random.default_rng(3), [], []
    for _ in range(60):
        left, taken = fit_each_joint(SLOW[:, None], coloured(rng, memory=memory))
        found.append(learnt(left, taken).slow[0] * (1.0 - memory))
        plain.append(learnt(left, [np.zeros((N, 0))]).slow[0] * (1.0 - memory))
    assert np.exp(np.mean(np.log(found))) == pytest.approx(1.0, abs=0.1)
    assert np.exp(np.mean(np.log(plain))) < 0.7


def test_parameters_common_to_all_joints_take_as_many_instants_as_they_are():
    rng = np.random.default_rng(4)
    design, x = rng.standard_normal((50, 3, 8)), rng.standard_normal(8)
    noise = rng.standard_normal((50, 3)) * [0.1, 1.0, 5.0]
    left, directions = fit_all_joints(design, design @ x + noise)
    taken = 50.0 * np.array([share_taken(u) for u in directions])
    assert taken.sum() == pytest.approx(8.0) and taken[0] > 2.0 * taken[1] > 4.0 * taken[2]
    direct = np.linalg.lstsq((design / [[[0.1], [1.0], [5.0]]]).reshape(150, 8),
                             ((design @ x + noise) / [0.1, 1.0, 5.0]).ravel(), rcond=None)[0]  # fmt: skip
    assert left == pytest.approx(design @ x + noise - design @ direct, abs=0.02)


@pytest.mark.parametrize(
    ("poles", "n"), [((0.97, 0.95), 300), ((0.97, 0.95), 3000), ((0.9, 0.9, 0.9, 0.9), 600)]
)
def test_noise_of_a_steep_spectrum_is_whitened(poles, n):
    """Its slow part, a thousand times the fast one, leaks into covariances that wrap around."""
    rng, memory = np.random.default_rng(1), -np.poly(poles)[1:]
    noise = lfilter([1.0], [1.0, *-memory], rng.standard_normal(n + 500))[500:]
    found = learnt(noise[:, None], [np.zeros((n, 0))])
    white = found.apply(noise[:, None], np.zeros((n, 1), dtype=bool))[:, 0]
    assert found.sigma[0] == pytest.approx(1.0, rel=0.15)
    assert abs(np.mean(white[1:] * white[:-1])) < 4.0 / np.sqrt(n)


@pytest.mark.parametrize("n", [25, 200])
def test_what_is_no_noise_at_all_is_learnt_too(n):
    """A constant, a wave and what rounding leaves: of a joint on which nothing but a constant acts."""
    k = np.arange(n)
    for left in (np.ones(n), (-1.0) ** k, np.sin(2 * np.pi * k / 25), np.full(n, 1e-170), np.zeros(n)):
        assert np.isfinite(_autoregression(left, np.full((n, 1), 1.0 / np.sqrt(n)), min(6, n // 20))).all()
