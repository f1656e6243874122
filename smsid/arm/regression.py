"""Least squares over joints of different noise, with errors that are correlated in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from smsid.errors import NotIdentifiableError
from smsid.identify.robust import hac_covariance

ROUNDS = 10
SETTLED = 1e-3


@dataclass(frozen=True)
class JointRegression:
    """Solution of torque = rows x.

    ``x`` (n,), ``covariance`` (n, n), ``noise`` (joints,) standard deviation of the residual of each joint
    [N m], ``lags`` the number of samples over which the residual is correlated, ``condition`` of the scaled
    weighted rows.
    """

    x: np.ndarray
    covariance: np.ndarray
    noise: np.ndarray
    lags: int
    condition: float

    @property
    def sigma(self) -> np.ndarray:
        """Standard deviations (n,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


def solve_joints(rows: np.ndarray, torque: np.ndarray) -> JointRegression:
    """Weighted least squares with one weight per joint, found with it; covariance after Newey and West.

    Friction that the model lacks is no white noise: the residual stays correlated over a fraction of a
    second, and the covariance allows for it up to the first lag at which the correlation is gone.

    Args:
        rows: (N, joints, n).
        torque: (N, joints) [N m].

    Raises:
        NotIdentifiableError: fewer equations than unknowns, or columns that depend on each other.

    Source: Gautier (1997), *Dynamic identification of robots with power model*, for the weights.
    """
    samples, joints, n = rows.shape
    if samples * joints <= n:
        raise NotIdentifiableError(
            f"{samples * joints} equations for {n} unknowns.", advice="Record longer.", samples=samples
        )
    scale = np.linalg.norm(rows, axis=(0, 1))
    if not scale.min() > 0.0:
        raise NotIdentifiableError(
            "A parameter does not enter at all.", advice="Excite its joint.", column=int(scale.argmin())
        )
    # One triangle per joint holds all that its equations say; the rounds only weight the triangles anew.
    triangles = [
        np.linalg.qr(np.column_stack([rows[:, j] / scale, torque[:, j]]), mode="r") for j in range(joints)
    ]
    noise = np.maximum(np.sqrt(np.mean(torque**2, axis=0)), 1e-12)
    for _ in range(ROUNDS):
        stacked = np.vstack([r / s for r, s in zip(triangles, noise, strict=True)])
        column = np.linalg.norm(stacked[:, :-1], axis=0)
        y, _, rank, singular = np.linalg.lstsq(stacked[:, :-1] / column, stacked[:, -1], rcond=1e-10)
        if rank < n:
            raise NotIdentifiableError(
                f"Only {rank} of {n} combinations are excited.",
                advice="Move the joints through more configurations, rates and accelerations.",
                rank=int(rank),
            )
        x = y / column / scale
        residual = torque - rows @ x
        before, noise = noise, np.maximum(np.sqrt(np.mean(residual**2, axis=0)), 1e-12)
        if np.all(np.abs(noise - before) <= SETTLED * before):
            break
    white = residual / noise
    lags = correlation_lags(white)
    covariance = hac_covariance((rows / noise[:, None]).reshape(-1, n), white.ravel(), samples, lags)
    return JointRegression(x, covariance, noise, lags, float(singular[0] / singular[-1]))


def correlation_lags(residual: np.ndarray, *, level: float = 0.05) -> int:
    """Return the first lag at which the mean autocorrelation of residual (N, k) falls below ``level``.

    At most a tenth of the record.
    """
    x = residual - residual.mean(axis=0)
    samples = len(x)
    size = 2 ** int(np.ceil(np.log2(2 * samples)))
    spectrum = np.abs(np.fft.rfft(x, size, axis=0)) ** 2
    correlation = np.fft.irfft(spectrum, axis=0)[: samples // 10 + 1]
    mean = np.mean(correlation / np.maximum(correlation[0], 1e-300), axis=1)
    below = np.flatnonzero(mean < level)
    return int(below[0]) if below.size else samples // 10
