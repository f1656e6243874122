"""The search for the maximum where clocks may be off: they are found one after the other, the worst first."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid.errors import NotIdentifiableError
from smsid.likelihood._outputs import Kinematics
from smsid.likelihood._switch_times import (
    intervals,
    on_found_times,
    outside,
    switch_evidence,
    switch_times,
    with_switch_times,
)
from smsid.likelihood.channels import Channel, described_sigma
from smsid.likelihood.fit import ITERATIONS, ConvergenceError, Fit, Iterate, fit
from smsid.likelihood.normal import normal_at
from smsid.likelihood.nuisance_parameters import CLOCK_KINDS, NuisanceValues, deviation, zero_clocks
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.point import Evaluation, SearchPoint
from smsid.likelihood.prediction import Prediction
from smsid.likelihood.prior import Prior
from smsid.likelihood.recording_term import RecordingTerm

ROUNDS = 6  # of choosing the samples near jumps
PATIENCE = 25  # iterations after which clocks are doubted although the search has not come to rest
IMPLAUSIBLY_LOUD = 3.0  # times its stated noise beyond which no model that is right leaves a sensor
EXPLAINED = 0.1  # share of what such a sensor leaves that its clock has to explain, to be doubted
GROSS, RECENT = 10.0, 10  # times the stated noise that is left, and iterations in which it has to halve


@dataclass(frozen=True)
class SearchResult:
    """What a search found, the sensors whose ``clocks`` had to be sought too, and all points visited."""

    found: Fit
    clocks: tuple[str, ...]
    visits: tuple[Iterate, ...]


def search(pieces: Sequence[RecordingTerm], start: Evaluation, prior: Prior) -> SearchResult:
    """Return the maximum of the likelihood near ``start``, with the clocks that do not agree with the rest.

    A clock is doubted at the maximum without it (`worst_clock`), or where a search is that does not come to
    rest. Then the search begins anew: what a wrong clock leads to may be another maximum. A clock that turns
    out to be right counts as such from then on. So do times at which thrust switches (`switch_evidence`),
    which are asked about first: no clock makes up for a wrong impulse, but several together do for a part.

    Raises `NotIdentifiableError` when the search does not come to rest.
    """
    names: list[str] = []
    right: set[str] = set()
    visits: list[Iterate] = []
    own, point, seen, switches = pieces, start.point, start, False
    at_samples = not any(len(intervals(p)) for p in pieces)
    while True:
        where, worst = _looked_around(own, point, prior, right, visits, seen)
        assert where.seen is not None
        if not (switches or at_samples) and switch_evidence(where.pieces, where.seen, prior) > 0.0:
            switches = True
        elif worst is not None:
            names.append(worst)
        else:
            assert isinstance(where, Fit)
            more = right_clocks(where, names)
            if switches and (outside(where) or switch_evidence(where.pieces, where.seen, prior) < 0.0):
                switches, at_samples = False, True
            elif not more:
                return SearchResult(where, tuple(names), tuple(visits))
            right |= more
            names = [n for n in names if n not in more]
        own = [with_switch_times(p) if switches else p for p in pieces]
        own = [p.with_clocks(names) for p in own]
        known = [x.clock for x in where.seen.point.locals]
        locals_ = tuple(
            replace(
                x,
                clock={**zero_clocks(p.slots), **{n: k[n] for n in names if n in k}},
                switch=switch_times(p),
            )
            for p, x, k in zip(own, start.point.locals, known, strict=True)
        )
        point, seen = SearchPoint(start.point.parameters, locals_), None


def _looked_around(
    pieces: Sequence[RecordingTerm],
    start: SearchPoint,
    prior: Prior,
    right: Collection[str],
    visits: list[Iterate],
    seen: Evaluation | None,
) -> tuple[Fit | ConvergenceError, str | None]:
    """The maximum, or where a search is stuck for a wrong clock; and which clock is to be doubted there.

    ``seen`` at the start, if that is known already.
    """
    where: Fit | ConvergenceError
    for patience in (PATIENCE, ITERATIONS):
        try:
            where = _search_maximum(pieces, start, prior, visits, patience, seen)
        except ConvergenceError as stuck:
            if stuck.seen is None:
                raise
            where = stuck
            visits += stuck.visits
        assert where.seen is not None
        worst = worst_clock(where.pieces, where.seen, prior, right)
        if worst is not None or isinstance(where, Fit):
            return where, worst
        if _hopeless(where):
            break
        start, seen = _begun(pieces, where.seen.point), None
    raise where


def _hopeless(stuck: ConvergenceError) -> bool:
    """Whether a search leaves a channel grossly louder than stated, and has long not got much further."""
    if len(stuck.visits) <= RECENT:
        return False
    channels = [c for p in stuck.pieces for c in p.channels]

    def largest_loudness(visit: Iterate) -> float:
        squares = [s for own in visit.squares for s in own]
        pairs = zip(channels, squares, strict=True)
        return max((loudness(c, float(np.diag(s).max())) for c, s in pairs), default=0.0)

    now, before = largest_loudness(stuck.visits[-1]), largest_loudness(stuck.visits[-1 - RECENT])
    return now > max(GROSS, 0.5 * before)


def loudness(channel: Channel, square: float) -> float:
    """Return what a channel leaves, mean ``square``, in its stated noise; zero where none is stated."""
    stated = described_sigma(channel.sensor, channel.quantity, channel.width)
    return float(np.sqrt(square) / stated.min()) if (stated > 0.0).all() else 0.0


def _search_maximum(
    pieces: Sequence[RecordingTerm],
    start: SearchPoint,
    prior: Prior,
    visits: list[Iterate],
    patience: int,
    seen: Evaluation | None,
) -> Fit:
    """The maximum near a start; where clocks are sought, samples near jumps are chosen by where they end."""
    moved, found = 0.0, None
    for _ in range(ROUNDS):
        own = [away_from_jumps(p, local) for p, local in zip(pieces, start.locals, strict=True)]
        same = all(a is b for a, b in zip(own, pieces, strict=True))
        found = fit(own, start, prior, patience, seen=seen if same else None)
        visits += found.visits
        moved = largest_clock_shift(start.locals, found.point.locals, found.pieces)
        switched = [on_found_times(p, x) for p, x in zip(pieces, found.point.locals, strict=True)]
        if moved < GUARD / 2 and all(p is None for p in switched):
            return found
        pieces = [p if new is None else new for new, p in zip(switched, pieces, strict=True)]
        start, seen = _begun(pieces, found.point), None
    if found is not None and moved < GUARD / 2:  # switches still move by a thousandth of their intervals
        return found
    raise NotIdentifiableError(
        f"A clock moves by {moved:.3g} s from one search to the next: it cannot be told.",
        advice="Correct the sensors' clocks first: `smsid.recording.lag.estimate_lag` compares two of them.",
        moved=moved,
    )


def _begun(pieces: Sequence[RecordingTerm], at: SearchPoint) -> SearchPoint:
    """A point to begin a search at: the joints' motion is not estimated yet."""
    pairs = zip(pieces, at.locals, strict=True)
    return SearchPoint(at.parameters, tuple(p.as_measured(local) for p, local in pairs))


