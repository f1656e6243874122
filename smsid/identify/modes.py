"""Poles of a subspace model, and the modes read from them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from smsid._short_repr import short_repr


@short_repr
@dataclass(frozen=True)
class Poles:
    """Oscillatory poles of the model of one order, ascending in frequency; one of each conjugate pair.

    Attributes:
        order: number of states of the model.
        values: (k,) continuous-time poles [rad/s], positive imaginary part.
        shapes: (k, l) complex mode shapes at the outputs, unit length.
        contributions: (k,) share of the covariance carried by each pole, between 0 and 1 for well-separated
            poles.
    """

    order: int
    values: np.ndarray
    shapes: np.ndarray
    contributions: np.ndarray

    @property
    def frequency(self) -> np.ndarray:
        """(k,) undamped natural frequency |pole| / 2 pi [Hz]."""
        return np.abs(self.values) / (2 * np.pi)

    @property
    def damping(self) -> np.ndarray:
        """(k,) damping ratio -Re(pole) / |pole|."""
        return -self.values.real / np.abs(self.values)


@short_repr
@dataclass(frozen=True)
class Mode:
    """A mode that stays the same over model orders; values are medians over those orders.

    Attributes:
        frequency: undamped natural frequency [Hz].
        damping: damping ratio.
        shape: (l,) real mode shape at the outputs, largest component 1.
        frequency_order_spread: standard deviation of the frequency over model orders [Hz]. A placeholder for
            the uncertainty: it shows sensitivity to the order, not to the noise of the record.
        damping_order_spread: the same of the damping ratio.
        contribution: share of the covariance of the outputs the mode carries.
        orders: number of model orders it was found in.
        rate: sampling rate it was read at [Hz], after decimation.
    """

    frequency: float
    damping: float
    shape: np.ndarray
    frequency_order_spread: float
    damping_order_spread: float
    contribution: float
    orders: int
    rate: float


def mac(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Modal assurance criterion between every row of ``a`` (p, l) and of ``b`` (q, l): (p, q), in [0, 1].

    Source: Allemang and Brown (1982). Twin: `pyoma2.functions.gen.MAC` (columns there, rows here).
    """
    a, b = np.atleast_2d(a), np.atleast_2d(b)
    scale = np.outer(np.sum(np.abs(a) ** 2, axis=1), np.sum(np.abs(b) ** 2, axis=1))
    return np.abs(a.conj() @ b.T) ** 2 / scale


def real_shape(shapes: np.ndarray) -> np.ndarray:
    """Real (l,) shape closest to all rows of complex ``shapes`` (p, l), largest component 1."""
    # A mode shape is known up to a complex factor, so the average is taken over the projectors.
    unit = shapes / np.linalg.norm(shapes, axis=1, keepdims=True)
    _, vectors = np.linalg.eigh((unit.T @ unit.conj()).real)
    shape = vectors[:, -1]
    return shape / shape[np.argmax(np.abs(shape))]
