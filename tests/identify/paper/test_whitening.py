"""The inverse of polynomials in the trapezoid integral against dense matrices."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.identify.paper._translation import integrals
from smsid.identify.paper._translation_tied import LEAST_DAMPING, sections_of, whiten, whiten_transposed

STEP, N = 0.1, 60
SECTIONS = [(0.3, 2.0), (0.05, 0.7)]


def operator() -> np.ndarray:
    """prod (1 + beta I + kappa I^2) as a matrix (N, N), I the cumulative trapezoid."""
    t = STEP * np.arange(N)
    integral = np.column_stack([integrals(e, t, 1)[1] for e in np.eye(N)])
    total = np.eye(N)
    for beta, kappa in SECTIONS:
        total = total @ (np.eye(N) + beta * integral + kappa * integral @ integral)
    return total


def test_inverts_the_trapezoids_exactly():
    x = np.random.default_rng(0).standard_normal((N, 3))
    np.testing.assert_allclose(operator() @ whiten(x, STEP, SECTIONS), x, atol=1e-11)
    one = whiten(x[:, 0], STEP, SECTIONS)
    np.testing.assert_allclose(one, whiten(x, STEP, SECTIONS)[:, 0], rtol=1e-12)


def test_transposed_but_for_the_first_sample():
    """The first sample differs by a share of the order of beta times the step."""
    rows = np.random.default_rng(1).standard_normal((2, N))
    expected = np.linalg.solve(operator().T, rows.T).T
    found = whiten_transposed(rows, STEP, SECTIONS)
    np.testing.assert_allclose(found[:, 1:], expected[:, 1:], atol=1e-11)
    assert np.abs(found - expected).max() < 0.1 * np.abs(expected).max()


def test_whitening_takes_out_what_the_integrals_put_in():
    """White noise through Q / s^2 comes back as itself."""
    noise = np.random.default_rng(2).standard_normal(N)
    np.testing.assert_allclose(whiten(operator() @ noise, STEP, SECTIONS), noise, atol=1e-10)


def test_sections_multiply_to_the_polynomial():
    q = np.convolve([1.0, 0.3, 2.0], [1.0, 0.05, 0.7])
    found = sorted(sections_of(q), key=lambda s: -s[1])
    np.testing.assert_allclose(found, SECTIONS, rtol=1e-12)


@pytest.mark.parametrize(
    ("polynomial", "section"),
    [
        ([1.0, -0.3, 2.0], (0.3, 2.0)),  # unstable: mirrored
        ([1.0, 0.0, 4.0], (2 * LEAST_DAMPING * 2.0, 4.0)),  # undamped
        ([1.0, 5.0, 6.0], (5.0, 6.0)),  # real roots -2 and -3
        ([1.0, 1.0, -6.0], (5.0, 6.0)),  # real roots 2 and -3
    ],
)
def test_sections_are_stable(polynomial, section):
    np.testing.assert_allclose(sections_of(np.array(polynomial)), [section], rtol=1e-12)