DOUBT = 5.0  # standard deviations of a score: one in two million for a good clock
RIGHT = 3.0  # standard deviations from zero up to which a clock that was sought counts as right
GUARD = 0.25  # [s] on both sides of a jump, of samples that a clock still to be found would take across it


def doubtful_clocks(
    piece: RecordingTerm, parameters: Parameters, prediction: Prediction, residuals: Sequence[np.ndarray]
) -> dict[str, float]:
    """Return the sensors whose residuals at the maximum still go with an offset or a drift of their clock.

    ``residuals`` (N, k) by channel. With how far, in standard deviations of the score. A clock late by tau
    reads y(t - tau), which leaves -tau dy/dt in the residual. The score of tau and of its growth with time,
    as if nothing else had been estimated, has at most unit variance when the clock is good. Source: Rao's
    score test (Rao 1948). One wrong clock pulls at what all sensors share, so that the others' scores grow
    too (`worst_clock` tells which it is).
    """
    kinematics = Kinematics.of(parameters.layout.model, prediction)
    start = piece.timeline.edges[0]
    own = {s.channel for s in piece.slots if s.kind == "clock_offset"}
    scores: dict[str, np.ndarray] = {}
    for c, r in zip(piece.channels, residuals, strict=True):
        if c.sensor.name in own:
            continue
        rate = -c.at_samples(kinematics.rate(c.sensor, c.quantity, piece.timeline)) @ c.whitening.T
        white = r @ c.whitening.T
        product, square = np.sum(rate * white, axis=1), np.sum(rate**2, axis=1)
        late = c.times - start
        sums = np.array([product.sum(), (product * late).sum(), square.sum(), (square * late**2).sum()])
        scores[c.sensor.name] = scores.get(c.sensor.name, np.zeros(4)) + sums
    size = {n: float(np.max(np.abs(x[:2]) / np.sqrt(x[2:] + 1e-300))) for n, x in scores.items()}
    return {n: x for n, x in size.items() if x > DOUBT}


