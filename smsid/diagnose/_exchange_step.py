"""Causes judged again beside the others: one chosen while another was still hidden may be the wrong one, and
one that others, found later, made unnecessary is left out.
"""

from __future__ import annotations

import logging
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from smsid.diagnose._plausibility import impossible_fit
from smsid.diagnose._wald_test import chance_of_nothing, each_may_be_zero, strengths, wald
from smsid.diagnose._without_cause import (
    columns_by_key,
    fit_without_cause,
    rivals_beside,
    score_of_cause,
    without_cause,
)
from smsid.diagnose.model_comparison import Cause, aliases_of, cost, is_distinguishable, refit
from smsid.diagnose.score_test import Candidate, Score, score_candidates
from smsid.diagnose.thresholds import THRESHOLDS, DetectionThresholds
from smsid.errors import SmsidError
from smsid.estimation.map_estimate import MapFit, fit

LOGGER = logging.getLogger(__name__)


def exchange_step(
    causes: Sequence[Cause],
    last: MapFit,
    nominal: MapFit,
    candidates: Sequence[Candidate],
    levels: DetectionThresholds,
    *,
    exchange: bool = True,
    last_too: bool = False,
    settled: Collection[tuple[str, str, str]] = (),
) -> tuple[list[Cause], MapFit]:
    """Return the causes, a clearly better rival in the place of one that has such, and their aliases anew.

    Without ``exchange`` they stay and their aliases alone are judged: where misfit is counted, what a rival
    gains may be of that.

    Each is taken out of the fit - to first order, but where it has motion of its own - and the candidates are
    scored on what it leaves, beside the other causes, by what they do along the motion as it is now: nominal
    parameters that stood in for the causes moved, and a ten-thousandth of what these took tells rivals
    apart. What was searched for is among them itself: its place and phase may be others beside the rest. The
    last cause was chosen so; with ``last_too``, where the noise has become finer since, or it was chosen
    beside others, it is judged again as well. Those ``settled``, by key, stay as they are.
    """
    causes, columns = list(causes), {}
    for i, cause in enumerate(causes if last_too else causes[:-1]):
        if cause.score.candidate.key in settled:
            continue
        taken = {c.score.candidate.key for c in causes}
        less = fit_without_cause(last, cause, nominal)
        if less is None:
            continue
        if less.point.model().nv != last.changes.model.nv:
            known = columns_by_key(less, candidates)
        else:
            columns = known = columns or columns_by_key(last, candidates)
        own = score_of_cause(last, less, cause)
        if type(cause.score.candidate) is not Candidate:
            taken.discard(cause.score.candidate.key)
        others = [c for c in causes if c is not cause]
        rivals = [c for c in rivals_beside(candidates, others) if c.key in known and c.key not in taken]
        scores = score_candidates(less, rivals, [known[c.key] for c in rivals])
        better = _best_rival_fit(less, last, own, scores, levels) if exchange else None
        if better is not None:
            LOGGER.info("%s instead of %s", better[0].candidate.key, cause.score.candidate.key)
            own, last, columns = *better, {}
        samples = last.run.samples
        # less what the parameters cost that it freed beside those it was scored with
        paid = replace(own, ratio=2.0 * own.ratio - own.information_gain(samples) - cost(less, own, last))
        near = [s for s in scores if s.candidate.key != own.candidate.key]
        near = [s for s in near if not is_distinguishable(paid, s, samples, levels)]
        near.sort(key=lambda s: -s.odds(samples))
        judged = Cause.of(own, aliases_of(paid, near, samples), own.ratio).with_own_columns()
        if better is not None:
            cause = judged
        causes[i] = replace(cause, aliases=judged.aliases, equivalent=judged.equivalent)
    return causes, last


def recompute_evidence(causes: Sequence[Cause], last: MapFit, nominal: MapFit) -> list[Cause]:
    """Return the causes with the ratios they have in a fit to finer noise than they were found with.

    Each beside the others, to first order; one that has motion of its own, or cannot be taken out, as
    `exchange_step` has it. No ratio is smaller than it was.
    """
    causes = list(causes)
    for i, cause in enumerate(causes):
        less = fit_without_cause(last, cause, nominal)
        if less is None:
            continue
        own = score_of_cause(last, less, cause)
        LOGGER.info("%s: ratio %.1f, now %.1f", cause.score.candidate.key, cause.ratio, own.ratio)
        causes[i] = replace(cause, ratio=max(cause.ratio, own.ratio))
    return causes


