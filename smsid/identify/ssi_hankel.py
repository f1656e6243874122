"""What the subspace methods share: block Hankel matrices, and poles from an observability matrix."""

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
