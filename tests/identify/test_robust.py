"""Standard errors with correlated errors, and noise levels, against what they are made from."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.identify.robust import hac_covariance, inverse_root, white_sigma


def moving_average(rng: np.random.Generator, samples: int, width: int) -> np.ndarray:
    return np.convolve(rng.standard_normal(samples + width - 1), np.ones(width) / np.sqrt(width), "valid")


@pytest.mark.parametrize("width", [1, 10])
def test_against_monte_carlo(width: int):
    """Errors correlated over 10 samples: white standard errors would be 3 times too small."""
    rng = np.random.default_rng(0)
    t = np.linspace(0, 1, 2000)
    rows = np.column_stack([np.ones_like(t), np.sin(9 * t)])
    found, predicted = [], []
    for _ in range(300):
        e = moving_average(rng, len(t), width)
        x = np.linalg.lstsq(rows, e, rcond=None)[0]
        found.append(x)
        predicted.append(np.diag(hac_covariance(rows, e - rows @ x, len(t), 4 * width)))
    ratio = np.sqrt(np.mean(predicted, axis=0)) / np.std(found, axis=0)
    np.testing.assert_allclose(ratio, 1.0, atol=0.2)  # Bartlett's weights take off a tenth at 4 widths


def test_without_lags_it_is_whites_sandwich():
    rng = np.random.default_rng(1)
    rows, e = rng.standard_normal((500, 3)), rng.standard_normal(500) * np.linspace(0.1, 3, 500)
    bread = np.linalg.inv(rows.T @ rows)
    expected = bread @ (rows.T * e**2) @ rows @ bread
    np.testing.assert_allclose(hac_covariance(rows, e, 500, 0), expected, rtol=1e-10)


def test_equations_of_one_sample_count_as_correlated():
    """Three equal equations per sample say no more than one."""
    rng = np.random.default_rng(2)
    rows, e = rng.standard_normal((400, 2)), rng.standard_normal(400)
    once = hac_covariance(rows, e, 400, 5)
    thrice = hac_covariance(np.repeat(rows, 3, axis=0), np.repeat(e, 3), 400, 5)
    np.testing.assert_allclose(thrice, once, rtol=1e-10)


def test_columns_of_any_unit():
    """Columns 1e9 apart: a plain inverse of the Gram matrix would be cut off."""
    rng = np.random.default_rng(3)
    rows = rng.standard_normal((50, 3))
    scale = np.array([1.0, 1e9, 1e-6])
    root = inverse_root(rows * scale)
    expected = np.linalg.inv(rows.T @ rows) / np.outer(scale, scale)
    np.testing.assert_allclose(root @ root.T, expected, rtol=1e-9)


@pytest.mark.parametrize("sigma", [1e-6, 0.3])
def test_noise_under_motion_and_steps(sigma: float):
    """Slow motion a million times the noise and a few steps do not count; 5000 samples tell 5 %."""
    rng = np.random.default_rng(4)
    t = np.arange(5000) / 100.0
    x = np.column_stack([np.sin(0.3 * t), np.where(t > 20, 40.0, -40.0)])
    found = white_sigma(x + sigma * rng.standard_normal(x.shape))
    np.testing.assert_allclose(found, sigma, rtol=0.05)


def test_no_noise_is_next_to_none():
    t = np.arange(2000) / 100.0
    assert white_sigma(np.sin(0.3 * t)) < 1e-7
