"""Effects that begin midway: when, whether they do, and which candidates only a beginning shows."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import cast

import numpy as np

from smsid.diagnose.change_point_scores import Starts, cut_sensitivity
from smsid.diagnose.score_test import Candidate, Score, changes_of, scored, signatures
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.effects.base import Starting
from smsid.errors import SmsidError
from smsid.estimation.filter_run import FilterRun
from smsid.estimation.map_estimate import Fit, continued, evaluate, fit, within_reach
from smsid.estimation.sensitivities import Sensitivity, propagate

LOGGER = logging.getLogger(__name__)
GRID, ONSETS, FINER = 16, 9, 4  # times an effect may begin at: at first, and of finer grids about the best
WEAK = 2  # finer grids for one too weak to show the very sample
DENSE = 160  # times where the first show something: where a torque changes sign, there are many maxima
STRONG = THRESHOLDS.beginning_strong
SHOWN = THRESHOLDS.beginnings_sought
POOR = THRESHOLDS.beginning_poor
COARSE = 5  # times at which all candidates are tried
ROOM = 1e7  # whitened values that are held at once: as fast as all of them, and they fit in memory
MOVED = THRESHOLDS.beginning_moved
MOVES = 4  # times it moves at most


def price(alias: float, tried: int = GRID + FINER * ONSETS) -> float:
    """Return what an onset has to gain in likelihood ratio: the grid it was searched on, and ``alias``."""
    return 2.0 * float(np.log(tried)) + alias


def best_start(
    current: Fit, ratios: Callable[[list[float]], Iterable[float]], about: Sequence[float], cheap: bool
) -> tuple[float, float, int]:
    """Return the beginning [s] of largest likelihood ratio, that ratio, and how many were tried.

    ``ratios`` are those of beginnings: on a grid and at the times ``about``, on a dense one where these show
    something and are ``cheap``, then on finer grids about the best one, to the sample where it is strong.
    """
    times, found = current.run.states.time, {}
    first, last = float(times[0]), float(times[-1])

    def look(some: Iterable[float]) -> float:
        new = sorted({step_from(current, float(t)) for t in some if first < t < last} - found.keys())
        found.update(zip(new, ratios(new) if new else (), strict=True))
        return max(found, key=found.__getitem__)

    best = look([*about, *_within(first, last, GRID)])
    dense = cheap and found[best] > SHOWN
    if dense:
        best = look(_within(first, last, DENSE))
    width = (last - first) / ((DENSE if dense else GRID) + 1)
    for _ in range(FINER if found[best] > STRONG else WEAK):
        width *= 2.0 / ONSETS
        best = look(best + width * (np.arange(ONSETS) - (ONSETS - 1) / 2.0))
    return best, found[best], len(found)


def with_onset(current: Fit, s: Score, alias: float) -> Score:
    """Return the score with the time its effect begins, where beginning midway explains clearly more.

    What the grid of times costs is paid in the criterion. Of a strong one the score without a beginning is
    kept as `Score.another`: linear about the motion without the effect, a thousandth of a large ratio may
    make up a beginning. Where an effect of its name is there already, it begins as one of its own, which may
    be one that cannot be: `Score.another` is kept then, too.
    """
    if not _may_begin(s.candidate):
        return s
    everywhere = replace(s.candidate, recording="") if s.candidate.recording else s.candidate
    begins = everywhere.apart({e.name for e in current.point.description.effect})
    try:
        own = changes_of(current, begins) if _may_be_cut(begins) else None
    except SmsidError as error:
        LOGGER.info("%s does not begin beside its own effect: %s", s.candidate.key, error)
        return s
    known: dict[float, Score] = {}

    def ratios(starts: list[float]) -> Iterator[float]:
        tried = [_from(begins, t) for t in starts]
        if own is None:
            columns = signatures(current, tried)
            scores = scored(current, [tried[i] for i in columns], list(columns.values()))
        else:
            scores = _cut_scores(current, [(c, own, t) for c, t in zip(tried, starts, strict=True)])
        known.update((_start(x.candidate), x) for x in scores)
        return (known[t].ratio if t in known else -np.inf for t in starts)

    start, ratio, tried = best_start(current, ratios, [largest_innovation_time(current.run)], own is not None)
    if not ratio - s.ratio > price(alias, tried + 1):
        return s
    best = replace(known[start], candidate=replace(known[start].candidate, grid=tried + 1))
    return best if ratio < STRONG and begins is s.candidate else replace(best, another=s)


def best_onsets(current: Fit, scores: Sequence[Score], count: int) -> list[Score]:
    """Return the scores of the ``count`` candidates that explain most when they begin midway, one a place.

    Of several shapes of one effect at one place it is that with the largest criterion.

    Looked at are a coarse grid and the loudest sample, at which a sensor that jumps does so: what a candidate
    does from a time on is what it does all the time, cut off before.
    """
    tried = [s for s in scores if s.freedom and _may_begin(s.candidate) and _may_be_cut(s.candidate)]
    times = current.run.states.time
    marks = [
        *np.linspace(times[0], times[-1], COARSE + 2)[1:-1].tolist(),
        largest_innovation_time(current.run),
    ]
    every = [(s.candidate, changes_of(current, s.candidate), t) for s in tried for t in marks]
    ratios = np.array([x.ratio for x in _cut_scores(current, every)])
    best = ratios.reshape(len(tried), len(marks)).max(axis=1, initial=0.0)
    price = float(np.log(current.run.samples))
    places: dict[tuple[str, str], int] = {}
    for i in sorted(range(len(tried)), key=lambda i: tried[i].freedom * price - best[i]):
        places.setdefault((tried[i].candidate.kind, tried[i].candidate.location), i)
    chosen = sorted(places.values(), key=lambda i: -best[i])[:count]
    return [tried[i] for i in chosen if best[i] > tried[i].ratio]


def largest_innovation_time(run: FilterRun) -> float:
    """Return the time [s] of the sample with the largest sum of squared innovations; not the first one's."""
    squares = (run.innovations**2).sum(axis=1)
    return float(run.states.time[1 + int(np.argmax(squares[1:]))])


