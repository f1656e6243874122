from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from smsid.recording.attitude import conjugate, continuous, rotate, slerp, turn_between

seeds = st.integers(0, 2**32 - 1)


@given(seeds)
def test_vectors_turn_as_their_quaternions_do(seed):
    rng = np.random.default_rng(seed)
    q, v = rng.normal(size=(5, 4)), rng.normal(size=(5, 2, 3))
    u, w = q[:, None, :3], q[:, None, 3:]
    size = np.sum(q**2, axis=1)[:, None, None]
    exact = v + 2.0 * np.cross(u, np.cross(u, v) + w * v) / size  # Rodrigues
    np.testing.assert_allclose(rotate(q, v), exact, atol=1e-13)
    np.testing.assert_allclose(rotate(conjugate(q), rotate(q, v)), v, atol=1e-13)


@given(seeds)
def test_slerp_agrees_with_scipy_and_keeps_the_sign_of_the_samples(seed):
    rng = np.random.default_rng(seed)
    q, t = rng.normal(size=(9, 4)), np.cumsum(rng.uniform(0.1, 2.0, size=9))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    at = np.sort(rng.uniform(t[0], t[-1], size=30))
    ours, theirs = slerp(t, q, at), Slerp(t, Rotation.from_quat(q))(at).as_quat()
    np.testing.assert_allclose(np.abs(np.sum(ours * theirs, axis=1)), 1.0, atol=1e-13)
    np.testing.assert_allclose(slerp(t, q, t[:-1]), q[:-1], atol=1e-14)


def test_small_rotations_lose_no_digits_and_the_sign_of_a_quaternion_says_nothing():
    rest, q = np.array([[0.0, 0.0, 0.0, 1.0]]), np.array([[1e-9, 0.0, 0.0, 1.0]])
    np.testing.assert_allclose(turn_between(rest, q), [[2e-9, 0.0, 0.0]], rtol=1e-12)
    np.testing.assert_allclose(turn_between(q, -rest), [[-2e-9, 0.0, 0.0]], rtol=1e-12)


def test_signs_run_on_past_missing_rows_and_wild_ones():
    rng = np.random.default_rng(3)
    half = 0.5 * np.cumsum(rng.uniform(0.0, 0.3, 200))  # many turns: no fixed half of the sphere holds them
    q = np.stack([0.6 * np.sin(half), 0.8 * np.sin(half), 0.0 * half, np.cos(half)], axis=1)
    read = q * np.append(1.0, rng.choice([-1.0, 1.0], 199))[:, None]
    np.testing.assert_array_equal(continuous(read), q)
    read[[20, 21, 90]] = np.nan
    read[[50, 51, 120]] = [[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, -1.0, 0.0], [1e300, -1e300, 0.0, 0.0]]
    good = np.setdiff1d(np.arange(200), [20, 21, 50, 51, 90, 120])
    np.testing.assert_array_equal(continuous(read)[good], q[good])
    assert np.isnan(continuous(read)[[20, 21, 90]]).all()


def test_a_fast_spin_runs_on_as_it_does():
    """More than a right angle from row to row: three rows back is nearer than the row before."""
    for turn in np.radians([60.0, 95.0, 120.0, 150.0, 170.0]):
        half = 0.5 * turn * np.arange(60)
        q = np.stack([0.0 * half, 0.0 * half, np.sin(half), np.cos(half)], axis=1)
        np.testing.assert_array_equal(continuous(q * np.resize([1.0, 1.0, -1.0], 60)[:, None]), q)
