"""Total least squares of a stream of equations, in bounded memory, with previously known parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg

from smsid.errors import NotIdentifiableError, SmsidError
from smsid.identify._tls import BLOCK_ROWS, TlsSolution, accumulate, error_covariance, solve_factor


class RecursiveTls:
    """Total least squares updated row by row or block by block.

    Keeps the (n + 1, n + 1) triangular factor of ``[A b]`` only. After the same rows, in any chunking, the
    solution is that of `total_least_squares` to round-off; with a prior, that of the rows preceded by
    `prior_rows`. Use it when equations arrive over time, do not fit in memory, or when parameters are known
    already (the "initial guess" of the paper's recursive TLS, end of section III).

    Args:
        n: number of unknowns.
        prior_mean: (n,) previously known parameters. Needs ``prior_covariance``.
        prior_covariance: (n, n) how well they are known.
        noise: as in `total_least_squares`; absolute if there is a prior, which is weighed against it.
        exact: columns of the regressor free of error.
        names: (n,) names of the unknowns, for messages.
        forgetting: weight of an equation relative to the next one, in (0, 1]; the memory is
            ``1 / (1 - forgetting)`` equations. The prior is forgotten too.

    Raises:
        SmsidError: shapes do not fit, half a prior, or ``forgetting`` outside (0, 1].
    """

    def __init__(
        self,
        n: int,
        prior_mean: np.ndarray | None = None,
        prior_covariance: np.ndarray | None = None,
        *,
        noise: np.ndarray | None = None,
        exact: Sequence[int] = (),
        names: Sequence[str] | None = None,
        forgetting: float = 1.0,
    ) -> None:
        if not 0.0 < forgetting <= 1.0:
            raise SmsidError(f"forgetting = {forgetting} is outside (0, 1].")
        if (prior_mean is None) != (prior_covariance is None):
            raise SmsidError("A prior needs both prior_mean and prior_covariance.")
        error_covariance(n, noise, exact)
        self._n = n
        self._noise = noise
        self._exact = tuple(exact)
        self._names = names
        self._forgetting = forgetting
        self._factor = np.zeros((n + 1, n + 1))
        self._rows = 0.0
        if prior_mean is not None and prior_covariance is not None:
            A, b = prior_rows(prior_mean, prior_covariance, noise=noise, exact=exact)
            self._factor = accumulate(self._factor, A, b)
            self._rows = float(n)

    @property
    def rows(self) -> float:
        """Effective number of equations taken in, those of the prior included."""
        return self._rows

    def update(self, rows: np.ndarray, rhs: np.ndarray | float) -> RecursiveTls:
        """Take in more equations; returns itself.

        Args:
            rows: (k, n) or (n,) regressor rows, oldest first.
            rhs: (k,) or scalar right-hand side.

        Raises:
            SmsidError: shapes do not fit.
            NotIdentifiableError: a value is not finite; nothing is taken in.
        """
        A = np.atleast_2d(np.asarray(rows, float))
        b = np.atleast_1d(np.asarray(rhs, float))
        if A.ndim != 2 or A.shape[1] != self._n or b.shape != A.shape[:1]:
            raise SmsidError(f"rows {A.shape} and rhs {b.shape} do not fit {self._n} unknowns.")
        factor, count = self._factor, self._rows
        for start in range(0, len(b), BLOCK_ROWS):
            a, r = A[start : start + BLOCK_ROWS], b[start : start + BLOCK_ROWS]
            weights = None
            if self._forgetting < 1.0:
                weights = self._forgetting ** (0.5 * np.arange(len(r) - 1, -1, -1))
                factor = factor * self._forgetting ** (0.5 * len(r))
                count = count * self._forgetting ** len(r) + float(weights @ weights)
            else:
                count += len(r)
            factor = accumulate(factor, a, r, weights)
        self._factor, self._rows = factor, count
        return self

    def solution(self) -> TlsSolution:
        """Estimate from everything taken in so far.

        Raises `NotIdentifiableError` before the first equation, and as `total_least_squares` does.
        """
        if not self._rows:
            raise NotIdentifiableError("No equations yet.", advice="Call update() first, or give a prior.")
        return solve_factor(self._factor, self._rows, exact=self._exact, noise=self._noise, names=self._names)


def prior_rows(
    mean: np.ndarray, covariance: np.ndarray, *, noise: np.ndarray | None = None, exact: Sequence[int] = ()
) -> tuple[np.ndarray, np.ndarray]:
    """A Gaussian prior as n equations ``A x ~ b`` for total least squares: (n, n) and (n,).

    The rows are whitened by the covariance and scaled by ``sqrt(z'Cz)`` at ``z = [mean; -1]``, C the error
    covariance of a row: total least squares divides squared residuals by that, so the prior keeps its weight.

    Args:
        mean: (n,) prior mean.
        covariance: (n, n) prior covariance, positive definite.
        noise: absolute errors of an ordinary row, as in `total_least_squares`.
        exact: columns of the regressor free of error.

    Raises:
        SmsidError: shapes do not fit, or the covariance is not positive definite.
    """
    m, P = np.asarray(mean, float), np.asarray(covariance, float)
    n = m.size
    if m.shape != (n,) or P.shape != (n, n):
        raise SmsidError(f"Prior mean {m.shape} and covariance {P.shape} do not fit.")
    try:
        root = np.linalg.cholesky(P)
    except np.linalg.LinAlgError as error:
        raise SmsidError("The prior covariance is not positive definite.", covariance=P) from error
    z = np.r_[m, -1.0]
    scale = np.sqrt(z @ error_covariance(n, noise, exact) @ z)
    A = scale * scipy.linalg.solve_triangular(root, np.eye(n), lower=True)
    return A, A @ m
