"""Covariance of a linear estimate when the equation errors are correlated in time."""

from __future__ import annotations

import numpy as np


def hac_covariance(rows: np.ndarray, residual: np.ndarray, samples: int, lags: int) -> np.ndarray:
    """Return the covariance (n, n) of least squares with errors correlated over up to ``lags`` samples.

    Newey and West (1987): ``G^-1 (sum_l w_l Gamma_l) G^-1`` with Bartlett weights. ``rows`` (samples * k, n)
    and ``residual`` (samples * k,) hold k equations per sample, sample by sample.
    """
    n = rows.shape[1]
    score = (rows * residual[:, None]).reshape(samples, -1, n).sum(axis=1)
    meat = score.T @ score
    for lag in range(1, min(lags, samples - 1) + 1):
        gamma = score[lag:].T @ score[:-lag]
        meat += (1.0 - lag / (lags + 1.0)) * (gamma + gamma.T)
    root = inverse_root(rows)
    return root @ (root.T @ meat @ root) @ root.T


def inverse_root(rows: np.ndarray) -> np.ndarray:
    """Return W (n, n) with W W' = (rows' rows)^-1, rows (N, n) of full rank, whatever the columns' units.

    By QR of the columns at unit length: the Gram matrix has their lengths and their condition number squared,
    and columns integrated four times are a million times longer than others.
    """
    length = np.linalg.norm(rows, axis=0)
    return np.linalg.solve(np.linalg.qr(rows / length, mode="r"), np.eye(rows.shape[1])) / length[:, None]


def white_sigma(x: np.ndarray) -> np.ndarray:
    """Return the standard deviation of the white part of slowly varying samples x (N, ...), per component.

    From the median of third differences, so that steps and smooth motion do not count.
    """
    d = np.diff(np.asarray(x, dtype=float), n=3, axis=0)
    return np.median(np.abs(d), axis=0) / 0.6744897501960817 / np.sqrt(20.0)