def is_poor_fit(found: Fit) -> bool:
    """Whether a fit leaves so much that the curvature of its parameters may hide what it could reach."""
    samples = found.run.samples
    return float((found.run.innovations**2).sum()) - samples > POOR * np.sqrt(2.0 * samples)


def always(current: Fit, score: Score, alias: float) -> tuple[Score, Fit]:
    """Return a cause's score and the fit with it there all the time, where its onset no longer pays.

    The onset may have made up for another cause, found since.
    """
    (score,), current = always_together(current, [score], alias)
    return score, current


def always_together(current: Fit, scores: Sequence[Score], alias: float) -> tuple[list[Score], Fit]:
    """Return the scores of causes and the fit with all of them there all the time, where their onsets do not
    pay what each of them costs: of two that began beside a third, now gone, each may hold up the other's.
    """
    late = [s for s in scores if begins_midway(s)]
    if not late:
        return list(scores), current
    names, plain = [s.candidate.key for s in late], current.point
    pays = len({s.candidate.effect.name for s in late if s.candidate.effect}) * price(alias)
    for s in late:
        assert s.candidate.effect is not None
        mine = plain.description.get_effect(s.candidate.effect.name)
        plain = plain.with_effect(mine.model_copy(update={"start": None}))
    try:
        found = evaluate(plain, current.unknowns, current.problem)
        if 2.0 * (within_reach(found) - current.objective) > pays:
            return list(scores), current
        found = continued(found, iterations=8, at_most=current.objective + 0.5 * pays)
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("%s are not there all the time: %s", names, error)
        return list(scores), current
    if 2.0 * (found.objective - current.objective) > pays:
        return list(scores), current
    LOGGER.info("there all the time: %s", names)
    return [_plain(s) if begins_midway(s) else s for s in scores], found


def begins_midway(score: Score) -> bool:
    """Whether what a score is of begins midway."""
    return getattr(score.candidate.effect, "start", None) is not None


def _plain(score: Score) -> Score:
    assert score.candidate.effect is not None
    effect = score.candidate.effect.model_copy(update={"start": None})
    return replace(score, candidate=replace(score.candidate, effect=effect, grid=1))