def _best_rival_fit(
    less: MapFit, last: MapFit, own: Score, scores: Sequence[Score], levels: DetectionThresholds
) -> tuple[Score, MapFit] | None:
    """Return the best rival and its fit where it gains clearly more than the cause, refitted too."""
    samples = last.run.samples
    best = max((s for s in scores if s.freedom), key=lambda s: s.information_gain(samples), default=None)
    if best is None or best.information_gain(samples) - own.ratio + cost(less, own, last) < levels.alias:
        return None
    found = refit(less, best)
    if found is None:
        return None
    gained = 2.0 * (last.objective - found.objective)
    paid = cost(less, best, found) - cost(less, own, last)
    LOGGER.info("%s for %s: gains %.1f", best.candidate.key, own.candidate.key, gained - paid)
    if gained - paid < levels.alias:
        return None
    return replace(best, ratio=own.ratio + gained), found


def eliminate_backward(
    causes: list[Cause],
    last: MapFit,
    nominal: MapFit,
    levels: DetectionThresholds,
    tried: int,
    proven: Collection[tuple[str, str, str]] = (),
    recheck: Collection[tuple[str, str, str]] = (),
) -> tuple[list[Cause], MapFit]:
    """Leave out causes that the others made unnecessary, by Wald's statistic: of all parameters, or of those
    that make it do something; or as each of these may be zero by itself.

    One that is far from doing nothing as far as its further parameters are what they are (the gap of a
    backlash, which goes with the torque of its crossing) is left out only where it is not missed. Those
    ``proven``, by key, where misfit did not hide them, stay unless they may as well be nothing. Those to
    ``recheck`` were chosen beside a cause that was replaced since, and may make up for what it lacked: a fit
    without them tells whether they are missed, however far they are from nothing. One that has come to a
    value that cannot be is the first to go, missed or not: beside it the others bend.
    """

    def is_absurd(cause: Cause) -> bool:
        return bool(impossible_fit(last, cause.score.candidate))

    def doubtful(cause: Cause) -> bool:
        own = cause.score.candidate
        if is_absurd(cause) or own.key in recheck or each_may_be_zero(last, own):
            return True
        whole = float(chi2.sf(wald(last, own), len(own.free)))
        alone = float(chi2.sf(wald(last, own, strength=True), sum(strengths(own))))
        if own.key in proven:
            return max(whole, alone) > THRESHOLDS.nested
        return 0.5 * cause.score.sides * tried * max(whole, alone) > levels.candidate

    needed: list[Cause] = []
    while len(causes) > 1:
        doubted = [c for c in causes if doubtful(c) and not any(c is n for n in needed)]
        if not doubted:
            break
        worst = min(doubted, key=lambda c: (not is_absurd(c), wald(last, c.score.candidate)))
        try:
            less = without_cause(last, worst.score.candidate, nominal)
            rest = fit(less.point, less.unknowns, last.problem, iterations=20)
        except (SmsidError, np.linalg.LinAlgError) as error:  # without a cause the recording is lost
            LOGGER.info("not without %s: %s", worst.score.candidate.key, error)
            needed.append(worst)
            continue
        if not is_absurd(worst) and _is_needed(
            worst, last, rest, levels, tried, max(c.ratio for c in causes)
        ):
            LOGGER.info("%s is missed", worst.score.candidate.key)
            needed.append(worst)
        else:
            causes, last = [c for c in causes if c is not worst], rest
    return causes, last


def _is_needed(
    cause: Cause, last: MapFit, rest: MapFit, levels: DetectionThresholds, tried: int, strongest: float
) -> bool:
    """Whether the fit ``rest`` without a cause explains clearly less than ``last``, which has it."""
    own, score = cause.score.candidate, cause.score
    if 0.5 * score.sides * tried * chance_of_nothing(last, own, rest, held=True) > levels.candidate:
        return False  # it ran away
    lost = 2.0 * (rest.objective - last.objective)
    names = {u.name for u in last.unknowns}
    by_chance = tried * own.grid * float(chi2.sf(lost, len(own.free) + len(names & set(own.also))))
    return lost > levels.beside * strongest and by_chance <= levels.candidate
