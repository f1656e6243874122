"""Clocks that do not agree with the rest: which one, and what its samples near a jump of thrust can say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from smsid.likelihood.local import Local
from smsid.likelihood.outputs import Kinematics
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.piece import Piece
from smsid.likelihood.prediction import Prediction

DOUBT = 5.0  # standard deviations of a score: one in two million for a good clock
GUARD = 0.25  # [s] on both sides of a jump, of samples that a clock still to be found would take across it


def doubtful_clocks(
    piece: Piece, parameters: Parameters, prediction: Prediction, residuals: Sequence[np.ndarray]
) -> dict[str, float]:
    """Return the sensors whose residuals at the maximum still go with an offset or a drift of their clock.

    ``residuals`` (N, k) by channel. With how far, in standard deviations of the score. A clock late by tau
    reads y(t - tau), which leaves -tau dy/dt in the residual. The score of tau and of its growth with time,
    as if nothing else had been estimated, has at most unit variance when the clock is good. Source: Rao's
    score test (Rao 1948). One wrong clock pulls at what all sensors share, so that the others' scores grow
    too: the largest is to be believed first.
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
    size = {n: float(np.max(np.abs(x[:2]) / np.sqrt(x[2:] + 1e-300))) for n, x in scores.items()}
    return {n: x for n, x in size.items() if x > DOUBT}


def away_from_jumps(piece: Piece, local: Local) -> Piece:
    """Return the piece without accelerations near jumps of thrust, of sensors whose clock is sought.

    A sample that another clock reading takes across a jump makes the likelihood jump: no derivative tells on
    which side it belongs. Where the jumps are, by the sensor's own clock, is as ``local`` has it.
    """
    jumps = piece.timeline.edges[1:-1]
    if not len(jumps):
        return piece
    channels = []
    for c in piece.channels:
        clock = local.clock.get(c.sensor.name)
        if clock is None or c.quantity != "acceleration":
            channels.append(c)
            continue
        happened = c.times - late(clock, c.times, piece.timeline.edges[0])
        far = np.abs(happened[:, None] - jumps).min(axis=1) > GUARD
        channels.append(c.only(far, counted=False))
    return replace(piece, channels=tuple(channels))


def late(clock: np.ndarray, times: np.ndarray, start: float) -> np.ndarray:
    """Return what a clock (offset [s], drift [1]) shows too much at its own times (N,) [s]."""
    return clock[0] + clock[1] * (times - start)


def carried(before: Sequence[Local], after: Sequence[Local], pieces: Sequence[Piece]) -> float:
    """Return by how much [s] clocks moved, at most, anywhere in the recordings."""
    moved = [0.0]
    for old, new, piece in zip(before, after, pieces, strict=True):
        ends = piece.timeline.edges[[0, -1]]
        for name, clock in new.clock.items():
            change = clock - old.clock.get(name, np.zeros(2))
            moved.append(float(np.abs(late(change, ends, ends[0])).max()))
    return max(moved)
