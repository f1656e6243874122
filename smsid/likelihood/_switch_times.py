"""Thrust that switches between two samples of its command: when, as its sensors tell.

A command that is recorded at 100 Hz says of a valve when it switched to 10 ms. Taken for switching at its
samples, a thrust of 13 s that in truth ends 7 ms earlier makes a spacecraft 0.05 % too heavy, twenty times as
much as its sensors leave open, and clocks seem to be wrong. So times of switching are parameters, each known
to lie between two samples - where that is likelier than that the command's own computer logs what it does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from smsid.likelihood.channels import on_timeline
from smsid.likelihood.fit import Fit
from smsid.likelihood.normal import normal_at
from smsid.likelihood.nuisance_parameters import SWITCH, NuisanceIndex, NuisanceValues
from smsid.likelihood.point import Evaluation, SearchPoint
from smsid.likelihood.prior import Prior
from smsid.likelihood.recording_term import RecordingTerm
from smsid.likelihood.time_grid import SLACK, Timeline

CLOSE = 1e-3  # of its interval: how far a switch may be from where the grid has it
OUTSIDE = 3.0  # standard deviations by which a time may be outside of its interval


def intervals(piece: RecordingTerm) -> np.ndarray:
    """Return between what times [s] thrust switches (k, 2), where these are known to an interval only: from a
    sample of its command, or the first of the sensors, to the next; (0, 2) where thrust switches at samples.
    """
    thrust, edges = piece.drive.thrust, piece.timeline.edges
    slot = _slot(piece)
    if slot is not None:
        half = 0.5 * np.sqrt(12.0) * np.array(slot.sigmas)
        return np.column_stack([np.array(slot.mean) - half, np.array(slot.mean) + half])
    if thrust is None or thrust.since is None or len(edges) < 3:
        return np.zeros((0, 2))
    since = np.maximum(thrust.since[np.searchsorted(thrust.jumps, edges[1:-1])], edges[0])
    return np.column_stack([since, edges[1:-1]])


def with_switch_times(piece: RecordingTerm) -> RecordingTerm:
    """Return the piece with the times at which thrust switches among its parameters, where these are not
    known: each about the middle of its interval. Accelerations read within one may be of either side.
    """
    between = intervals(piece)
    if not len(between):
        return piece
    channels = []
    for c in piece.channels:
        place = np.minimum(np.searchsorted(between[:, 1], c.times + SLACK), len(between) - 1)
        within = (c.times > between[place, 0] + SLACK) & (c.times < between[place, 1] - SLACK)
        channels.append(c.only(~within) if c.quantity == "acceleration" and within.any() else c)
    return moved_to(replace(_asked(piece), channels=tuple(channels)), between.mean(axis=1))


def switch_times(piece: RecordingTerm) -> np.ndarray:
    """Return when thrust switches (k,) [s] as a search begins, where that is sought."""
    return piece.timeline.edges[1:-1].copy() if _slot(piece) is not None else np.zeros(0)


def moved_to(piece: RecordingTerm, times: np.ndarray) -> RecordingTerm:
    """Return the piece with thrust that switches at other times (k,) [s]."""
    thrust, edges = piece.drive.thrust, piece.timeline.edges
    assert thrust is not None
    own = np.concatenate([[True], np.any(np.diff(thrust.values, axis=0) != 0.0, axis=1)])
    at, values = thrust.times[own].copy(), thrust.values[own]
    at[np.searchsorted(at, edges[1:-1])] = times
    timeline = Timeline.of(edges[0], edges[-1], times.tolist(), float(piece.timeline.h.max()))
    drive = replace(piece.drive, thrust=replace(thrust, times=at, values=values))
    return replace(piece, drive=drive, timeline=timeline, channels=on_timeline(piece.channels, timeline))


def on_found_times(piece: RecordingTerm, local: NuisanceValues) -> RecordingTerm | None:
    """Return the piece with thrust that switches when a search found it to; ``None`` if it does, about."""
    if _slot(piece) is None:
        return None
    between = intervals(piece)
    margin = CLOSE * np.diff(between, axis=1)[:, 0]
    times = np.clip(local.switch, between[:, 0] + margin, between[:, 1] - margin)
    return None if (np.abs(times - piece.timeline.edges[1:-1]) < margin).all() else moved_to(piece, times)


def outside(found: Fit) -> bool:
    """Whether a maximum has some switch outside of its interval: then it is no switch's time that is off."""
    sigma = np.sqrt(np.diag(found.normal.covariance()))
    first = found.point.parameters.size
    for piece, local in zip(found.pieces, found.point.locals, strict=True):
        slot = _slot(piece)
        if slot is not None:
            between, own = intervals(piece), sigma[first + slot.start : first + slot.start + slot.size]
            low, high = local.switch - between[:, 0], between[:, 1] - local.switch
            if (np.minimum(low, high) < -OUTSIDE * own).any():
                return True
        first += piece.size
    return False


