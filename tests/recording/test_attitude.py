from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from smsid.recording._attitude import conjugate, multiply, rotate, rotation_vector, slerp

seeds = st.integers(0, 2**32 - 1)


@given(seeds)
def test_products_and_vectors_agree_with_scipy(seed):
    rng = np.random.default_rng(seed)
    a, b, v = rng.normal(size=(5, 4)), rng.normal(size=(5, 4)), rng.normal(size=(5, 2, 3))
    a, b = (q / np.linalg.norm(q, axis=1, keepdims=True) for q in (a, b))
    ra, rb = Rotation.from_quat(a), Rotation.from_quat(b)
    np.testing.assert_allclose(
        Rotation.from_quat(multiply(a, b)).as_matrix(), (ra * rb).as_matrix(), atol=1e-14
    )
    np.testing.assert_allclose(rotate(a, v), np.einsum("nij,nsj->nsi", ra.as_matrix(), v), atol=1e-14)
    np.testing.assert_allclose(rotate(conjugate(a), rotate(a, v)), v, atol=1e-13)
    np.testing.assert_allclose(rotation_vector(a), ra.as_rotvec(), atol=1e-13)


@given(seeds)
def test_slerp_agrees_with_scipy_and_keeps_the_sign_of_the_samples(seed):
    rng = np.random.default_rng(seed)
    q, t = rng.normal(size=(9, 4)), np.cumsum(rng.uniform(0.1, 2.0, size=9))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    at = np.sort(rng.uniform(t[0], t[-1], size=30))
    ours, theirs = slerp(t, q, at), Slerp(t, Rotation.from_quat(q))(at).as_quat()
    np.testing.assert_allclose(np.abs(np.sum(ours * theirs, axis=1)), 1.0, atol=1e-13)
    np.testing.assert_allclose(slerp(t, q, t[:-1]), q[:-1], atol=1e-14)


def test_small_rotations_lose_no_digits():
    q = np.array([[1e-9, 0.0, 0.0, 1.0]])
    np.testing.assert_allclose(rotation_vector(q), [[2e-9, 0.0, 0.0]], rtol=1e-12)
