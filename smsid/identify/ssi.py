"""Output-only covariance-driven stochastic subspace identification (SSI-COV)."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from smsid.errors import NotIdentifiableError
from smsid.identify.modes import Poles
from smsid.identify.ssi_hankel import (
    block_hankel,
    check_columns,
    checked_orders,
    observability_poles,
    signal_matrix,
)

CHUNK = 20000


def ssi_cov(
    y: np.ndarray,
    rate: float,
    *,
    block_rows: int,
    orders: Iterable[int],
) -> tuple[Poles, ...]:
    """Poles of the outputs alone, for each model order.

    The matrix factored is the sample covariance between the future and the past of the outputs, kept as a
    block Hankel matrix of the record instead of averaging it into a block Toeplitz matrix of correlations:
    the two agree for a long stationary record, and this one is exact for a free response however short. Means
    are removed column-wise, so a constant sensor bias has no effect. The unknown excitation must be white or
    absent; a known one belongs in `ssi_cov_input`.

    Use it for the poles of the system as it is: on a free spacecraft, the *coupled* ones.

    Args:
        y: (N,) or (N, l) outputs [any unit].
        rate: sampling rate [Hz].
        block_rows: number of block rows of past and of future.
        orders: model orders to try, e.g. ``range(2, 22, 2)``.

    Returns:
        One `Poles` per order, ascending.

    Raises:
        NotIdentifiableError: not finite, nothing but a constant, or too short for ``block_rows``.
        SmsidError: shapes or orders do not fit.

    Source: Peeters and De Roeck, *Reference-based stochastic subspace identification for output-only modal
    analysis*, MSSP 13(6), 1999. Twin: ``pyoma2.algorithms.SSI`` with ``method="cov"``.
    """
    y = signal_matrix(y, "y")
    samples, outputs = y.shape
    columns = samples - 2 * block_rows + 1
    size = block_rows * outputs
    check_columns(columns, size, samples, block_rows)
    chosen = checked_orders(orders, block_rows, outputs, size)

    y = y - y.mean(axis=0)
    covariance, sums = np.zeros((size, size)), np.zeros((2, size))
    for start in range(0, columns, CHUNK):
        width = min(CHUNK, columns - start)
        ahead = block_hankel(y, start + block_rows, block_rows, width)
        behind = block_hankel(y, start, block_rows, width)
        covariance += ahead @ behind.T
        sums[0] += ahead.sum(axis=1)
        sums[1] += behind.sum(axis=1)
    covariance = covariance / columns - np.outer(sums[0], sums[1]) / columns**2
    left, singular, right = np.linalg.svd(covariance, full_matrices=False)
    if not singular[0] > 0:
        raise NotIdentifiableError(
            "The outputs are constant: there is nothing to identify.",
            advice="Check the channel, or excite the structure.",
            samples=samples,
        )
    return observability_poles(left, singular, right, outputs, rate, chosen)
