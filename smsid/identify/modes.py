"""Poles of a subspace model, and the modes read from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # loads a part of it when that is used

from smsid._short_repr import short_repr
from smsid.effects.appendage import Appendage, ModalAppendage
from smsid.effects.appendage import Mode as DescribedMode


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
class IdentifiedMode:
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


SAME_MODE = 2.0  # ratio of frequencies, stiffness off by a factor of four, up to which a mode is recognised
IN_TUNE = 0.05  # relative, within which frequencies keep the ratios that are described
FAR = 5.0  # factor by which all frequencies together may be off


def match_modes(found: Sequence[IdentifiedMode], described: Sequence[DescribedMode]) -> dict[int, int]:
    """Return which found mode (value) is which described one (key): nearest in the logarithm of frequency.

    A described mode that none is found within `SAME_MODE` of stays unmatched; it does not push the others on.
    Where a common factor on all described frequencies, as a wrong stiffness gives, brings more of them in
    tune than are near as they are, it is taken.
    """
    if not found or not described:
        return {}
    log = [np.log([m.frequency for m in x]) for x in (described, found)]
    apart = log[1][None, :] - log[0][:, None]
    best = _nearest(apart, np.log(SAME_MODE))
    for off in sorted(apart.ravel(), key=abs):
        other = _nearest(apart - off, IN_TUNE)
        if abs(off) < np.log(FAR) and len(other) > len(best):
            best = other
    return best


def _nearest(apart: np.ndarray, limit: float) -> dict[int, int]:
    """Return pairs of rows and columns of least distances ``apart`` (n, m), none beyond the limit."""
    size = np.minimum(np.abs(apart), limit)
    rows, columns = scipy.optimize.linear_sum_assignment(size)
    return {int(k): int(j) for k, j in zip(rows, columns, strict=True) if size[k, j] < limit}


def identified_modes(
    appendage: Appendage,
    factor: float,
    modes: Sequence[IdentifiedMode],
    described: Sequence[DescribedMode] | None = None,
) -> ModalAppendage:
    """Return an appendage as modal data with identified frequencies and damping, its mass times ``factor``.

    Participation factors scale with the root of the mass, mass-normalised shapes with one over it.
    ``described`` are the modes there are, where other effects say something of them; else its own.
    """
    data = list(appendage.modal_data() if described is None else described)
    for k, j in match_modes(modes, data).items():
        found = {"frequency": modes[j].frequency, "damping": max(modes[j].damping, 0.0)}
        data[k] = data[k].model_copy(update=found)
    return appendage.as_modal(factor, data)
