"""Effects that begin midway: when, whether they do, and which candidates only a beginning shows."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from smsid.diagnose._change_time_posterior import Starts, cut_sensitivity, step_from
from smsid.diagnose._onset_scan import onset_ratios
from smsid.diagnose.model_comparison import Cause
from smsid.diagnose.score_test import Candidate, Score, changes_of, score_candidates, signatures
from smsid.diagnose.thresholds import THRESHOLDS, DetectionThresholds
from smsid.effects.base import Starting
from smsid.errors import SmsidError
from smsid.estimation.filter_run import FilterRun
from smsid.estimation.map_estimate import MapFit, continue_fit, evaluate, fit, within_reach
from smsid.estimation.sensitivities import Sensitivity, propagate

LOGGER = logging.getLogger(__name__)
GRID, ONSETS, FINER = 16, 9, 4  # times an effect may begin at: at first, and of finer grids about the best
WEAK = 2  # finer grids for one too weak to show the very sample
DENSE = 160  # times where the first show something: where a torque changes sign, there are many maxima
MOVES = 4  # times it moves at most


def onset_penalty(alias: float, tried: int = GRID + FINER * ONSETS) -> float:
    """Return what an onset has to gain in likelihood ratio: the grid it was searched on, and ``alias``."""
    return 2.0 * float(np.log(tried)) + alias


def best_start(
    current: MapFit, ratios: Callable[[list[float]], Iterable[float]], about: Sequence[float], cheap: bool
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

    best = look([*about, *_times_between(first, last, GRID)])
    dense = cheap and found[best] > THRESHOLDS.beginnings_sought
    if dense:
        best = look(_times_between(first, last, DENSE))
    width = (last - first) / ((DENSE if dense else GRID) + 1)
    for _ in range(FINER if found[best] > THRESHOLDS.linear else WEAK):
        width *= 2.0 / ONSETS
        best = look(best + width * (np.arange(ONSETS) - (ONSETS - 1) / 2.0))
    return best, found[best], len(found)


@dataclass(frozen=True)
class Onsets:
    """A candidate that begins, perhaps as an effect of its own, with its changes, and the likelihood ratios
    (2 N - 1,) of beginnings at the samples of a run and the middles between them.
    """

    candidate: Candidate
    changes: Sequence[Sensitivity]
    ratios: np.ndarray


def scan_onsets(current: MapFit, scores: Sequence[Score]) -> dict[tuple[str, str, str], Onsets]:
    """Return the beginnings of all candidates whose changes can be cut off before, by their keys.

    What such a candidate does from a time on is what it does all the time, cut off before. Where an effect of
    its name is there already, it begins as one of its own.
    """
    names = {e.name for e in current.point.description.effect}
    found: list[tuple[tuple[str, str, str], Candidate, Sequence[Sensitivity]]] = []
    for c in (s.candidate for s in scores if _may_begin(s.candidate) and _may_be_cut(s.candidate)):
        begins = (replace(c, recording="") if c.recording else c).apart(names)
        try:
            found.append((c.key, begins, changes_of(current, begins)))
        except SmsidError as error:
            LOGGER.info("%s does not begin beside its own effect: %s", c.key, error)
    found = [x for x in found if x[2]]
    ratios = onset_ratios(current, [own for *_, own in found], [c.one_sided for _, c, _ in found])
    return {key: Onsets(c, own, r) for (key, c, own), r in zip(found, ratios, strict=True)}


def with_onset(
    current: MapFit, s: Score, alias: float, onsets: Mapping[tuple[str, str, str], Onsets] | None = None
) -> Score:
    """Return the score with the time its effect begins, where beginning midway explains clearly more.

    What the times that were tried cost is paid in the criterion. Of a strong one the score without a
    beginning is kept as `Score.another`: linear about the motion without the effect, a thousandth of a large
    ratio may make up a beginning. Where an effect of its name is there already, it begins as one of its own,
    which may be one that cannot be: `Score.another` is kept then, too. ``onsets``: those of `scan_onsets`, if
    they are known.
    """
    if not _may_begin(s.candidate):
        return s
    known: dict[float, Score] = {}
    if _may_be_cut(s.candidate):
        own = (scan_onsets(current, [s]) if onsets is None else onsets).get(s.candidate.key)
        if own is None:
            return s
        begins, times = own.candidate, current.run.states.time
        best = len(own.ratios) - 1 - int(np.argmax(own.ratios[:0:-1]))  # of several alike the last
        k, within = divmod(best, 2)  # between samples acts what begins with the first step there
        start = step_from(current, float(times[k] + (0.1 * (times[k + 1] - times[k]) if within else 0.0)))
        tried = len(times)
        score = cut_score(current, _from(begins, start), own.changes, start)
        known[start], ratio = score, score.ratio
    else:
        everywhere = replace(s.candidate, recording="") if s.candidate.recording else s.candidate
        begins = everywhere.apart({e.name for e in current.point.description.effect})

        def ratios(starts: list[float]) -> Iterator[float]:
            tried = [_from(begins, t) for t in starts]
            columns = signatures(current, tried)
            scores = score_candidates(current, [tried[i] for i in columns], list(columns.values()))
            known.update((float(x.candidate.start or 0.0), x) for x in scores)
            return (known[t].ratio if t in known else -np.inf for t in starts)

        about = [largest_innovation_time(current.run)]
        start, ratio, tried = best_start(current, ratios, about, cheap=False)
    if not ratio - s.ratio > onset_penalty(alias, tried + 1):
        return s
    found = replace(known[start], candidate=replace(known[start].candidate, grid=tried + 1))
    return found if ratio < THRESHOLDS.linear and begins is s.candidate else replace(found, another=s)


def best_onsets(
    current: MapFit,
    scores: Sequence[Score],
    count: int,
    onsets: Mapping[tuple[str, str, str], Onsets] | None = None,
) -> list[Score]:
    """Return the scores of the ``count`` candidates that explain most when they begin midway, one a place.

    Of several shapes of one effect at one place it is that with the largest criterion. ``onsets``: those of
    `scan_onsets`, if they are known.
    """
    onsets = scan_onsets(current, scores) if onsets is None else onsets
    tried = [s for s in scores if s.freedom and s.candidate.key in onsets]
    best = np.array([onsets[s.candidate.key].ratios[1:].max(initial=0.0) for s in tried])
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


def always_together(current: MapFit, scores: Sequence[Score], alias: float) -> tuple[list[Score], MapFit]:
    """Return the scores of causes and the fit with all of them there all the time, where their onsets no
    longer pay what each of them costs: they may have made up for another cause, found since, and of two that
    began beside a third, now gone, each may hold up the other's.
    """
    late = [s for s in scores if s.candidate.start is not None]
    if not late:
        return list(scores), current
    names, plain = [s.candidate.key for s in late], current.point
    pays = len({s.candidate.effect.name for s in late if s.candidate.effect}) * onset_penalty(alias)
    for s in late:
        assert s.candidate.effect is not None
        mine = plain.description.get_effect(s.candidate.effect.name)
        plain = plain.with_effect(mine.model_copy(update={"start": None}))
    try:
        found = evaluate(plain, current.unknowns, current.problem)
        if 2.0 * (within_reach(found) - current.objective) > pays:
            return list(scores), current
        found = continue_fit(found, iterations=8, at_most=current.objective + 0.5 * pays)
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("%s are not there all the time: %s", names, error)
        return list(scores), current
    if 2.0 * (found.objective - current.objective) > pays:
        return list(scores), current
    LOGGER.info("there all the time: %s", names)
    return [_plain(s) if s.candidate.start is not None else s for s in scores], found


def _plain(score: Score) -> Score:
    assert score.candidate.effect is not None
    effect = score.candidate.effect.model_copy(update={"start": None})
    return replace(score, candidate=replace(score.candidate, effect=effect, grid=1))


def sync_onset(current: MapFit, score: Score) -> Score:
    """Return the score of a cause that begins when its effect does, which may be another cause's, too."""
    effect = score.candidate.effect
    start = None if effect is None else getattr(score.candidate.instance(current.point), "start", None)
    if effect is None or not effect.may_begin or score.candidate.start == start:
        return score
    if start is None:
        return _plain(score)
    effect = effect.model_copy(update={"start": start})
    return replace(score, candidate=replace(score.candidate, effect=effect))


