"""What sensor noise makes of the equations of momentum, read from a recording itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from smsid.identify.momentum_rows import CORRELATION_TIME
from smsid.identify.paper.noise_replicates import small_sample_factor
from smsid.identify.robust import hac_covariance


@dataclass(frozen=True)
class RowErrors:
    """What sensor noise makes of the equations, read from the first window of a recording.

    ``weights`` (6,) bring the kinds of equation to errors of one, ``scale`` (n,) the columns to one length;
    ``noise`` (n + 1, n + 1) is the covariance of a scaled row, made as much larger as its correlation in time
    costs.
    """

    weights: np.ndarray
    scale: np.ndarray
    noise: np.ndarray


def row_errors(rows: np.ndarray, rhs: np.ndarray, moved: np.ndarray, x: np.ndarray, step: float) -> RowErrors:
    """Return weights, scales and noise of equations rows (N, 6, n), rhs (N, 6).

    ``moved`` (N, 6, n + 1) is what noise once more changes of [rows rhs], ``x`` (n,) roughly the unknowns,
    ``step`` [s] the sampling time.
    """
    error = moved @ np.append(x, -1.0)
    size = np.sqrt(np.mean(error**2, axis=0))
    weights = 1.0 / np.maximum(size, 1e-9 * size.max())
    weighted, n = rows * weights[:, None], rows.shape[2]
    length = np.linalg.norm(weighted.reshape(-1, n), axis=0)
    scale = np.maximum(length, 1e-9 * length.max()) / np.linalg.norm(rhs * weights)
    own = moved * weights[:, None]
    own[:, :, :-1] /= scale
    own = own.reshape(-1, n + 1)
    covariance = own.T @ own / len(own)
    lags = max(1, round(CORRELATION_TIME / step))
    scaled = (weighted / scale).reshape(-1, n)
    flat = (error * weights).reshape(-1)
    late, white = (np.diag(hac_covariance(scaled, flat, len(rows), k)) for k in (lags, 0))
    noise = max(1.0, float(np.median(late / white))) * covariance
    return RowErrors(weights, scale, noise + 1e-12 * np.trace(noise) * np.eye(n + 1))


def variance_factor(covariance: np.ndarray, moves: Sequence[np.ndarray]) -> float:
    """Return by how much larger a covariance (m, m) noise once more shows it to be, at least one.

    Errors of the slosh state stay for its period and look like motion; residuals do not show them, the
    ``moves`` (each (m,)) that the same noise makes do.
    """
    z = np.array(moves) / np.sqrt(np.diag(covariance))
    return max(1.0, float(np.mean(z**2)) * small_sample_factor(len(moves)) ** 2)
