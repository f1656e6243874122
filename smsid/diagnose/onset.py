"""Effects that begin midway: when, whether they do, and which candidates only a beginning shows."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid.diagnose.candidates import Candidate, Score, changes_of, scored, signatures
from smsid.diagnose.columns import Change, propagate
from smsid.diagnose.filter import Run
from smsid.diagnose.fit import Fit, continued, evaluate, within_reach
from smsid.effects.base import Starting
from smsid.errors import SmsidError

LOGGER = logging.getLogger(__name__)
ONSETS = 9  # times an effect may begin at, a round
ROUNDS, MORE = 3, 2  # each finer; more where the effect is strong enough to show the very sample
STRONG = 400.0
POOR = 10.0  # standard deviations of a sum of squares
COARSE = 5  # times at which all candidates are tried
BATCH = (
    24  # candidates whose beginnings are propagated together: as fast as all of them, and they fit in memory
)


def price(alias: float) -> float:
    """Return what an onset has to gain in likelihood ratio: the grid it was searched on, and ``alias``."""
    return 2.0 * float(np.log((ROUNDS + MORE) * ONSETS)) + alias


@dataclass
class _Scan:
    """The search for the time one candidate's effect begins: the best so far, and where to look next.

    ``own`` are its changes, to be cut off, or ``None`` where another beginning is another change.
    """

    plain: Score
    best: Score
    centre: float
    width: float
    own: list[Change] | None

    def tried(self, first: float, last: float) -> list[Candidate]:
        """Return the candidate with the beginnings of a round, between the first and the last sample."""
        about = self.centre + self.width * (np.arange(ONSETS) - (ONSETS - 1) / 2.0)
        return [_from(self.plain.candidate, float(t)) for t in about if first < t < last]

    def next(self, scores: Sequence[Score]) -> None:
        """Take the best of a round; look closer about it."""
        self.best = max([self.best, *scores], key=lambda x: x.ratio)
        self.centre = _start(self.best.candidate) or self.centre
        self.width *= 2.0 / ONSETS


def with_onsets(current: Fit, scores: Sequence[Score], alias: float) -> list[Score]:
    """Return scores with the times their effects begin, where beginning midway explains clearly more.

    A grid over the recording, then finer ones about its best; what the grid costs is paid in the criterion.
    """
    times = current.run.states.time
    first, last = float(times[0]), float(times[-1])
    width = (last - first) / (ONSETS + 1)
    scans = {
        i: _Scan(s, s, 0.5 * (first + last), width, _changes(current, s.candidate))
        for i, s in enumerate(scores)
        if _may_begin(s.candidate)
    }
    for finer in range(ROUNDS + MORE):
        going = [
            x
            for x in scans.values()
            if (finer == 0 or x.best is not x.plain) and (finer < ROUNDS or x.best.ratio >= STRONG)
        ]
        cut = [(x, x.tried(first, last)) for x in going if x.own is not None]
        parts = _responses(
            current.run,
            [[_cut(c, _start(t) or 0.0, current.run) for c in x.own or ()] for x, ts in cut for t in ts],
        )
        every = iter(scored(current, [t for _, ts in cut for t in ts], parts))
        for x, ts in cut:
            x.next([next(every) for _ in ts])
        for x in going:
            if x.own is None:
                tried = x.tried(first, last)
                columns = signatures(current, tried)
                x.next(scored(current, [tried[i] for i in columns], list(columns.values())))
    return [
        scans[i].best if i in scans and scans[i].best.ratio - s.ratio > price(alias) else s
        for i, s in enumerate(scores)
    ]


def beginning(current: Fit, scores: Sequence[Score], count: int) -> list[Score]:
    """Return the scores of the ``count`` candidates that explain most when they begin midway.

    Over a coarse grid: what a candidate does from a time on is what it does all the time, cut off before.
    """
    tried = [s for s in scores if s.freedom and _may_begin(s.candidate) and _may_be_cut(s.candidate)]
    run = current.run
    marks = np.linspace(run.states.time[0], run.states.time[-1], COARSE + 2)[1:-1].tolist()
    best: list[float] = []
    for i in range(0, len(tried), BATCH):
        some = [s.candidate for s in tried[i : i + BATCH]]
        every = [(c, t) for c in some for t in marks]
        own = {c.key: changes_of(current, c) for c in some}
        parts = _responses(run, [[_cut(x, t, run) for x in own[c.key]] for c, t in every])
        ratios = np.array([x.ratio for x in scored(current, [c for c, _ in every], parts)])
        best += ratios.reshape(len(some), len(marks)).max(axis=1).tolist()
    chosen = sorted(range(len(tried)), key=lambda i: -best[i])[:count]
    return [tried[i] for i in chosen if best[i] > tried[i].ratio]


def poor(found: Fit) -> bool:
    """Whether a fit leaves so much that the curvature of its parameters may hide what it could reach."""
    samples = found.run.samples
    return float((found.run.innovations**2).sum()) - samples > POOR * np.sqrt(2.0 * samples)


def always(current: Fit, score: Score, alias: float) -> tuple[Score, Fit]:
    """Return a cause's score and the fit with it there all the time, where its onset no longer pays.

    The onset may have made up for another cause, found since.
    """
    effect = score.candidate.effect
    if not isinstance(effect, Starting) or effect.start is None:
        return score, current
    mine = current.point.description.get_effect(effect.name)
    plain = current.point.with_effect(mine.model_copy(update={"start": None}))
    try:
        found = evaluate(plain, current.unknowns, current.problem)
        if 2.0 * (within_reach(found) - current.objective) > price(alias):
            return score, current
        found = continued(found, iterations=8)
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("%s is not there all the time: %s", score.candidate.key, error)
        return score, current
    if 2.0 * (found.objective - current.objective) > price(alias):
        return score, current
    LOGGER.info("%s is there all the time", score.candidate.key)
    candidate = replace(score.candidate, effect=effect.model_copy(update={"start": None}), grid=1)
    return replace(score, candidate=candidate), found


def _may_begin(candidate: Candidate) -> bool:
    return isinstance(candidate.effect, Starting) and candidate.effect.start is None


def _may_be_cut(candidate: Candidate) -> bool:
    effect = candidate.effect
    return type(candidate) is Candidate and isinstance(effect, Starting) and not effect.grows


def _from(candidate: Candidate, start: float) -> Candidate:
    assert candidate.effect is not None
    effect = candidate.effect.model_copy(update={"start": start})
    return replace(candidate, effect=effect, grid=(ROUNDS + MORE) * ONSETS)


def _start(candidate: Candidate) -> float | None:
    return candidate.effect.start if isinstance(candidate.effect, Starting) else None


def _changes(current: Fit, candidate: Candidate) -> list[Change] | None:
    return changes_of(current, candidate) if _may_be_cut(candidate) else None


def _cut(change: Change, start: float, run: Run) -> Change:
    later, there = (run.middle.time >= start)[:, None], (run.states.time >= start)[:, None]
    return Change(
        None if change.middle is None else change.middle * later,
        None if change.at is None else change.at * there,
        None if change.reading is None else change.reading * there,
    )


def _responses(run: Run, groups: Sequence[Sequence[Change]]) -> list[np.ndarray]:
    """Return the whitened columns (N rows, d) of groups of changes, propagated together."""
    changes = [c for own in groups for c in own]
    if not changes:
        return []
    whole = propagate(run, changes).reshape(-1, len(changes))
    return np.split(whole, np.cumsum([len(own) for own in groups])[:-1], axis=1)
