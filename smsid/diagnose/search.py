"""The search for causes: fit what is uncertain, score every candidate, fit the best, again, and prune."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from smsid.diagnose.accept import Cause, Levels, accept
from smsid.diagnose.blocks import PAST, Block, adequacy
from smsid.diagnose.candidates import Candidate, Score, scored, signatures
from smsid.diagnose.erratic import erratic
from smsid.diagnose.exchange import judged_again, sought_again
from smsid.diagnose.filter import Problem
from smsid.diagnose.fit import Fit
from smsid.diagnose.foreign import motion_left
from smsid.diagnose.further import freed, freed_instead
from smsid.diagnose.memory import memory
from smsid.diagnose.noise import fit_with_noise, refitted, strayed
from smsid.diagnose.onset import (
    always,
    always_together,
    beginning,
    begins_midway,
    poor,
    settled,
    with_onset,
)
from smsid.diagnose.point import Point, Unknown
from smsid.diagnose.prune import pruned
from smsid.diagnose.stepping import finely_stepped
from smsid.errors import RecordingError

LOGGER = logging.getLogger(__name__)
CLEAR = 60.0  # likelihood ratio, twice that of what is just found, above which beginnings are sought for all
RESTLESS = 5  # times at most that a search goes on from a better fit that a candidate led to
LOST = 1.0  # share of the motion the fitted nominal model may leave before no cause is looked for


@dataclass(frozen=True)
class Search:
    """How a search ended: the fit of the nominal parameters alone, the last fit, causes and tests.

    ``scores`` are those of the last round, the best first; ``before`` are the generic tests of the nominal
    model, ``blocks`` those with the causes. ``noise`` are noise levels over the stated ones by channel, as
    fitted; with ``misfit`` they count what the model cannot follow. ``strayed`` are rms of the prediction
    errors over the stated noise, before and after. ``coarse`` are components read in steps.
    """

    nominal: Fit
    last: Fit
    causes: tuple[Cause, ...]
    scores: tuple[Score, ...]
    before: tuple[Block, ...]
    blocks: tuple[Block, ...]
    candidates: int
    samples: int
    noise: dict[str, float]
    misfit: bool = False
    strayed: tuple[float, float] = (1.0, 1.0)
    seconds: dict[str, float] = field(default_factory=dict)
    levels: Levels = field(default_factory=Levels)
    coarse: frozenset[str] = frozenset()

    @property
    def left(self) -> tuple[Block, ...]:
        """The generic tests that are still significant."""
        return _significant(self.blocks, self.causes, self.levels, self.coarse, white=not self.misfit)

    @property
    def left_before(self) -> tuple[Block, ...]:
        """The generic tests that are significant without any cause."""
        return _significant(self.before, (), self.levels, self.coarse, white=not self.misfit)

    @property
    def followed(self) -> float:
        """Share of the squared prediction errors, in stated noise, that the causes take away."""
        before, after = self.strayed
        return 1.0 - (after / before) ** 2


def search(
    point: Point,
    problem: Problem,
    unknowns: Sequence[Unknown],
    candidates: Sequence[Candidate],
    levels: Levels | None = None,
    coarse: frozenset[str] = frozenset(),
) -> Search:
    """Return the causes that explain a recording, found one after the other.

    ``coarse`` names the components of channels that are read in steps: their errors are not white.

    Raises `SimulationError` when the nominal model cannot be filtered at all, `RecordingError` when it
    predicts nothing of the motion.
    """
    levels = levels or Levels()
    clock = {"nominal": time.process_time()}
    fitted = fit_with_noise(point, problem, tuple(unknowns))
    nominal, current, causes = fitted.fit, fitted.fit, []
    strayed_before = strayed(fitted.fit.run, fitted.factors)
    if fitted.misfit and motion_left(nominal, fitted.by_channel) > LOST:
        raise RecordingError(
            "The model predicts the motion worse than no motion would, with its parameters fitted.",
            advice="Is the recording of another spacecraft? Check the signs and the order of the commands.",
            recording=problem.recording.name,
        )
    clock["search"] = time.process_time()
    rest = list(candidates)
    columns: dict[tuple[str, str, str], np.ndarray] = {}
    scores = _scores(current, rest, columns)
    held: tuple[Block, ...] = ()
    again = 0

    def counts(s: Score) -> bool:
        """Whether there is something; odds order what counts, they do not decide."""
        return bool(s.freedom) and s.p_value * len(candidates) < asked.candidate

    while True:
        asked = levels.beside_a_cause if causes else levels
        if fitted.misfit:  # ratios count what is not followed: small ones may be of large effects
            asked = replace(asked, linear=0.0)
        least = levels.beside * max((c.ratio for c in causes), default=0.0)
        best = next((s for s in scores if s.ratio > least and counts(s)), None)
        if best is None or len(causes) == levels.causes:
            break
        leading = [best, *(s for s in scores if s is not best)][: levels.contenders]
        if best.ratio > min(CLEAR, levels.linear):  # enough for what is there in part to pass as another
            known = {s.candidate.key for s in leading}
            more = beginning(current, scores, levels.contenders)
            leading += [s for s in more if s.candidate.key not in known]
        begun = [with_onset(current, s, levels.onset) for s in leading]
        leading = [s for s in begun if counts(s)] or [best]
        best = max(leading, key=lambda s: s.odds(current.run.samples))
        gain = best.information_gain(current.run.samples)
        if not fitted.misfit:  # else the tests do not decide
            held = _held(current, causes, gain, levels.block / len(candidates))
        if held:  # the next would stand in for a piece of it
            break
        larger = freed_instead(current, causes, best, levels)
        if larger is not None:
            gained = 2.0 * (current.objective - larger.objective)
            current.changes.by_candidate.clear()
            fitted = refitted(replace(fitted, fit=larger), strong=gained > levels.linear)
            current = fitted.fit
            columns.clear()
            scores = _scores(current, rest, columns)
            continue
        own = {s.candidate.key: s for s in begun}
        rivals = [own.get(s.candidate.key, s) for s in scores]
        rivals.sort(key=lambda s: -s.odds(current.run.samples))
        cause, found = accept(current, best, rivals, asked, len(candidates))
        better = 2.0 * (current.objective - found.objective) > levels.linear
        if cause is None and better and again < RESTLESS:
            again += 1
            LOGGER.info("the fit had not come to rest: %.1f to %.1f", current.objective, found.objective)
            fitted = refitted(replace(fitted, fit=found), strong=True)
            current.changes.by_candidate.clear()
            current = fitted.fit
            if not causes:  # it is of the nominal parameters alone
                nominal, strayed_before = current, strayed(current.run, fitted.factors)
            columns.clear()
            named = {c.score.candidate.key for c in causes}
            rest = [c for c in candidates if c.key not in named]
            scores = _scores(current, rest, columns)
            continue
        if cause is None:
            rest = [c for c in rest if c.key != best.candidate.key]
            scores = [s for s in scores if s.candidate.key != best.candidate.key]
            continue
        moved, found = settled(found, cause.score)
        cause = replace(cause, score=moved)
        if poor(found):  # perhaps as the cause was there all the time
            still, found = always(found, cause.score, levels.onset)
            cause = replace(cause, score=still)
        causes, found = _there_always(causes, found, levels)
        within = [c for c in causes if cause.score.candidate.holds(c.score.candidate)]
        cause = replace(cause, ratio=cause.ratio + sum(c.ratio for c in within))
        causes = [*(c for c in causes if all(c is not w for w in within)), cause]
        reached = found.objective
        causes, found = sought_again(causes, found, nominal, candidates, levels)
        strong = max(cause.ratio, 2.0 * (reached - found.objective)) > levels.linear
        misfit = fitted.misfit
        fitted = refitted(replace(fitted, fit=found), strong=strong)
        if misfit and not fitted.misfit:  # only now are beginnings seen as sharply as the noise lets them
            for i, before in enumerate(causes):
                still, found = settled(fitted.fit, before.score)
                causes[i], fitted = replace(before, score=still), replace(fitted, fit=found)
        if strong:
            fitted = replace(fitted, fit=finely_stepped(fitted.fit))
        current.changes.by_candidate.clear()
        current = fitted.fit
        if strong or fitted.misfit:
            columns.clear()
        rest = [c for c in rest if c.key != cause.score.candidate.key]
        scores = _scores(current, rest, columns)
    reached = current
    causes, current = _there_always(causes, current, levels)
    if current is not reached:
        columns.clear()
        scores = _scores(current, rest, columns)
    if len(causes) > 1:
        reached, exchange = current, not fitted.misfit
        causes, current = judged_again(causes, current, nominal, candidates, levels, exchange=exchange)
        if current is not reached:  # what had begun beside another cause
            causes, current = _there_always(causes, current, levels)
    blocks = (*held, *adequacy(current))
    if not fitted.misfit and _significant(blocks, causes, levels, coarse):
        larger = freed(current, causes, levels.alias)
        tests_ = () if larger is None else (*held, *adequacy(larger))
        if larger is not None and not _significant(tests_, causes, levels, coarse):
            current, blocks = larger, tests_
            columns.clear()
            scores = _scores(current, rest, columns)
    if fitted.misfit or not _significant(blocks, causes, levels, coarse):  # else none of them is named anyway
        reached = current
        causes, current = pruned(causes, current, nominal, levels, len(candidates))
        if current is not reached:
            causes, current = _there_always(causes, current, levels)
        blocks = blocks if current is reached else (*held, *adequacy(current))
    clock["tests"] = time.process_time()
    before_causes = tuple(adequacy(nominal)) if causes else blocks
    sensor = fitted.alone and not causes
    if not (fitted.misfit or sensor) and _significant(blocks, causes, levels, coarse):  # of no law, perhaps
        before_causes = tuple(sorted((*before_causes, *erratic(nominal)), key=lambda b: b.order))
    end = time.process_time()
    seconds = {
        "nominal": clock["search"] - clock["nominal"],
        "search": clock["tests"] - clock["search"],
        "tests": end - clock["tests"],
    }
    return Search(
        nominal, current, tuple(causes), tuple(scores), before_causes, blocks, len(candidates),
        current.run.samples, fitted.by_channel, fitted.misfit,
        (strayed_before, strayed(current.run, fitted.factors)),
        seconds, levels, coarse,
    )  # fmt: skip


def _there_always(causes: Sequence[Cause], current: Fit, levels: Levels) -> tuple[list[Cause], Fit]:
    """Return the causes and the fit, those there all the time whose onset does not pay beside the others.

    One after the other, then all that are left together.
    """
    scores, found = [c.score for c in causes], current
    for i, score in enumerate(scores):
        scores[i], found = always(found, score, levels.onset)
    if sum(begins_midway(s) for s in scores) > 1:
        scores, found = always_together(found, scores, levels.onset)
    return [replace(c, score=s) for c, s in zip(causes, scores, strict=True)], found


def _significant(
    blocks: Sequence[Block],
    causes: Sequence[Cause],
    levels: Levels,
    coarse: frozenset[str],
    *,
    white: bool = True,
) -> tuple[Block, ...]:
    """Return the tests that are significant; misfit (not ``white``) and rounding need not be white."""
    least = levels.beside * max((c.ratio for c in causes), default=0.0)
    return tuple(
        b
        for b in blocks
        if b.p_value * len(blocks) < levels.block
        and b.ratio > least
        and (b.dependence != PAST or (white and b.where not in coarse))
    )


def _held(current: Fit, causes: Sequence[Cause], gain: float, level: float) -> tuple[Block, ...]:
    """Return the tests for memory at the joints of causes that gain more than the next candidate does."""
    tests = memory(current, [c.score.candidate.location for c in causes])
    samples = current.run.samples
    return tuple(t for t in tests if t.information_gain(samples) > gain and t.p_value < level)


def _scores(
    found: Fit, candidates: Sequence[Candidate], known: dict[tuple[str, str, str], np.ndarray]
) -> list[Score]:
    """Score the candidates, the best first; signatures already ``known`` are used again."""
    missing = [c for c in candidates if c.key not in known]
    if missing:
        known.update({missing[i].key: c for i, c in signatures(found, missing).items()})
    seen = [c for c in candidates if c.key in known]
    return sorted(
        scored(found, seen, [known[c.key] for c in seen]),
        key=lambda s: -s.odds(found.run.samples),
    )