def worst_clock(
    pieces: Sequence[RecordingTerm], seen: Evaluation, prior: Prior, good: Collection[str] = ()
) -> str | None:
    """Return the sensor whose clock does not agree with the rest, if there is one; those ``good`` are not.

    A sensor that leaves far more than its noise is in doubt only where its clock explains some of it. Of
    several in doubt it is the one whose offset and drift, in all recordings and with everything else
    estimated, would lower the sum of squares most: a wrong clock pulls at what all sensors share.
    """
    names: set[str] = set()
    for piece, prediction, residuals in zip(pieces, seen.predictions, seen.residuals, strict=True):
        names |= set(doubtful_clocks(piece, seen.point.parameters, prediction, residuals))
    names -= set(good)
    if not names:
        return None
    asked = [p.with_clocks(sorted(names)) for p in pieces]
    locals_ = [
        replace(x, clock={**zero_clocks(p.slots), **x.clock})
        for p, x in zip(asked, seen.point.locals, strict=True)
    ]
    normal = normal_at(asked, replace(seen, point=SearchPoint(seen.point.parameters, tuple(locals_))), prior)
    places: dict[str, list[int]] = {name: [] for name in names}
    first = seen.point.parameters.size
    for piece in asked:
        for s in piece.slots:
            if s.kind in CLOCK_KINDS and s.channel in names:
                places[s.channel].append(first + s.start)
        first += piece.size
    if not (np.isfinite(normal.information).all() and np.isfinite(normal.gradient).all()):
        return None
    scale = 1.0 / np.sqrt(np.diag(normal.information))
    information, gradient = normal.information * np.outer(scale, scale), normal.gradient * scale

    def gain(name: str) -> float:
        held = [i for n, own in places.items() if n != name for i in own]
        free = np.setdiff1d(np.arange(len(gradient)), held)
        return float(gradient[free] @ np.linalg.solve(information[np.ix_(free, free)], gradient[free]))

    left, loud = dict.fromkeys(names, 0.0), dict.fromkeys(names, 0.0)
    for piece, residuals in zip(pieces, seen.residuals, strict=True):
        for c, r in zip(piece.channels, residuals, strict=True):
            if c.sensor.name in names:
                left[c.sensor.name] += float(np.sum((r @ c.whitening.T) ** 2))
                loudest = loudness(c, float(np.mean(r**2, axis=0).max()))
                loud[c.sensor.name] = max(loud[c.sensor.name], loudest)
    without, gains = gain(""), {name: gain(name) for name in names}
    # of what a wrong model leaves, a clock explains a little, too
    explain = [n for n in names if loud[n] < IMPLAUSIBLY_LOUD or gains[n] - without > EXPLAINED * left[n]]
    return max(sorted(explain), key=lambda name: gains[name], default=None)


def right_clocks(found: Fit, names: Collection[str]) -> set[str]:
    """Return which sensors' clocks, of those sought by ``names``, turn out to show the right time."""
    sigma = np.sqrt(np.diag(found.normal.covariance()))
    wrong, first = set(), found.point.parameters.size
    for piece, local in zip(found.pieces, found.point.locals, strict=True):
        for s in piece.slots:
            if s.kind in CLOCK_KINDS and abs(deviation(s, local)[0]) > RIGHT * sigma[first + s.start]:
                wrong.add(s.channel)
        first += piece.size
    return set(names) - wrong


def away_from_jumps(piece: RecordingTerm, local: NuisanceValues) -> RecordingTerm:
    """Return the piece without accelerations near jumps of thrust, of sensors whose clock is sought.

    A sample that another clock reading takes across a jump makes the likelihood jump: no derivative tells on
    which side it belongs. Where the jumps are, by the sensor's own clock, is as ``local`` has it.
    """
    jumps = piece.timeline.edges[1:-1]
    if not (len(jumps) and local.clock):
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


def largest_clock_shift(
    before: Sequence[NuisanceValues], after: Sequence[NuisanceValues], pieces: Sequence[RecordingTerm]
) -> float:
    """Return by how much [s] clocks moved, at most, anywhere in the recordings."""
    moved = [0.0]
    for old, new, piece in zip(before, after, pieces, strict=True):
        ends = piece.timeline.edges[[0, -1]]
        for name, clock in new.clock.items():
            change = clock - old.clock.get(name, np.zeros(2))
            moved.append(float(np.abs(late(change, ends, ends[0])).max()))
    return max(moved)
