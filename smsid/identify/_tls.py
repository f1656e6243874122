"""Total least squares: linear regression with errors in the regressor as well as in the right-hand side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from smsid._short_repr import short_repr
from smsid.errors import NotIdentifiableError, SmsidError

EPS = float(np.finfo(float).eps)
BLOCK_ROWS = 16384


@short_repr
@dataclass(frozen=True)
class TlsSolution:
    """Estimate of ``x`` in ``A x ~ b`` with what is needed to judge it.

    Attributes:
        x: (n,) estimate.
        covariance: (n, n) first-order covariance of ``x``, scaled by the estimated ``sigma``.
        sigma: estimated scale of the errors; 1 when ``noise`` was given in absolute terms and the model is
            right.
        singular_values: (number of columns with errors + 1,) singular values, descending, of the noise-scaled
            ``[A b]`` left once the exact columns are eliminated. The last is the misfit.
        condition: condition number of the regressor, noise-scaled and its columns brought to unit length.
        rows: number of equations (effective number under forgetting).
        status: one sentence.
    """

    x: np.ndarray
    covariance: np.ndarray
    sigma: float
    singular_values: np.ndarray
    condition: float
    rows: float
    status: str

    @property
    def standard_deviation(self) -> np.ndarray:
        """(n,) square root of the diagonal of ``covariance``."""
        return np.sqrt(np.diag(self.covariance))


def total_least_squares(
    A: np.ndarray,
    b: np.ndarray,
    *,
    exact: Sequence[int] = (),
    noise: np.ndarray | None = None,
    names: Sequence[str] | None = None,
) -> TlsSolution:
    """Solve ``A x ~ b`` when the columns of ``A`` carry errors too.

    Mixed LS-TLS: the columns in ``exact`` are eliminated by QR, the rest is solved by SVD (Golub, Hoffman
    and Stewart 1987; Van Huffel and Vandewalle 1991, algorithms 3.1 and 3.2). Errors of unequal size or
    correlated along a row are whitened first (generalised TLS). With all columns exact this is
    `numpy.linalg.lstsq`; plain TLS equals `odrpack.odr_fit` with an explicit linear model and unit weights.
    Tall ``A`` is reduced block by block, so memory beyond ``A`` itself does not grow with N.

    Args:
        A: (N, n) regressor.
        b: (N,) right-hand side.
        exact: columns of ``A`` free of error.
        noise: errors of a row of ``[A b]``: (n + 1,) standard deviations, or (n + 1, n + 1) covariance. Only
            ratios matter to ``x``. A zero marks an exact column. Default: all equal to 1.
        names: (n,) names of the unknowns, for messages.

    Raises:
        NotIdentifiableError: too few rows, not finite, rank-deficient, or nongeneric (no TLS solution); names
            the null direction where there is one (evidence ``null_direction``, (n,)).
        SmsidError: shapes do not fit, or the noise is not a covariance.
    """
    A, b = np.asarray(A, float), np.asarray(b, float)
    if A.ndim != 2 or b.shape != A.shape[:1]:
        raise SmsidError(f"A {A.shape} and b {b.shape} do not fit: A must be (N, n), b (N,).")
    rows, n = A.shape
    factor = np.zeros((n + 1, n + 1))
    for start in range(0, rows, BLOCK_ROWS):
        part = slice(start, start + BLOCK_ROWS)
        factor = accumulate(factor, A[part], b[part])
    return solve_factor(factor, rows, exact=exact, noise=noise, names=names)


def accumulate(
    factor: np.ndarray, A: np.ndarray, b: np.ndarray, row_weights: np.ndarray | None = None
) -> np.ndarray:
    """Triangular factor of ``[A b]`` with more rows added (sequential QR).

    Args:
        factor: (n + 1, n + 1) upper triangular factor so far; zeros at the start.
        A: (k, n) new rows.
        b: (k,) new right-hand sides.
        row_weights: (k,) factor on each new row.

    Raises:
        NotIdentifiableError: a value is not finite; evidence ``rows``: their indices in this block.
    """
    block = np.column_stack([A, b])
    if row_weights is not None:
        block *= row_weights[:, None]
    bad = np.flatnonzero(~np.isfinite(block).all(axis=1))
    if bad.size:
        raise NotIdentifiableError(
            f"{bad.size} equations are not finite, the first in row {bad[0]} of its block.",
            advice="Remove gaps and NaN from the recording before building the regressor.",
            rows=bad,
        )
    return triangular(np.vstack([factor, block]))


def triangular(x: np.ndarray) -> np.ndarray:
    """Upper triangular factor R (k, n) of ``x = Q R`` (N, n), economic, k the smaller of N and n."""
    return np.asarray(np.linalg.qr(x, mode="r"))


def solve_factor(
    factor: np.ndarray,
    rows: float,
    *,
    exact: Sequence[int] = (),
    noise: np.ndarray | None = None,
    names: Sequence[str] | None = None,
) -> TlsSolution:
    """Mixed generalised TLS from the (n + 1, n + 1) triangular factor of ``[A b]`` for ``rows`` rows.

    The arguments and errors (`NotIdentifiableError`, `SmsidError`) are those of `total_least_squares`. The
    covariance is that of the consistent estimator, ``sigma^2 q (G^-1 + N sigma^2 G^-1 K G^-1)`` with
    ``z = [x; -1]``, ``q = z'Cz``, ``G = A'A - s_min^2 C_aa`` and ``K = C_aa - (Cz)_a (Cz)_a'/q`` (Gleser
    1981; Van Huffel and Vandewalle 1991, ch. 8; Crassidis and Cheng 2014, who drop the second term,
    negligible at small noise).
    """
    n = factor.shape[1] - 1
    labels = tuple(names) if names is not None else tuple(f"x[{k}]" for k in range(n))
    if len(labels) != n:
        raise SmsidError(f"{len(labels)} names for {n} unknowns.")
    if rows < n + 1:
        raise NotIdentifiableError(
            f"{rows:g} equations cannot identify {n} unknowns and the noise.",
            advice=f"Give at least {n + 1} equations.",
            rows=rows,
            unknowns=n,
        )
    C = error_covariance(n, noise, exact)
    fixed = np.flatnonzero(np.diag(C)[:n] == 0)
    noisy = np.setdiff1d(np.arange(n), fixed)
    k, p = fixed.size, noisy.size
    R = triangular(factor[:, np.r_[fixed, noisy, n]])
    L = np.linalg.cholesky(C[np.ix_(np.r_[noisy, n], np.r_[noisy, n])])
    W = scipy.linalg.solve_triangular(L, R[k:, k:].T, lower=True).T

    tolerance = EPS * max(rows, n)
    scaled = np.hstack([R[:, :k], np.vstack([R[:k, k:] @ np.linalg.inv(L).T, W])[:, :p]])
    condition = _condition(scaled, L[:p, :p], np.r_[fixed, noisy], labels, tolerance)

    _, s, Vt = np.linalg.svd(W)
    v = Vt[-1]
    gap = s[-2] - s[-1] if p else np.inf
    if abs(v[-1]) * gap <= EPS * (p + 1) * s[0] and p:
        direction = np.zeros(n)
        direction[noisy] = scipy.linalg.solve_triangular(L.T, v, lower=False)[:-1]
        direction /= np.linalg.norm(direction) or 1.0
        raise NotIdentifiableError(
            f"Total least squares has no solution (nongeneric): noise hides {_name(direction, labels)}.",
            advice="Excite that combination more, or give the noise of each column if it is known.",
            null_direction=direction,
            names=labels,
            singular_values=s,
            last_component=float(v[-1]),
        )
    z = scipy.linalg.solve_triangular(L.T, v, lower=False)
    x_noisy = -z[:-1] / z[-1]
    x_fixed = (
        scipy.linalg.solve_triangular(R[:k, :k], R[:k, -1] - R[:k, k:-1] @ x_noisy) if k else np.zeros(0)
    )
    sigma = float(s[-1] / np.sqrt(rows - n))
    x = np.empty(n)
    x[fixed], x[noisy] = x_fixed, x_noisy
    return TlsSolution(
        x=x,
        covariance=_covariance(R, W, L, C, fixed, noisy, x, sigma, float(s[-1]), rows),
        sigma=sigma,
        singular_values=s,
        condition=condition,
        rows=rows,
        status=f"Solved: {n} unknowns ({k} exact columns), {rows:g} equations, condition {condition:.3g}.",
    )


def error_covariance(n: int, noise: np.ndarray | None, exact: Sequence[int] = ()) -> np.ndarray:
    """(n + 1, n + 1) covariance of the errors of a row of ``[A b]``; rows and columns of exact ones are zero.

    ``noise`` and ``exact`` as in `total_least_squares`.

    Raises:
        SmsidError: wrong shape, not positive, or a right-hand side without error.
    """
    given = np.ones(n + 1) if noise is None else np.asarray(noise, float)
    if given.shape not in ((n + 1,), (n + 1, n + 1)) or not np.all(np.isfinite(given)):
        raise SmsidError(f"noise {given.shape} must be finite and ({n + 1},) or ({n + 1}, {n + 1}).")
    if any(not -n <= j < n for j in exact):
        raise SmsidError(f"exact columns {tuple(exact)} are outside the {n} columns of A.")
    C = np.diag(given**2) if given.ndim == 1 else given.copy()
    columns = [j % n for j in exact]
    C[columns, :] = C[:, columns] = 0.0
    live = np.flatnonzero(np.diag(C) != 0)
    core = C[np.ix_(live, live)]
    dead = np.setdiff1d(np.arange(n + 1), live)
    if not np.allclose(C, C.T) or np.any(C[dead]) or np.any(np.linalg.eigvalsh(core) <= 0):
        raise SmsidError("noise must be a covariance: symmetric, positive definite.", noise=given)
    if C[n, n] == 0:
        raise SmsidError(
            "The right-hand side is given as free of error.",
            advice="Swap it with a column that has errors; total least squares needs b to carry some.",
        )
    return C


def _condition(
    scaled: np.ndarray, L: np.ndarray, order: np.ndarray, labels: Sequence[str], tolerance: float
) -> float:
    """Condition number of the columns at unit length, or the null direction as an error."""
    norms = np.linalg.norm(scaled, axis=0)
    safe = np.where(norms > 0, norms, 1.0)
    _, s, Vt = np.linalg.svd(scaled / safe)
    if s[-1] > tolerance * s[0]:
        return float(s[0] / s[-1])
    k = order.size - L.shape[0]
    direction = Vt[-1] / safe
    direction[k:] = scipy.linalg.solve_triangular(L.T, direction[k:], lower=False)
    physical = np.empty_like(direction)
    physical[order] = direction
    physical /= np.linalg.norm(physical)
    raise NotIdentifiableError(
        f"The regressor is rank-deficient: the data say nothing about {_name(physical, labels)}.",
        advice="Excite that combination, fix one of its parameters, or identify the combination only.",
        null_direction=physical,
        names=tuple(labels),
        singular_values=s,
    )


def _name(direction: np.ndarray, labels: Sequence[str]) -> str:
    """The null direction in words, without components a thousand times smaller than the largest."""
    largest = np.abs(direction).max() or 1.0
    keep = np.flatnonzero(np.abs(direction) > 1e-3 * largest).tolist()
    return " ".join(f"{direction[j]:+.3g} {labels[j]}" for j in keep)


def _covariance(
    R: np.ndarray,
    W: np.ndarray,
    L: np.ndarray,
    C: np.ndarray,
    fixed: np.ndarray,
    noisy: np.ndarray,
    x: np.ndarray,
    sigma: float,
    smallest: float,
    rows: float,
) -> np.ndarray:
    """Covariance as in `solve_factor`, without squaring the condition number of the regressor."""
    k, p, n = fixed.size, noisy.size, x.size
    z = np.r_[x, -1.0]
    q = float(z @ C @ z)
    total = np.zeros((n, n))
    spread = np.zeros((p, p))
    if p:
        _, s, Vt = np.linalg.svd(W[:, :p])
        inverse_root = scipy.linalg.solve_triangular(
            L[:p, :p].T, Vt.T / np.sqrt(s**2 - smallest**2), lower=False
        )
        inverse = inverse_root @ inverse_root.T
        shared = (C @ z)[noisy]
        K = C[np.ix_(noisy, noisy)] - np.outer(shared, shared) / q
        spread = sigma**2 * q * (inverse + rows * sigma**2 * inverse @ K @ inverse)
        total[np.ix_(noisy, noisy)] = spread
    if k:
        inverse = scipy.linalg.solve_triangular(R[:k, :k], np.eye(k))
        T = inverse @ R[:k, k:-1]
        total[np.ix_(fixed, fixed)] = sigma**2 * q * inverse @ inverse.T + T @ spread @ T.T
        total[np.ix_(fixed, noisy)] = -T @ spread
        total[np.ix_(noisy, fixed)] = -spread @ T.T
    return total
