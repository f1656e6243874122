"""The verdict on a batch fit: residuals against stated noise, and recordings that contradict each other."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from smsid.description.schema import Description
from smsid.errors import SmsidError
from smsid.estimation._contradictions import (
    Contradiction,
    RecordingInformation,
    contradictions_of,
    contradictions_of_separate,
)
from smsid.estimation._prior_conflict import PriorConflict, conflict_of, has_mass
from smsid.estimation.fit_quality import LOUD_RATIO, WRONG_RATIO, ChannelFit, FitQuality
from smsid.identify.estimate import distinct
from smsid.identify.paper.pipeline import identify as by_the_paper
from smsid.likelihood.channels import described_sigma
from smsid.likelihood.prior import Cad
from smsid.likelihood.recording_term import RecordingTerm
from smsid.likelihood.refine import Refinement, refine, seen_in
from smsid.recording import Recording

AXES = "xyz"


def batch_quality(refinement: Refinement) -> FitQuality:
    """Return how well a batch fit explains its recordings: residuals over the noise that is stated.

    Channels of which no noise is stated are not judged. Noise of measured inputs is part of what is expected.
    Priors that the recordings contradict count, too.
    """
    found = refinement.fit
    return FitQuality(channels_left(found.pieces, found.seen.residuals), 1.0, batch_conflict(refinement))


def channels_left(
    pieces: Sequence[RecordingTerm], residuals: Sequence[list[np.ndarray]]
) -> tuple[ChannelFit, ...]:
    """Return at what size ``residuals`` (N, k) by piece and channel are left, where noise is stated."""
    channels = []
    for piece, own in zip(pieces, residuals, strict=True):
        for channel, r in zip(piece.channels, own, strict=True):
            stated = described_sigma(channel.sensor, channel.quantity, r.shape[1])
            if not (stated > 0.0).all() or not len(r):
                continue
            seen = np.mean(r**2, axis=0)
            inputs = np.maximum(np.diag(channel.covariance) - seen, 0.0)
            ratio = np.sqrt(seen / (stated**2 + inputs))
            k = int(np.argmax(ratio))
            worst = float(ratio[k])
            judgement = (
                "not explained" if worst > WRONG_RATIO else "roughly" if worst > LOUD_RATIO else "explained"
            )
            name = f"{channel.name}[{AXES[k] if r.shape[1] == 3 else k}]"
            channels.append(ChannelFit(piece.name, channel.name, name, worst, np.nan, np.nan, judgement))
    return tuple(channels)


def batch_conflict(refinement: Refinement) -> PriorConflict | None:
    """Return by how much the recordings of a batch fit contradict its priors, if they do."""
    normal, at = refinement.fit.normal, refinement.fit.point.parameters
    off, jacobian = refinement.prior.residual(at)
    rate = np.diag(jacobian)
    information, _ = normal.of_common(at.size)
    heavier = refinement.prior.mean / refinement.prior.sigma
    scalars = [s.reference / s.slope if has_mass(s.unit) else 0.0 for s in at.scalars]
    heavier = np.concatenate([heavier.ravel(), rate[heavier.size :] * scalars])
    return conflict_of(off, information / np.outer(rate, rate), at.names, heavier)


def batch_contradictions(refinement: Refinement) -> tuple[Contradiction, ...]:
    """Return which recordings of a batch fit contradict the others; see `contradictions_of`."""
    found = refinement.fit
    if len(found.pieces) < 2:
        return ()
    _, jacobian = refinement.prior.residual(found.point.parameters)
    both = zip(found.pieces, found.normal.of_pieces(), strict=True)
    parts = [RecordingInformation(piece.name, 0.5 * (gram + gram.T), slope) for piece, (gram, slope) in both]
    rows, _ = seen_in(found.pieces, found.seen, refinement.described)
    return contradictions_of(parts, jacobian.T @ jacobian, rows)


def contradictions_one_by_one(
    description: Description,
    recordings: Sequence[Recording],
    cad: Cad | None,
    tell: Callable[[str], None] | None = None,
) -> tuple[Contradiction, ...]:
    """Return which recordings contradict the others, each fitted by itself; none if one is not explained."""
    alone: list[Refinement] = []
    for recording in recordings:
        if tell is not None:
            tell(f"no spacecraft explains all: '{recording.name}' by itself")
        try:
            linear = by_the_paper(description, [recording], replicates=False)
            alone.append(refine(description, [recording], linear, cad=cad))
        except SmsidError:
            return ()
        fit = alone[-1].fit  # what it contradicts beforehand is another matter
        if any(c.judgement == "not explained" for c in channels_left(fit.pieces, fit.seen.residuals)):
            return ()
    own = [a.prior.residual(a.fit.point.parameters) for a in alone]
    rate = np.diag(own[0][1])
    rows = [seen_in(a.fit.pieces, a.fit.seen, a.described)[0] for a in alone]
    return contradictions_of_separate(
        distinct(r.name for r in recordings),
        [a.fit.normal.of_pieces()[0][0] for a in alone],
        [off / rate for off, _ in own],
        np.diag(rate**2),
        rows,
    )