def refine_onset(current: MapFit, score: Score) -> tuple[Score, MapFit]:
    """Return a cause's score and the fit with its beginning moved to where the fit is best.

    The score that found it is linear about the motion without the cause, where a large effect is curved. The
    effect may be another cause's, too, and no longer begin.
    """
    effect = score.candidate.effect
    if effect is None or score.candidate.start is None:
        return score, current
    for _ in range(MOVES):
        mine = cast(Starting, current.point.description.get_effect(effect.name))
        if mine.start is None:
            return sync_onset(current, score), current
        start, gain = moved_start(current, mine)
        if gain < THRESHOLDS.beginning_moved:
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


def moved_start(current: MapFit, mine: Starting) -> tuple[float, float]:
    """Return when a fitted effect begins best, and the likelihood ratio that gains, to first order.

    The effect is taken out of the fit and put back from another time on, as large as it then explains most.
    """
    starts = Starts(current, mine)
    before = float(starts.ratios([starts.start])[0])
    start, ratio, _ = best_start(current, starts.ratios, [starts.start], cheap=True)
    return (start, ratio - before) if ratio > before else (starts.start, 0.0)


def _may_begin(candidate: Candidate) -> bool:
    effect = candidate.effect
    return effect is not None and effect.may_begin and candidate.start is None


def _may_be_cut(candidate: Candidate) -> bool:
    effect = candidate.effect
    return type(candidate) is Candidate and effect is not None and not getattr(effect, "grows", True)


def _from(candidate: Candidate, start: float) -> Candidate:
    assert candidate.effect is not None
    return replace(candidate, effect=candidate.effect.model_copy(update={"start": start}))


def _times_between(first: float, last: float, count: int) -> np.ndarray:
    """Return so many times evenly between two."""
    return np.linspace(first, last, count + 2)[1:-1]


def cut_score(current: MapFit, candidate: Candidate, changes: Sequence[Sensitivity], start: float) -> Score:
    """Return the score of a candidate whose changes begin at a time."""
    run = current.run
    columns = propagate(run, [cut_sensitivity(c, run, start) for c in changes])
    return score_candidates(current, [candidate], [columns.reshape(-1, len(changes))])[0]


def drop_onset(
    causes: Sequence[Cause], current: MapFit, levels: DetectionThresholds
) -> tuple[list[Cause], MapFit]:
    """Return the causes and the fit, those there all the time whose onset does not pay beside the others.

    One after the other, then all that are left together.
    """
    scores, found = [c.score for c in causes], current
    for i, score in enumerate(scores):
        (scores[i],), found = always_together(found, [score], levels.onset)
    if sum(s.candidate.start is not None for s in scores) > 1:
        scores, found = always_together(found, scores, levels.onset)
    return [replace(c, score=s) for c, s in zip(causes, scores, strict=True)], found
