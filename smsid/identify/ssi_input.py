"""Covariance-driven subspace identification with a known input projected out."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from smsid.errors import NotIdentifiableError, SmsidError
from smsid.identify._tls import triangular
from smsid.identify.modes import Poles
from smsid.identify.ssi import (
    block_hankel,
    check_columns,
    checked_orders,
    observability_poles,
    signal_matrix,
)

CHUNK = 8192


def ssi_cov_input(
    y: np.ndarray, u: np.ndarray, rate: float, *, block_rows: int, orders: Iterable[int]
) -> tuple[Poles, ...]:
    """Poles from input to outputs, for each model order; direct feedthrough is allowed.

    With future outputs Y, future inputs U and past inputs and outputs Z, the matrix factored is

        S_yz|u  S_zz|u^(-1/2),    S_ab|u = S_ab - S_au S_uu^-1 S_ub,

    the covariance of future and past given the future input, past normalised: PO-MOESP. It is taken from the
    triangular factor of the joint sample covariance, so no covariance is ever squared or inverted, and chunk
    by chunk. Means are removed, so constant biases of either sensor have no effect.

    Which poles these are is decided by the choice of input: with the acceleration of a panel's root as input
    and the panel's acceleration relative to it as output they are those of the *clamped* panel, whatever the
    spacecraft under it does; with the thrust as input, the *coupled* ones.

    Args:
        y: (N,) or (N, l) outputs.
        u: (N,) or (N, m) inputs, at the same instants and filtered alike.
        rate: sampling rate [Hz].
        block_rows: number of block rows of past and of future.
        orders: model orders to try.

    Returns:
        One `Poles` per order, ascending.

    Raises:
        NotIdentifiableError: not finite, the outputs follow from the future input alone, or the record is
            too short: N - 2 block_rows + 1 columns must be at least 2 block_rows (l + m) rows.
        SmsidError: shapes or orders do not fit.

    Source: Verhaegen, *Identification of the deterministic part of MIMO state space models*, Automatica
    30(1), 1994; Katayama, *Subspace Methods for System Identification* (2005), ch. 6 (PO-MOESP) and 9
    (conditional covariances). Twin: ``pyoma2.algorithms.SSI`` with ``method="IOcov"``, which leaves the past
    inputs out and does not normalise the past.
    """
    y, u = signal_matrix(y, "y"), signal_matrix(u, "u")
    samples, outputs = y.shape
    inputs = u.shape[1]
    columns = samples - 2 * block_rows + 1
    if len(u) != samples:
        raise SmsidError(f"y has {samples} samples and u {len(u)}.", advice="Resample both alike.")
    check_columns(columns, 2 * block_rows * (outputs + inputs), samples, block_rows)
    chosen = checked_orders(orders, block_rows, outputs, block_rows * (outputs + inputs))

    y = (y - y.mean(axis=0)) / (y.std() or 1.0)
    u = (u - u.mean(axis=0)) / (u.std() or 1.0)
    factor = np.zeros((0, 1 + 2 * block_rows * (outputs + inputs)))
    for start in range(0, columns, CHUNK):
        width = min(CHUNK, columns - start)
        part = [
            np.ones((1, width)),
            block_hankel(u, start + block_rows, block_rows, width),
            block_hankel(y, start, block_rows, width),
            block_hankel(u, start, block_rows, width),
            block_hankel(y, start + block_rows, block_rows, width),
        ]
        factor = triangular(np.vstack([factor, np.vstack(part).T]))
    given = 1 + block_rows * inputs
    past = slice(given, given + block_rows * (outputs + inputs))
    projected = factor[past, past.stop :].T
    left, singular, right = np.linalg.svd(projected, full_matrices=False)
    floor = np.finfo(float).eps * np.sqrt(columns) * np.linalg.norm(factor[:, past.stop :])
    if not singular[0] > floor:
        raise NotIdentifiableError(
            "Nothing is left of the outputs once the known input is projected out.",
            advice="The outputs must remember the past: check that they are not a static copy of the input.",
            singular_values=singular,
            floor=floor,
        )
    return observability_poles(left, singular, right, outputs, rate, chosen)
