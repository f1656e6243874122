"""How a search went: the sum of squares at every point it visited, all by the noise found at its end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from smsid.identify.estimate import Iteration
from smsid.likelihood.point import Evaluation
from smsid.likelihood.recording_term import RecordingTerm


@dataclass(frozen=True)
class Iterate:
    """A point of a search, as much of it as its cost at other noise levels needs.

    ``squares`` are the mean products r r^T (k, k) of the residuals by piece and channel, ``known`` is what
    priors and encoders add, ``step`` (size,) led here in the common parameters; ``None`` where a search
    starts.
    """

    squares: tuple[tuple[np.ndarray, ...], ...]
    known: float
    step: np.ndarray | None

    @classmethod
    def of(
        cls, seen: Evaluation, pieces: Sequence[RecordingTerm], cost: float, step: np.ndarray | None
    ) -> Iterate:
        """Return the visit to a point whose sum of squares is ``cost`` with the pieces' noise.

        ``step`` (size,) of the common parameters led there.
        """
        squares = tuple(tuple(r.T @ r / len(r) for r in own) for own in seen.residuals)
        return cls(squares, cost - _whitened(squares, pieces), step)

    def cost(self, pieces: Sequence[RecordingTerm]) -> float:
        """Return its sum of squares with the noise of these pieces.

        Samples that were left out later count as the mean of all.
        """
        return _whitened(self.squares, pieces) + self.known


def history_of(
    visits: Sequence[Iterate], pieces: Sequence[RecordingTerm], samples: int, sigma: np.ndarray
) -> tuple[Iteration, ...]:
    """Return the history of the searches that ended with these pieces.

    ``sigma`` (size,) are the standard deviations of the common parameters, steps are told in them; costs are
    per sample. While a search runs the noise is estimated anew after every step, so that its own sum of
    squares is always near the number of samples: by the noise at the end costs can be compared.
    """
    out = []
    for visit in visits:
        longest = None if visit.step is None else float(np.abs(visit.step / sigma).max())
        out.append(Iteration(visit.cost(pieces) / samples, longest))
    return tuple(out)


def _whitened(squares: Sequence[Sequence[np.ndarray]], pieces: Sequence[RecordingTerm]) -> float:
    total = 0.0
    for piece, own in zip(pieces, squares, strict=True):
        for c, mean in zip(piece.channels, own, strict=True):
            total += len(c.times) * float(np.sum((c.whitening @ mean) * c.whitening))
    return total
