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
from smsid.likelihood.inputs import ThrustHistory
from smsid.likelihood.normal import normal_at
from smsid.likelihood.nuisance_parameters import SWITCH, NuisanceIndex, NuisanceValues
from smsid.likelihood.point import Evaluation, SearchPoint
from smsid.likelihood.prior import Prior
from smsid.likelihood.recording_term import RecordingTerm
from smsid.likelihood.time_grid import SLACK, Timeline

CLOSE = 1e-3  # of a sample interval: how far a switch may be from where the grid has it


def may_switch_anywhere(piece: RecordingTerm) -> bool:
    """Whether thrust switches in a recording, at times that are known to a sample interval only."""
    thrust = piece.drive.thrust
    return thrust is not None and thrust.spacing > 0.0 and len(piece.timeline.edges) > 2


def with_switch_times(piece: RecordingTerm) -> RecordingTerm:
    """Return the piece with the times at which thrust switches among its parameters, where these are not
    known: each about the middle of its interval. Accelerations read within one may be of either side.
    """
    if not may_switch_anywhere(piece):
        return piece
    asked = _asked(piece)
    spacing = _thrust_of(piece).spacing
    ends = piece.timeline.edges[1:-1]
    channels = []
    for c in piece.channels:
        before = ends[np.minimum(np.searchsorted(ends, c.times + SLACK), len(ends) - 1)] - c.times
        within = (before > SLACK) & (before < spacing - SLACK)
        channels.append(c.only(~within) if c.quantity == "acceleration" and within.any() else c)
    return moved_to(replace(asked, channels=tuple(channels)), ends - 0.5 * spacing)


def switch_times(piece: RecordingTerm) -> np.ndarray:
    """Return when thrust switches (k,) [s] as a search begins, where that is sought."""
    return piece.timeline.edges[1:-1].copy() if _slot(piece) is not None else np.zeros(0)


def moved_to(piece: RecordingTerm, times: np.ndarray) -> RecordingTerm:
    """Return the piece with thrust that switches at other times (k,) [s]."""
    thrust, edges = _thrust_of(piece), piece.timeline.edges
    new = np.concatenate([edges[:1], times, edges[-1:]])
    own = np.concatenate([[True], np.any(np.diff(thrust.values, axis=0) != 0.0, axis=1)])
    at, values = thrust.times[own].copy(), thrust.values[own]
    at[np.searchsorted(at, edges[1:-1])] = times
    timeline = Timeline(new, piece.timeline.counts)
    drive = replace(piece.drive, thrust=replace(thrust, times=at, values=values))
    return replace(piece, drive=drive, timeline=timeline, channels=on_timeline(piece.channels, timeline))


def on_found_times(piece: RecordingTerm, local: NuisanceValues) -> RecordingTerm | None:
    """Return the piece with thrust that switches when a search found it to; ``None`` if it does, about."""
    slot = _slot(piece)
    if slot is None:
        return None
    spacing = _thrust_of(piece).spacing
    furthest = (0.5 - CLOSE) * spacing
    times = np.clip(local.switch, np.array(slot.mean) - furthest, np.array(slot.mean) + furthest)
    times = np.maximum.accumulate(times)
    if np.abs(times - piece.timeline.edges[1:-1]).max() < CLOSE * spacing:
        return None
    return moved_to(piece, times)


def switch_evidence(pieces: Sequence[RecordingTerm], seen: Evaluation, prior: Prior) -> float:
    """Return by how much (in logarithms) it is likelier that thrust switches anywhere between samples of its
    command than that it does at the samples, about a maximum of either.

    By the ratio of densities of Savage and Dickey (Dickey, Ann. Math. Statist. 42 (1971) 204): that of the
    samples' times before the recordings over that after them, other parameters estimated.
    """
    asked = [_asked(p) for p in pieces]
    locals_ = [
        x if len(x.switch) or not may_switch_anywhere(p) else replace(x, switch=p.timeline.edges[1:-1].copy())
        for p, x in zip(pieces, seen.point.locals, strict=True)
    ]
    point = SearchPoint(seen.point.parameters, tuple(locals_))
    normal = normal_at(asked, replace(seen, point=point), prior)
    places, now, mean, spacing, first = [], [], [], [], point.parameters.size
    for piece, local in zip(asked, locals_, strict=True):
        slot = _slot(piece)
        if slot is not None:
            places += [first + slot.start + k for k in range(slot.size)]
            now += local.switch.tolist()
            mean += slot.mean
            spacing += [_thrust_of(piece).spacing] * slot.size
        first += piece.size
    if not places or not (np.isfinite(normal.information).all() and np.isfinite(normal.gradient).all()):
        return -np.inf
    scale = 1.0 / np.sqrt(np.diag(normal.information))
    information = normal.information * np.outer(scale, scale)
    right = np.column_stack([normal.gradient * scale, np.eye(len(scale))[:, places]])
    solved = scale[:, None] * np.linalg.solve(information, right)
    covariance = solved[places][:, 1:] * scale[places]
    width = np.array(spacing)
    off = np.array(mean) + 0.5 * width - np.array(now) - solved[places, 0]  # of the samples, afterwards
    before = -1.5 * len(width) - float(np.log(width / np.sqrt(12.0)).sum())
    sign, size = np.linalg.slogdet(covariance)
    if sign <= 0.0:
        return -np.inf
    after = -0.5 * float(off @ np.linalg.solve(covariance, off)) - 0.5 * float(size)
    return before - after


def _thrust_of(piece: RecordingTerm) -> ThrustHistory:
    assert piece.drive.thrust is not None
    return piece.drive.thrust


def _slot(piece: RecordingTerm) -> NuisanceIndex | None:
    return next((s for s in piece.slots if s.kind == SWITCH), None)


def _asked(piece: RecordingTerm) -> RecordingTerm:
    """Return the piece with the times among its parameters, at the samples as they are."""
    if _slot(piece) is not None or not may_switch_anywhere(piece):
        return piece
    spacing, ends = _thrust_of(piece).spacing, piece.timeline.edges[1:-1]
    mean = tuple((ends - 0.5 * spacing).tolist())
    slot = NuisanceIndex(SWITCH, "command.force", piece.size, len(ends), spacing / np.sqrt(12.0), "s", mean)
    return replace(piece, slots=(*piece.slots, slot))
