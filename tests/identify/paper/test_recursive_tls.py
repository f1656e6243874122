"""Recursive total least squares equals the batch one, in any chunking."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smsid.errors import NotIdentifiableError, SmsidError
from smsid.identify._tls import total_least_squares
from smsid.identify.paper.recursive_tls import RecursiveTls, prior_rows

NOISE = np.array([0.1, 0.2, 0.05, 0.1])
X = np.array([1.0, -2.0, 3.0])


def stream(seed, rows=120):
    rng = np.random.default_rng(seed)
    A0 = rng.normal(size=(rows, 3)) + 0.5
    return A0 + NOISE[:3] * rng.normal(size=A0.shape), A0 @ X + NOISE[3] * rng.normal(size=rows)


def assert_same(a, b):
    np.testing.assert_allclose(a.x, b.x, rtol=1e-9)
    np.testing.assert_allclose(a.covariance, b.covariance, rtol=1e-7, atol=1e-14)
    assert a.sigma == pytest.approx(b.sigma, rel=1e-9)
    assert a.rows == pytest.approx(b.rows)


@settings(max_examples=25, deadline=None)
@given(
    st.integers(0, 10**6),
    st.lists(st.integers(0, 120), max_size=12),
    st.booleans(),
    st.sampled_from([(), (1,)]),
)
def test_any_chunking_equals_batch(seed, cuts, with_prior, exact):
    A, b = stream(seed)
    P = np.diag([0.1, 0.4, 0.2]) + 0.02
    prior = {"prior_mean": X + 0.1, "prior_covariance": P} if with_prior else {}
    recursive = RecursiveTls(3, noise=NOISE, exact=exact, **prior)
    edges = [0, *sorted(cuts), len(b)]
    for start, stop in pairwise(edges):
        recursive.update(A[start:stop], b[start:stop])
    if with_prior:
        rows, rhs = prior_rows(X + 0.1, P, noise=NOISE, exact=exact)
        A, b = np.vstack([rows, A]), np.r_[rhs, b]
    assert_same(recursive.solution(), total_least_squares(A, b, noise=NOISE, exact=exact))


def test_single_rows():
    A, b = stream(1)
    recursive = RecursiveTls(3, noise=NOISE)
    for row, rhs in zip(A, b, strict=True):
        recursive.update(row, rhs)
    assert_same(recursive.solution(), total_least_squares(A, b, noise=NOISE))


def test_forgetting_is_row_weighting_in_any_chunking():
    A, b = stream(2)
    weights = 0.97 ** (0.5 * np.arange(len(b) - 1, -1, -1))
    expected = total_least_squares(A * weights[:, None], b * weights, noise=NOISE).x
    for chunks in (1, 7, 120):
        recursive = RecursiveTls(3, noise=NOISE, forgetting=0.97)
        for part in np.array_split(np.arange(len(b)), chunks):
            recursive.update(A[part], b[part])
        np.testing.assert_allclose(recursive.solution().x, expected, rtol=1e-9)
        assert recursive.rows == pytest.approx(np.sum(weights**2))


def test_forgetting_follows_a_change():
    A, b = stream(3, 2000)
    recursive = RecursiveTls(3, noise=NOISE, forgetting=0.99).update(A, b)
    recursive.update(A, A @ (2 * X))
    np.testing.assert_allclose(recursive.solution().x, 2 * X, rtol=0.05)


def test_prior_alone_returns_the_prior_and_data_refine_it():
    mean, P = X + 0.05, 0.01 * np.eye(3)
    recursive = RecursiveTls(3, mean, P, noise=NOISE)
    A, b = stream(4, 8)
    few = recursive.update(A, b).solution()
    A, b = stream(5, 5000)
    many = recursive.update(A, b).solution()
    assert np.linalg.norm(many.x - X) < np.linalg.norm(few.x - X) < 0.5
    assert np.all(many.standard_deviation < few.standard_deviation)


def test_prior_has_the_weight_of_its_covariance():
    """With as much information in prior and data, the variance of the estimate halves."""
    rng = np.random.default_rng(6)
    A0 = rng.normal(size=(400, 3)) + 0.5
    noise = 0.1 * NOISE
    data, both = [], []
    q = np.r_[X, -1.0] ** 2 @ noise**2
    P = q * np.linalg.inv(A0.T @ A0)
    root = np.linalg.cholesky(P)
    for _ in range(600):
        A = A0 + noise[:3] * rng.normal(size=A0.shape)
        b = A0 @ X + noise[3] * rng.normal(size=400)
        data.append(total_least_squares(A, b, noise=noise).x)
        mean = X + root @ rng.normal(size=3)
        both.append(RecursiveTls(3, mean, P, noise=noise).update(A, b).solution().x)
    ratio = np.var(both, axis=0) / np.var(data, axis=0)
    np.testing.assert_allclose(ratio, 0.5, atol=0.1)


def test_prior_identifies_what_the_data_do_not():
    A, b = stream(7)
    A[:, 2] = A[:, 0]
    with pytest.raises(NotIdentifiableError):
        RecursiveTls(3, noise=NOISE).update(A, b).solution()
    solution = RecursiveTls(3, X, np.eye(3), noise=NOISE).update(A, b).solution()
    assert np.all(np.isfinite(solution.x))


def test_refusals():
    with pytest.raises(NotIdentifiableError):
        RecursiveTls(3).solution()
    with pytest.raises(SmsidError):
        RecursiveTls(3, forgetting=0.0)
    with pytest.raises(SmsidError):
        RecursiveTls(3, prior_mean=X)
    with pytest.raises(SmsidError):
        RecursiveTls(3, X, -np.eye(3))
    with pytest.raises(SmsidError):
        RecursiveTls(3).update(np.ones((2, 4)), np.ones(2))


def test_a_refused_block_leaves_no_trace():
    A, b = stream(8)
    recursive = RecursiveTls(3, noise=NOISE).update(A, b)
    before = recursive.solution()
    with pytest.raises(NotIdentifiableError):
        recursive.update(np.full((1, 3), np.nan), 1.0)
    assert_same(recursive.solution(), before)
