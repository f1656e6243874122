"""A point of the search, what is predicted there, and steps away from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid.likelihood.nuisance_parameters import NuisanceValues
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.prediction import Prediction
from smsid.likelihood.prior import Prior
from smsid.likelihood.recording_term import RecordingTerm


@dataclass(frozen=True)
class SearchPoint:
    """A point of the search: common parameters, and local ones by piece."""

    parameters: Parameters
    locals: tuple[NuisanceValues, ...]


@dataclass(frozen=True)
class Evaluation:
    """A point with what is predicted there: predictions and residuals by piece."""

    point: SearchPoint
    predictions: tuple[Prediction, ...]
    residuals: tuple[list[np.ndarray], ...]

    @classmethod
    def at(
        cls, pieces: Sequence[RecordingTerm], point: SearchPoint, known: Evaluation | None = None
    ) -> Evaluation:
        """Predict what is not ``known`` from the same parameters, the same channels.

        Raises `SimulationError` when the motion is not finite.
        """
        predictions, residuals = [], []
        for k, (piece, local) in enumerate(zip(pieces, point.locals, strict=True)):
            if known and local is known.point.locals[k] and piece.timeline is known.predictions[k].timeline:
                predictions.append(known.predictions[k])
                residuals.append(known.residuals[k])
                continue
            predictions.append(piece.predict(point.parameters, local))
            residuals.append(piece.residuals(point.parameters, local, predictions[-1]))
        return cls(point, tuple(predictions), tuple(residuals))

    def cost(self, pieces: Sequence[RecordingTerm], prior: Prior) -> float:
        """Return the sum of squares of whitened residuals, data and priors."""
        residual, _ = prior.residual(self.point.parameters)
        total = float(residual @ residual)
        for piece, local, own in zip(pieces, self.point.locals, self.residuals, strict=True):
            total += piece.cost(own) + piece.known_cost(local)
        return total

    def cleaned(self, pieces: Sequence[RecordingTerm]) -> tuple[tuple[RecordingTerm, ...], Evaluation]:
        """Return the pieces without outliers, and what is left to see."""
        both = [p.cleaned(r) for p, r in zip(pieces, self.residuals, strict=True)]
        return tuple(p for p, _ in both), replace(self, residuals=tuple(r for _, r in both))

    def following(self, pieces: Sequence[RecordingTerm]) -> tuple[tuple[RecordingTerm, ...], Evaluation]:
        """Return the pieces with the measured joint motion among their parameters, and what is seen then."""
        new = tuple(p.following() for p in pieces)
        pairs = zip(new, pieces, self.point.locals, strict=True)
        locals_ = tuple(p.in_true_time(x) if p.follows > old.follows else x for p, old, x in pairs)
        if all(a is b for a, b in zip(locals_, self.point.locals, strict=True)):
            return new, self
        return new, Evaluation.at(new, SearchPoint(self.point.parameters, locals_), self)

    def reweighed(self, pieces: Sequence[RecordingTerm]) -> tuple[RecordingTerm, ...]:
        """Return the pieces with the noise their residuals show."""
        parts = zip(pieces, self.residuals, self.predictions, strict=True)
        return tuple(p.with_noise(r, self.point.parameters, x) for p, r, x in parts)


def step_point(
    pieces: Sequence[RecordingTerm],
    point: SearchPoint,
    step: np.ndarray,
    motions: Sequence[np.ndarray | None],
) -> SearchPoint:
    """Return the point a step (n,) away, and ``motions`` (m, joints) by piece of the joints."""
    size = point.parameters.size
    locals_, first = [], size
    for piece, local, motion in zip(pieces, point.locals, motions, strict=True):
        local = local if motion is None else replace(local, motion=local.motion + motion)
        locals_.append(piece.moved(local, step[first : first + piece.size]))
        first += piece.size
    return SearchPoint(point.parameters.moved(step[:size]), tuple(locals_))