def sync_onset(current: Fit, score: Score) -> Score:
    """Return the score of a cause that begins when its effect does, which may be another cause's, too."""
    effect = score.candidate.effect
    start = None if effect is None else getattr(score.candidate.instance(current.point), "start", None)
    if effect is None or not effect.may_begin or getattr(effect, "start", None) == start:
        return score
    if start is None:
        return _plain(score)
    effect = effect.model_copy(update={"start": start})
    return replace(score, candidate=replace(score.candidate, effect=effect))


def refine_onset(current: Fit, score: Score) -> tuple[Score, Fit]:
    """Return a cause's score and the fit with its beginning moved to where the fit is best.

    The score that found it is linear about the motion without the cause, where a large effect is curved. The
    effect may be another cause's, too, and no longer begin.
    """
    effect = score.candidate.effect
    if effect is None or not begins_midway(score):
        return score, current
    for _ in range(MOVES):
        mine = cast(Starting, current.point.description.get_effect(effect.name))
        if mine.start is None:
            return sync_onset(current, score), current
        start, gain = moved_start(current, mine)
        if gain < MOVED:
            break
        try:
            point = current.point.with_effect(mine.model_copy(update={"start": start}))
            found = fit(point, current.unknowns, current.problem, iterations=8)
        except (SmsidError, np.linalg.LinAlgError) as error:
            LOGGER.info("%s does not begin at %.4g s: %s", score.candidate.key, start, error)
            break
        gained = 2.0 * (current.objective - found.objective)
        LOGGER.info("%s begins at %.4g s: %.1f gained", score.candidate.key, start, gained)
        if gained <= 0.0:
            break
        effect = effect.model_copy(update={"start": start})
        score = replace(score, candidate=replace(score.candidate, effect=effect))
        current = found
    return score, current


def moved_start(current: Fit, mine: Starting) -> tuple[float, float]:
    """Return when a fitted effect begins best, and the likelihood ratio that gains, to first order.

    The effect is taken out of the fit and put back from another time on, as large as it then explains most.
    """
    starts = Starts(current, mine)
    before = float(starts.ratios([starts.start])[0])
    start, ratio, _ = best_start(current, starts.ratios, [starts.start], cheap=True)
    return (start, ratio - before) if ratio > before else (starts.start, 0.0)


def step_from(current: Fit, time: float) -> float:
    """Return the beginning [s] of the next step of the integration: what begins within one acts from then on.

    Where steps become shorter, it still does.
    """
    times = current.run.states.time
    k = min(max(int(np.searchsorted(times, time)), 1), len(times) - 1)
    before = float(times[k - 1])
    step = (float(times[k]) - before) / current.changes.applied.means.shape[1]
    return before + step * float(np.ceil((time - before) / step - 1e-6))


def _may_begin(candidate: Candidate) -> bool:
    effect = candidate.effect
    return effect is not None and effect.may_begin and getattr(effect, "start", None) is None


def _may_be_cut(candidate: Candidate) -> bool:
    effect = candidate.effect
    return type(candidate) is Candidate and effect is not None and not getattr(effect, "grows", True)


def _from(candidate: Candidate, start: float) -> Candidate:
    assert candidate.effect is not None
    return replace(candidate, effect=candidate.effect.model_copy(update={"start": start}))


def _within(first: float, last: float, count: int) -> np.ndarray:
    """Return so many times evenly between two."""
    return np.linspace(first, last, count + 2)[1:-1]


def _start(candidate: Candidate) -> float:
    return float(getattr(candidate.effect, "start", np.nan))


def _cut_scores(
    current: Fit, tried: Sequence[tuple[Candidate, Sequence[Sensitivity], float]]
) -> Iterator[Score]:
    """Give the scores of candidates whose changes begin at times, as many at once as there is room for."""
    run, first = current.run, 0
    room = max(1, int(ROOM / run.innovations.size))
    widths = np.cumsum([0, *(len(own) for _, own, _ in tried)])
    while first < len(tried):
        last = max(first + 1, int(np.searchsorted(widths, widths[first] + room, side="right")) - 1)
        some = tried[first:last]
        changes = [cut_sensitivity(c, run, start) for _, own, start in some for c in own]
        whole = propagate(run, changes).reshape(-1, len(changes))
        parts = np.split(whole, (widths[first + 1 : last] - widths[first]).tolist(), axis=1)
        yield from scored(current, [c for c, _, _ in some], parts)
        first = last