def switch_evidence(pieces: Sequence[RecordingTerm], seen: Evaluation, prior: Prior) -> float:
    """Return by how much (in logarithms) it is likelier that thrust switches anywhere between samples of its
    command than that it does at the samples, about a maximum of either.

    By the ratio of densities of Savage and Dickey (Dickey, Ann. Math. Statist. 42 (1971) 204): that of the
    samples' times before the recordings over that after them, other parameters estimated.
    """
    asked = [_asked(p) for p in pieces]
    locals_ = [
        x if len(x.switch) or _slot(p) is None else replace(x, switch=p.timeline.edges[1:-1].copy())
        for p, x in zip(asked, seen.point.locals, strict=True)
    ]
    point = SearchPoint(seen.point.parameters, tuple(locals_))
    normal = normal_at(asked, replace(seen, point=point), prior)
    places, off, width, first = [], [], [], point.parameters.size
    for piece, local in zip(asked, locals_, strict=True):
        slot = _slot(piece)
        if slot is not None:
            between = intervals(piece)
            places += [first + slot.start + k for k in range(slot.size)]
            off += (between[:, 1] - local.switch).tolist()
            width += np.diff(between, axis=1)[:, 0].tolist()
        first += piece.size
    if not places or not (np.isfinite(normal.information).all() and np.isfinite(normal.gradient).all()):
        return -np.inf
    scale = 1.0 / np.sqrt(np.diag(normal.information))
    information = normal.information * np.outer(scale, scale)
    right = np.column_stack([normal.gradient * scale, np.eye(len(scale))[:, places]])
    solved = scale[:, None] * np.linalg.solve(information, right)
    covariance = solved[places][:, 1:] * scale[places]
    late = np.array(off) - solved[places, 0]  # of the samples' times, afterwards
    # half an interval is the root of 3 of its standard deviations: the samples are at the end of each
    before = -1.5 * len(width) - float(np.log(np.array(width) / np.sqrt(12.0)).sum())
    sign, size = np.linalg.slogdet(covariance)
    if sign <= 0.0:
        return -np.inf
    after = -0.5 * float(late @ np.linalg.solve(covariance, late)) - 0.5 * float(size)
    return before - after


def _slot(piece: RecordingTerm) -> NuisanceIndex | None:
    return next((s for s in piece.slots if s.kind == SWITCH), None)


def _asked(piece: RecordingTerm) -> RecordingTerm:
    """Return the piece with the times among its parameters, at the samples as they are."""
    between = intervals(piece)
    if _slot(piece) is not None or not len(between):
        return piece
    mean = tuple(between.mean(axis=1).tolist())
    sigmas = tuple((np.diff(between, axis=1)[:, 0] / np.sqrt(12.0)).tolist())
    slot = NuisanceIndex(SWITCH, "command.force", piece.size, len(mean), max(sigmas), "s", mean, sigmas)
    return replace(piece, slots=(*piece.slots, slot))
