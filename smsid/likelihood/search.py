"""The search for the maximum where clocks may be off: they are found one after the other, the worst first."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid.errors import NotIdentifiableError
from smsid.likelihood.clocks import GUARD, away_from_jumps, largest_clock_shift, right_clocks, worst_clock
from smsid.likelihood.fit import ITERATIONS, ConvergenceError, Fit, fit
from smsid.likelihood.history import Iterate
from smsid.likelihood.nuisance_parameters import zero_clocks
from smsid.likelihood.point import Point
from smsid.likelihood.prior import Prior
from smsid.likelihood.recording_term import RecordingTerm

ROUNDS = 6  # of choosing the samples near jumps
PATIENCE = 25  # iterations after which clocks are doubted although the search has not come to rest


@dataclass(frozen=True)
class Search:
    """What a search found, the sensors whose ``clocks`` had to be sought too, and all points visited."""

    found: Fit
    clocks: tuple[str, ...]
    visits: tuple[Iterate, ...]


def search(pieces: Sequence[RecordingTerm], start: Point, prior: Prior) -> Search:
    """Return the maximum of the likelihood near ``start``, with the clocks that do not agree with the rest.

    A clock is doubted at the maximum without it (`worst_clock`), or where a search is that does not come to
    rest. Then the search begins anew: what a wrong clock leads to may be another maximum. A clock that turns
    out to be right counts as such from then on.

    Raises `NotIdentifiableError` when the search does not come to rest.
    """
    names: list[str] = []
    right: set[str] = set()
    known: Sequence[dict[str, np.ndarray]] = [{} for _ in pieces]
    visits: list[Iterate] = []
    while True:
        own = [p.with_clocks(names) for p in pieces]
        locals_ = tuple(
            replace(x, clock={**zero_clocks(p.slots), **{n: k[n] for n in names if n in k}})
            for p, x, k in zip(own, start.locals, known, strict=True)
        )
        where, worst = _looked_around(own, Point(start.parameters, locals_), prior, right, visits)
        assert where.seen is not None
        known = [x.clock for x in where.seen.point.locals]
        if worst is not None:
            names.append(worst)
            continue
        assert isinstance(where, Fit)
        more = right_clocks(where, names)
        if not more:
            return Search(where, tuple(names), tuple(visits))
        right |= more
        names = [n for n in names if n not in more]


def _looked_around(
    pieces: Sequence[RecordingTerm], start: Point, prior: Prior, right: Collection[str], visits: list[Iterate]
) -> tuple[Fit | ConvergenceError, str | None]:
    """The maximum, or where a search is stuck for a wrong clock; and which clock is to be doubted there."""
    where: Fit | ConvergenceError
    for patience in (PATIENCE, ITERATIONS):
        try:
            where = _searched(pieces, start, prior, visits, patience)
        except ConvergenceError as stuck:
            if stuck.seen is None:
                raise
            where = stuck
            visits += stuck.visits
        assert where.seen is not None
        worst = worst_clock(where.pieces, where.seen, prior, right)
        if worst is not None or isinstance(where, Fit):
            return where, worst
        start = _begun(pieces, where.seen.point)
    raise where


def _searched(
    pieces: Sequence[RecordingTerm], start: Point, prior: Prior, visits: list[Iterate], patience: int
) -> Fit:
    """The maximum near a start; where clocks are sought, samples near jumps are chosen by where they end."""
    moved = 0.0
    for _ in range(ROUNDS):
        own = [away_from_jumps(p, local) for p, local in zip(pieces, start.locals, strict=True)]
        found = fit(own, start, prior, patience)
        visits += found.visits
        moved = largest_clock_shift(start.locals, found.point.locals, found.pieces)
        if moved < GUARD / 2:
            return found
        start = _begun(pieces, found.point)
    raise NotIdentifiableError(
        f"A clock moves by {moved:.3g} s from one search to the next: it cannot be told.",
        advice="Correct the sensors' clocks first: `smsid.recording.lag.estimate_lag` compares two of them.",
        moved=moved,
    )


def _begun(pieces: Sequence[RecordingTerm], at: Point) -> Point:
    """A point to begin a search at: the joints' motion is not estimated yet."""
    pairs = zip(pieces, at.locals, strict=True)
    return Point(at.parameters, tuple(p.as_measured(local) for p, local in pairs))
