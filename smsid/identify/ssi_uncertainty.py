"""SSI-COV with the covariance of frequencies, damping ratios and shapes, to first order.

The sample covariance of future and past is an average over the record; its own covariance shows in how it
scatters between segments. Each segment's deviation is carried, to first order, through singular vectors,
shift invariance and eigenvalues, and the squares of what arrives are summed: no covariance of the Hankel
matrix is ever formed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from smsid._short_repr import short_repr
from smsid.errors import NotIdentifiableError
from smsid.identify.modes import Poles
from smsid.identify.ssi_hankel import (
    block_hankel,
    check_columns,
    checked_orders,
    observability_poles,
    signal_matrix,
)

FEWEST = 8  # segments


@short_repr
@dataclass(frozen=True)
class UncertainPoles:
    """Poles of one order with their covariance.

    ``covariance`` (k, 2, 2) of frequency [Hz] and damping ratio. ``shapes`` (k, l) complex, each with its
    largest component one, ``shape_covariance`` (k, 2 l, 2 l) of their real, then imaginary parts.
    ``segments``: how many the covariance rests on.
    """

    poles: Poles
    covariance: np.ndarray
    shapes: np.ndarray
    shape_covariance: np.ndarray
    segments: int

    def interval(self, level: float = 0.95) -> tuple[np.ndarray, np.ndarray]:
        """Return intervals (k, 2) of frequency [Hz] and damping ratio, by Student's t of so many segments."""
        far = float(student.ppf(0.5 + level / 2.0, self.segments - 1))
        values = np.column_stack([self.poles.frequency, self.poles.damping])
        sigma = np.column_stack([self.frequency_sigma, self.damping_sigma])
        ends = values[..., None] + far * sigma[..., None] * np.array([-1.0, 1.0])
        return ends[:, 0], ends[:, 1]

    @property
    def frequency_sigma(self) -> np.ndarray:
        """(k,) standard deviations of the frequencies [Hz]."""
        return np.sqrt(self.covariance[:, 0, 0])

    @property
    def damping_sigma(self) -> np.ndarray:
        """(k,) standard deviations of the damping ratios."""
        return np.sqrt(self.covariance[:, 1, 1])


def ssi_cov_uncertain(
    y: np.ndarray,
    rate: float,
    *,
    block_rows: int,
    orders: Iterable[int],
    references: Sequence[int] | None = None,
    segments: int = 30,
) -> tuple[UncertainPoles, ...]:
    """Poles of the outputs alone with their covariance, for each model order.

    For a stationary record under lasting random excitation, each of the ``segments`` long against the slowest
    mode's memory. A free decay is not stationary: its segments differ by more than chance. Bias by a model
    order too low or too high is not part of the covariance.

    Args:
        y: (N,) or (N, l) outputs [any unit].
        rate: sampling rate [Hz].
        block_rows: number of block rows of past and of future.
        orders: model orders.
        references: outputs used for the past; default all.
        segments: into which the record is cut, at least 8.

    Raises:
        NotIdentifiableError: not finite, nothing but a constant, or too short for block rows and segments.
        SmsidError: shapes or orders do not fit.

    Source: Reynders, Pintelon and De Roeck, *Uncertainty bounds on modal parameters obtained from SSI*, MSSP
    22(4), 2008; Doehler and Mevel, *Efficient multi-order uncertainty computation for stochastic subspace
    identification*, MSSP 38(2), 2013. Twin: ``pyoma2.algorithms.SSI`` with ``calc_unc=True``.
    """
    y = signal_matrix(y, "y")
    samples, outputs = y.shape
    past = y if references is None else y[:, list(references)]
    columns = samples - 2 * block_rows + 1
    check_columns(columns, block_rows * past.shape[1], samples, block_rows)
    chosen = checked_orders(orders, block_rows, outputs, block_rows * past.shape[1])
    if segments < FEWEST or columns // segments < 2 * block_rows:
        raise NotIdentifiableError(
            f"{columns} columns cannot be cut into {segments} segments of at least {2 * block_rows}.",
            advice=f"Use a longer recording, fewer block rows, or fewer segments (at least {FEWEST}).",
            columns=columns,
            segments=segments,
        )
    ahead, behind = y - y.mean(axis=0), past - past.mean(axis=0)
    width = columns // segments
    parts = np.array(
        [
            block_hankel(ahead, k * width + block_rows, block_rows, width)
            @ block_hankel(behind, k * width, block_rows, width).T
            / width
            for k in range(segments)
        ]
    )
    total = parts.mean(axis=0)
    deviations = (parts - total) / np.sqrt(segments * (segments - 1))
    left, singular, right = np.linalg.svd(total, full_matrices=False)
    if not singular[0] > 0:
        raise NotIdentifiableError(
            "The outputs are constant: there is nothing to identify.",
            advice="Check the channel, or excite the structure.",
            samples=samples,
        )
    found = observability_poles(left, singular, right, outputs, rate, chosen)
    return tuple(_uncertain(p, left, singular, right, outputs, rate, deviations) for p in found)


def _uncertain(
    poles: Poles,
    left: np.ndarray,
    singular: np.ndarray,
    right: np.ndarray,
    outputs: int,
    rate: float,
    deviations: np.ndarray,
) -> UncertainPoles:
    n = poles.order
    gamma = left[:, :n]
    # the part of the change inside the space is a change of basis, which poles do not see
    moved = deviations @ (right[:n].T / singular[:n])
    moved = moved - gamma @ (gamma.T @ moved)
    up, down = gamma[:-outputs], gamma[outputs:]
    inverse = np.linalg.pinv(up)
    transition = inverse @ down
    change = inverse @ moved[:, outputs:] - inverse @ moved[:, :-outputs] @ transition
    normal = np.linalg.inv(up.T @ up)
    change = change + normal @ np.swapaxes(moved[:, :-outputs], 1, 2) @ (down - up @ transition)
    values, vectors = np.linalg.eig(transition)
    adjoint = np.linalg.inv(vectors)
    covariance = np.empty((len(poles.values), 2, 2))
    shapes = np.empty((len(poles.values), outputs), dtype=complex)
    spread = np.empty((len(poles.values), 2 * outputs, 2 * outputs))
    for k, pole in enumerate(poles.values):
        i = int(np.argmin(np.abs(np.exp(pole / rate) - values)))
        mixed = np.einsum("ja,sab,b->sj", adjoint, change, vectors[:, i])
        d_pole = mixed[:, i] / values[i] * rate
        along = (np.conj(pole) * d_pole).real / abs(pole)
        d_damping = -d_pole.real / abs(pole) + pole.real * along / abs(pole) ** 2
        both = np.column_stack([along / (2 * np.pi), d_damping])
        covariance[k] = both.T @ both
        gap = values[i] - values
        gap[i] = np.inf
        d_vector = (mixed / gap) @ vectors.T
        shape = gamma[:outputs] @ vectors[:, i]
        d_shape = moved[:, :outputs] @ vectors[:, i] + d_vector @ gamma[:outputs].T
        m = int(np.argmax(np.abs(shape)))
        shapes[k] = shape / shape[m]
        d_shape = (d_shape - shapes[k] * d_shape[:, m : m + 1]) / shape[m]
        parts = np.hstack([d_shape.real, d_shape.imag])
        spread[k] = parts.T @ parts
    return UncertainPoles(poles, covariance, shapes, spread, len(deviations))
