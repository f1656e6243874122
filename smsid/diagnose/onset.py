"""Effects that begin midway: when, whether they do, and which candidates only a beginning shows."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from smsid.diagnose.candidates import Candidate, Score, scored, signatures
from smsid.diagnose.columns import Change, propagate
from smsid.diagnose.fit import Fit, continued, evaluate, within_reach
from smsid.effects.base import Starting
from smsid.errors import SmsidError

LOGGER = logging.getLogger(__name__)
ONSETS = 9  # times an effect may begin at, a round
ROUNDS, MORE = 3, 2  # each finer; more where the effect is strong enough to show the very sample
STRONG = 400.0
POOR = 10.0  # standard deviations of a sum of squares
COARSE = 5  # times at which all candidates are tried


def price(alias: float) -> float:
    """Return what an onset has to gain in likelihood ratio: the grid it was searched on, and ``alias``."""
    return 2.0 * float(np.log((ROUNDS + MORE) * ONSETS)) + alias


def with_onset(current: Fit, s: Score, alias: float) -> Score:
    """Return the score with the time its effect begins, where beginning midway explains clearly more.

    A grid over the recording, then a finer one about its best; what the grid costs is paid in the criterion.
    """
    if not _may_begin(s.candidate):
        return s
    run, times = current.run, current.run.states.time
    own = s.candidate.columns(current.changes, current.unknowns) if _may_be_cut(s.candidate) else None
    best, width = s, float(times[-1] - times[0]) / (ONSETS + 1)
    centre = float(times[0]) + width * (ONSETS + 1) / 2.0
    for finer in range(ROUNDS + MORE):
        if finer >= ROUNDS and best.ratio < STRONG:
            break
        about = centre + width * (np.arange(ONSETS) - (ONSETS - 1) / 2.0)
        tried = [_from(s.candidate, float(t)) for t in about if times[0] < t < times[-1]]
        if own is None:
            columns = signatures(current, tried)
            scores = scored(current, [tried[i] for i in columns], list(columns.values()))
        else:
            starts = [t.effect.start for t in tried if isinstance(t.effect, Starting)]
            changes = [_cut(c, float(t or 0.0), run.middle.time, times) for t in starts for c in own]
            parts = np.split(propagate(run, changes).reshape(-1, len(changes)), len(starts), axis=1)
            scores = scored(current, tried, parts)
        best = max([best, *scores], key=lambda x: x.ratio)
        begun = getattr(best.candidate.effect, "start", None)
        if begun is None:
            return s
        centre, width = begun, 2.0 * width / ONSETS
    return best if best.ratio - s.ratio > price(alias) else s


def beginning(current: Fit, scores: Sequence[Score], count: int) -> list[Score]:
    """Return the scores of the ``count`` candidates that explain most when they begin midway.

    Over a coarse grid: what a candidate does from a time on is what it does all the time, cut off before.
    """
    tried = [s for s in scores if s.freedom and _may_begin(s.candidate) and _may_be_cut(s.candidate)]
    run = current.run
    marks = np.linspace(run.states.time[0], run.states.time[-1], COARSE + 2)[1:-1]
    best: dict[int, float] = {}
    for i, s in enumerate(tried):
        own = s.candidate.columns(current.changes, current.unknowns)
        changes = [_cut(c, float(t), run.middle.time, run.states.time) for t in marks for c in own]
        columns = propagate(run, changes).reshape(-1, len(changes))
        parts = np.split(columns, len(marks), axis=1)
        best[i] = max(x.ratio for x in scored(current, [s.candidate] * len(marks), parts))
    chosen = sorted(best, key=lambda i: -best[i])[:count]
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


def _cut(change: Change, start: float, middle: np.ndarray, at: np.ndarray) -> Change:
    later, there = (middle >= start)[:, None], (at >= start)[:, None]
    return Change(
        None if change.middle is None else change.middle * later,
        None if change.at is None else change.at * there,
        None if change.reading is None else change.reading * there,
    )
