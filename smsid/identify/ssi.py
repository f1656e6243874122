"""Output-only covariance-driven stochastic subspace identification (SSI-COV)."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from smsid.errors import NotIdentifiableError, SmsidError
from smsid.identify.modes import Poles


def signal_matrix(x: np.ndarray, name: str) -> np.ndarray:
    """``x`` as (N, channels), finite; a vector is one channel.

    Raises:
        NotIdentifiableError: a sample is not finite; evidence ``samples``: which.
        SmsidError: wrong number of dimensions.
    """
    x = np.asarray(x, float)
    x = x[:, None] if x.ndim == 1 else x
    if x.ndim != 2 or x.shape[1] == 0:
        raise SmsidError(f"{name} {x.shape} must be (N,) or (N, channels).")
    bad = np.flatnonzero(~np.isfinite(x).all(axis=1))
    if bad.size:
        raise NotIdentifiableError(
            f"{bad.size} samples of {name} are not finite, the first at index {bad[0]}.",
            advice="Cut the recording at the gap, or fill it, before identifying.",
            samples=bad,
        )
    return x


def block_hankel(x: np.ndarray, first: int, rows: int, columns: int) -> np.ndarray:
    """(rows * channels, columns) block Hankel matrix of ``x`` (N, channels), from sample ``first`` on."""
    windows = np.lib.stride_tricks.sliding_window_view(x[first : first + rows + columns - 1], columns, axis=0)
    return windows.reshape(rows * x.shape[1], columns)


def observability_poles(
    left: np.ndarray,
    singular: np.ndarray,
    right: np.ndarray,
    outputs: int,
    rate: float,
    orders: Iterable[int],
) -> tuple[Poles, ...]:
    """Poles for each order by shift invariance of the observability matrix.

    Args:
        left: (block rows * outputs, r) left singular vectors of the (projected) covariance matrix.
        singular: (r,) its singular values.
        right: (r, columns) its right singular vectors, transposed.
        outputs: number of outputs per block row.
        rate: sampling rate [Hz].
        orders: model orders.

    Source: Van Overschee and De Moor (1996), section 4.4; Peeters and De Roeck (1999), eqs. 20-24.
    """
    total = float(np.linalg.norm(singular)) or 1.0
    found = []
    for order in orders:
        gamma = left[:, :order]
        states = singular[:order, None] * right[:order]
        transition = np.linalg.lstsq(gamma[:-outputs], gamma[outputs:], rcond=None)[0]
        values, vectors = np.linalg.eig(transition)
        with np.errstate(divide="ignore"):
            poles = np.log(values.astype(complex)) * rate
        # The principal logarithm cannot tell a pole at the Nyquist frequency from its alias.
        keep = np.flatnonzero(
            (poles.imag > 0) & np.isfinite(poles) & (poles.imag < np.pi * rate * (1 - 1e-9))
        )
        keep = keep[np.argsort(np.abs(poles[keep]))]
        amplitude = np.linalg.norm(np.linalg.pinv(vectors)[keep] @ states, axis=1)
        modal = gamma @ vectors[:, keep]
        shapes = modal[:outputs].T
        size = np.linalg.norm(shapes, axis=1, keepdims=True)
        found.append(
            Poles(
                order=order,
                values=poles[keep],
                shapes=shapes / np.where(size > 0, size, 1.0),
                contributions=np.sqrt(2) * np.linalg.norm(modal, axis=0) * amplitude / total,
            )
        )
    return tuple(found)


def checked_orders(orders: Iterable[int], block_rows: int, outputs: int, columns: int) -> tuple[int, ...]:
    """``orders`` as a sorted tuple.

    Raises:
        SmsidError: an order exceeds what ``block_rows`` blocks of ``outputs`` and ``columns`` columns can
            carry.
    """
    chosen = tuple(sorted({int(order) for order in orders}))
    limit = min((block_rows - 1) * outputs, columns)
    if not chosen or chosen[0] < 1 or chosen[-1] > limit:
        raise SmsidError(
            f"Model orders {chosen} must lie between 1 and {limit}.",
            advice="Ask for lower orders or for more block rows.",
            orders=chosen,
            limit=limit,
        )
    return chosen


def check_columns(columns: int, needed: int, samples: int, block_rows: int) -> None:
    """Refuse a record too short for its block rows.

    Raises:
        NotIdentifiableError: fewer than ``needed`` columns; evidence ``columns``, ``needed``, ``samples``.
    """
    if columns < needed:
        raise NotIdentifiableError(
            f"{samples} samples give {max(columns, 0)} columns for {block_rows} block rows; "
            f"{needed} are needed.",
            advice="Use fewer block rows or a longer recording.",
            columns=columns,
            needed=needed,
            samples=samples,
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
