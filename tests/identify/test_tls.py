"""Total least squares against independent formulas, odrpack, and Monte Carlo."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from odrpack import odr_fit

from smsid.errors import NotIdentifiableError, SmsidError
from smsid.identify._tls import accumulate, total_least_squares

X = np.array([2.0, -1.0, 0.5])


def problem(seed=0, rows=200, sigma=0.1, columns=3):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(rows, columns)) + 0.3
    x = rng.normal(size=columns)
    b = A @ x
    return A + sigma * rng.normal(size=A.shape), b + sigma * rng.normal(size=rows), x


def test_plain_tls_is_the_closed_form():
    """x = (A'A - s^2 I)^-1 A'b with s the smallest singular value of [A b]."""
    A, b, _ = problem()
    smallest = np.linalg.svd(np.column_stack([A, b]), compute_uv=False)[-1]
    expected = np.linalg.solve(A.T @ A - smallest**2 * np.eye(3), A.T @ b)
    solution = total_least_squares(A, b)
    np.testing.assert_allclose(solution.x, expected, rtol=1e-10)
    assert solution.singular_values[-1] == pytest.approx(smallest, rel=1e-10)
    assert solution.sigma == pytest.approx(0.1, rel=0.2)


@pytest.mark.parametrize("noise", [np.ones(4), np.array([0.2, 0.05, 0.1, 0.3])])
def test_equals_odrpack_on_an_explicit_linear_model(noise):
    A, b, x = problem(1)
    fit = odr_fit(
        lambda a, beta: beta @ a,
        A.T.copy(),
        b,
        beta0=x,
        weight_x=1 / noise[:3] ** 2,
        weight_y=1 / noise[3] ** 2,
        partol=1e-14,
        sstol=1e-14,
        maxit=200,
    )
    np.testing.assert_allclose(total_least_squares(A, b, noise=noise).x, fit.beta, rtol=1e-6)


def test_covariance_agrees_with_odrpack_at_small_noise():
    A, b, x = problem(2, rows=2000, sigma=0.01)
    fit = odr_fit(lambda a, beta: beta @ a, A.T.copy(), b, beta0=x)
    np.testing.assert_allclose(total_least_squares(A, b).standard_deviation, fit.sd_beta, rtol=0.01)


def test_all_columns_exact_is_least_squares():
    A, b, _ = problem(3)
    solution = total_least_squares(A, b, exact=range(3))
    expected, residual, *_ = np.linalg.lstsq(A, b, rcond=None)
    np.testing.assert_allclose(solution.x, expected, rtol=1e-10)
    variance = residual[0] / (len(b) - 3)
    np.testing.assert_allclose(solution.covariance, variance * np.linalg.inv(A.T @ A), rtol=1e-9)


def test_mixed_columns_are_the_constrained_eigenproblem():
    """Exact columns projected out, plain TLS on the rest, then least squares for them."""
    A, b, _ = problem(4)
    e = A[:, [1]]
    project = np.eye(len(b)) - e @ np.linalg.pinv(e)
    rest = total_least_squares(project @ A[:, [0, 2]], project @ b)
    first = np.linalg.lstsq(e, b - A[:, [0, 2]] @ rest.x, rcond=None)[0]
    solution = total_least_squares(A, b, exact=[1])
    np.testing.assert_allclose(solution.x, [rest.x[0], first[0], rest.x[1]], rtol=1e-9)
    zero = total_least_squares(A, b, noise=np.array([1.0, 0.0, 1.0, 1.0]))
    np.testing.assert_allclose(zero.x, solution.x, rtol=1e-12)
    np.testing.assert_allclose(zero.covariance, solution.covariance, rtol=1e-9)


def test_full_covariance_is_whitening_by_hand():
    A, b, _ = problem(5)
    root = np.random.default_rng(5).normal(size=(4, 4)) + 2 * np.eye(4)
    C = root @ root.T
    L = np.linalg.cholesky(C)
    _, _, Vt = np.linalg.svd(np.linalg.solve(L, np.column_stack([A, b]).T).T)
    z = np.linalg.solve(L.T, Vt[-1])
    np.testing.assert_allclose(total_least_squares(A, b, noise=C).x, -z[:3] / z[3], rtol=1e-9)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.permutations(range(3)), st.lists(st.floats(-6, 6), min_size=4, max_size=4))
def test_units_and_order_do_not_matter(seed, order, exponents):
    """Scaling a column and its noise scales its unknown; permuting columns and rows permutes them."""
    A, b, _ = problem(seed, rows=40)
    scale = 10.0 ** np.array(exponents)
    noise = np.array([0.1, 0.2, 0.3, 0.15])
    base = total_least_squares(A, b, noise=noise)
    order = list(order)
    rows = np.random.default_rng(seed).permutation(len(b))
    moved = total_least_squares(
        (A * scale[:3])[rows][:, order],
        (b * scale[3])[rows],
        noise=(noise * scale)[[*order, 3]],
    )
    ratio = (scale[3] / scale[:3])[order]
    np.testing.assert_allclose(moved.x, base.x[order] * ratio, rtol=1e-6, atol=1e-9 * np.abs(ratio).max())
    np.testing.assert_allclose(moved.standard_deviation, base.standard_deviation[order] * ratio, rtol=1e-6)
    assert moved.sigma == pytest.approx(base.sigma, rel=1e-8)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 6), st.booleans())
def test_recovers_exactly_without_noise(seed, columns, one_exact):
    A, b, x = problem(seed, rows=50, sigma=0.0, columns=columns)
    solution = total_least_squares(A, b, exact=[0] if one_exact else ())
    np.testing.assert_allclose(solution.x, x, atol=1e-10 * (1 + np.abs(x).max()))


def test_consistent_where_least_squares_is_biased():
    rng = np.random.default_rng(7)
    rows = 100_000
    A = rng.normal(size=(rows, 3))
    b = A @ X + 0.5 * rng.normal(size=rows)
    A = A + 0.5 * rng.normal(size=A.shape)
    least_squares = np.linalg.lstsq(A, b, rcond=None)[0]
    solution = total_least_squares(A, b)
    assert np.abs(least_squares - X).max() > 0.3
    assert np.all(np.abs(solution.x - X) < 4 * solution.standard_deviation)
    assert solution.standard_deviation.max() < 0.01


@pytest.mark.parametrize(
    "noise",
    [np.array([0.02, 0.01, 0.03, 0.02]), np.array([0.4, 0.3, 0.0, 0.5])],
    ids=["small", "large, one exact column"],
)
def test_covariance_agrees_with_monte_carlo(noise):
    rng = np.random.default_rng(8)
    A0 = rng.normal(size=(300, 3)) * [1, 2, 3] + [1, 0, 1]
    runs = []
    for _ in range(1500):
        A = A0 + noise[:3] * rng.normal(size=A0.shape)
        runs.append(total_least_squares(A, A0 @ X + noise[3] * rng.normal(size=300), noise=noise))
    actual = np.cov(np.array([run.x for run in runs]).T)
    stated = np.mean([run.covariance for run in runs], axis=0)
    np.testing.assert_allclose(np.diag(stated), np.diag(actual), rtol=0.15)
    scale = np.sqrt(np.outer(np.diag(actual), np.diag(actual)))
    np.testing.assert_allclose(stated / scale, actual / scale, atol=0.1)
    assert np.mean([run.sigma for run in runs]) == pytest.approx(1.0, rel=0.01)


def test_covariance_with_correlated_errors_agrees_with_monte_carlo():
    rng = np.random.default_rng(9)
    root = 0.15 * (rng.normal(size=(4, 4)) + np.eye(4))
    C = root @ root.T
    A0 = rng.normal(size=(300, 3)) + 0.5
    runs = []
    for _ in range(1500):
        rows = np.column_stack([A0, A0 @ X]) + rng.normal(size=(300, 4)) @ root.T
        runs.append(total_least_squares(rows[:, :3], rows[:, 3], noise=C))
    actual = np.cov(np.array([run.x for run in runs]).T)
    stated = np.mean([run.covariance for run in runs], axis=0)
    np.testing.assert_allclose(np.diag(stated), np.diag(actual), rtol=0.15)


def test_a_million_rows():
    A, b, x = problem(10, rows=1_000_000, columns=4)
    solution = total_least_squares(A, b)
    assert np.all(np.abs(solution.x - x) < 5 * solution.standard_deviation)


def test_rank_deficiency_names_the_null_direction():
    A, b, _ = problem(11)
    A = np.column_stack([A, 1e4 * (A[:, 0] - 2 * A[:, 1])])
    with pytest.raises(NotIdentifiableError, match="m_s") as caught:
        total_least_squares(A, b, names=["m", "m_s", "k", "b"])
    null = caught.value.evidence["null_direction"]
    np.testing.assert_allclose(A @ null, 0, atol=1e-8)
    assert np.linalg.norm(null) == pytest.approx(1.0)


def test_rank_deficiency_in_a_mixed_problem_names_the_null_direction():
    A, b, _ = problem(12)
    A[:, 2] = 3 * A[:, 0]
    with pytest.raises(NotIdentifiableError) as caught:
        total_least_squares(A, b, exact=[2], noise=np.array([0.1, 0.2, 0.0, 1.0]))
    np.testing.assert_allclose(A @ caught.value.evidence["null_direction"], 0, atol=1e-10)


def test_nongeneric_problem_is_refused():
    """The weakest direction of [A b] does not touch b: no finite x brings it to zero."""
    A = np.array([[1.0, 0.0], [0.0, 0.01], [0.0, 0.0]])
    with pytest.raises(NotIdentifiableError, match="nongeneric") as caught:
        total_least_squares(A, np.array([1.0, 0.0, 1.0]))
    np.testing.assert_allclose(np.abs(caught.value.evidence["null_direction"]), [0, 1], atol=1e-12)


def test_not_finite_names_the_row():
    A, b, _ = problem(13)
    b[17] = np.nan
    with pytest.raises(NotIdentifiableError) as caught:
        total_least_squares(A, b)
    assert caught.value.evidence["rows"].tolist() == [17]


def test_too_few_rows():
    with pytest.raises(NotIdentifiableError, match="3 equations"):
        total_least_squares(np.eye(3), np.ones(3))


@pytest.mark.parametrize(
    "kwargs",
    [
        {"noise": np.ones(3)},
        {"noise": np.array([1.0, 1.0, 1.0, 0.0])},
        {"noise": -np.eye(4)},
        {"exact": [3]},
        {"names": ["a"]},
    ],
)
def test_wrong_arguments_are_refused(kwargs):
    A, b, _ = problem(14)
    with pytest.raises(SmsidError):
        total_least_squares(A, b, **kwargs)


def test_wrong_shapes_are_refused():
    with pytest.raises(SmsidError):
        total_least_squares(np.ones((5, 2)), np.ones(4))


def test_accumulating_blocks_is_one_factor():
    A, b, _ = problem(15)
    whole = accumulate(np.zeros((4, 4)), A, b)
    parts = accumulate(accumulate(np.zeros((4, 4)), A[:3], b[:3]), A[3:], b[3:])
    np.testing.assert_allclose(whole.T @ whole, parts.T @ parts, rtol=1e-12)
