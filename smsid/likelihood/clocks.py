"""Whether a sensor's clock agrees with the rest: residuals against the derivative of the prediction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from smsid.likelihood.outputs import Kinematics
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.piece import Piece
from smsid.likelihood.prediction import Prediction

DOUBT = 5.0  # standard deviations of a score: one in two million for a good clock


def doubtful_clocks(
    piece: Piece, parameters: Parameters, prediction: Prediction, residuals: Sequence[np.ndarray]
) -> tuple[str, ...]:
    """Return the sensors whose residuals at the maximum still go with an offset or a drift of their clock.

    A clock late by tau reads y(t - tau), which leaves -tau dy/dt in the residual. The score of tau and of its
    growth with time, as if nothing else had been estimated, has at most unit variance when the clock is good.
    Source: Rao's score test (Rao 1948).
    """
    kinematics = Kinematics.of(parameters.layout.model, prediction)
    start = piece.timeline.edges[0]
    own = {s.channel for s in piece.slots if s.kind == "clock_offset"}
    scores: dict[str, np.ndarray] = {}
    for c, r in zip(piece.channels, residuals, strict=True):
        if c.sensor.name in own:
            continue
        rate = -(c.weights @ kinematics.rate(c.sensor, c.quantity, piece.timeline)) @ c.whitening.T
        white = r @ c.whitening.T
        product, square = np.sum(rate * white, axis=1), np.sum(rate**2, axis=1)
        late = c.times - start
        sums = np.array([product.sum(), (product * late).sum(), square.sum(), (square * late**2).sum()])
        scores[c.sensor.name] = scores.get(c.sensor.name, np.zeros(4)) + sums
    doubtful = [n for n, x in scores.items() if (np.abs(x[:2]) > DOUBT * np.sqrt(x[2:]) + 1e-300).any()]
    return tuple(sorted(doubtful))
