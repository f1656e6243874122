"""The search for causes: fit what is uncertain, score every candidate, fit the best, again, and prune."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import chi2

from smsid.diagnose.blocks import PAST, Block, adequacy
from smsid.diagnose.candidates import Candidate, Score, correlation, scored, signatures
from smsid.diagnose.filter import Problem
from smsid.diagnose.fit import Fit, fit
from smsid.diagnose.foreign import motion_left
from smsid.diagnose.noise import fit_with_noise, refitted, strayed
from smsid.diagnose.onset import always, beginning, with_onset
from smsid.diagnose.point import Point, Unknown
from smsid.errors import RecordingError, SmsidError

LOGGER = logging.getLogger(__name__)
LOST = 1.0  # share of the motion the fitted nominal model may leave before no cause is looked for
SURPLUS = 3.0  # how much more than its linear score a refitted candidate may gain without a second look


@dataclass(frozen=True)
class Levels:
    """Levels of significance, over all candidates and over all generic tests together; and the search's ends.

    ``alias`` is the difference of Bayes's criterion below which two candidates are not told apart (9.2: one
    is a hundred times as likely); ``linear`` the likelihood ratio up to which the linear score is believed
    without a refit of the contenders. ``beside`` is the share of the strongest cause's ratio below which
    what is left beside it may be how finely the model follows that cause (1.7 % of its size): no cause.
    """

    candidate: float = 0.003
    block: float = 0.001
    alias: float = 9.2
    linear: float = 400.0
    beside: float = 3e-4
    causes: int = 3
    contenders: int = 3


@dataclass(frozen=True)
class Cause:
    """An accepted candidate with its score, and those this experiment does not tell from it.

    ``aliases`` pairs scores with their correlation; ``ratio`` is the likelihood ratio after the refit;
    ``beside`` names the parameters that were fitted when it was scored.
    """

    score: Score
    aliases: tuple[tuple[Score, float], ...]
    ratio: float
    beside: tuple[str, ...]

    def score_beside(self, names: Sequence[str]) -> Score:
        """Return its score with other parameters fitted; what it takes of new ones is not known."""
        rows = dict(zip(self.beside, self.score.taken, strict=True))
        nothing = np.zeros(self.score.taken.shape[1])
        return replace(self.score, taken=np.array([rows.get(n, nothing) for n in names]))


@dataclass(frozen=True)
class Search:
    """How a search ended: the fit of the nominal parameters alone, the last fit, causes and tests.

    ``scores`` are those of the last round, the best first; ``blocks`` the generic tests after it. ``noise``
    are noise levels over the stated ones by channel, as fitted; with ``misfit`` they count what the model
    cannot follow. ``strayed`` are rms of the prediction errors over the stated noise, before and after.
    ``coarse`` are components read in steps.
    """

    nominal: Fit
    last: Fit
    causes: tuple[Cause, ...]
    scores: tuple[Score, ...]
    blocks: tuple[Block, ...]
    candidates: int
    samples: int
    noise: dict[str, float]
    misfit: bool = False
    strayed: tuple[float, float] = (1.0, 1.0)
    seconds: dict[str, float] = field(default_factory=dict)
    levels: Levels = Levels()
    coarse: frozenset[str] = frozenset()

    @property
    def left(self) -> tuple[Block, ...]:
        """The generic tests that are still significant; misfit and rounding are not white, nor need be."""
        n = len(self.blocks)
        counted = [
            b for b in self.blocks if b.dependence != PAST or not (self.misfit or b.where in self.coarse)
        ]
        least = self.levels.beside * max((c.ratio for c in self.causes), default=0.0)
        return tuple(b for b in counted if b.p_value * n < self.levels.block and b.ratio > least)

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
    before = strayed(fitted.fit.run, fitted.factors)
    if fitted.misfit and motion_left(nominal, fitted.by_channel) > LOST:
        raise RecordingError(
            "The model predicts the motion worse than no motion would, with its parameters fitted.",
            advice="Is the recording of another spacecraft? Check the signs and the order of the commands.",
            recording=problem.recording.name,
        )
    clock["search"] = time.process_time()
    rest = list(candidates)
    columns: dict[tuple[str, str, str], np.ndarray] = {}
    while True:
        scores = _scores(current, rest, columns)
        least = levels.beside * max((c.ratio for c in causes), default=0.0)
        best = _best([s for s in scores if s.ratio > least], len(candidates), current.run.samples, levels)
        if best is None or len(causes) == levels.causes:
            break
        leading = list(scores[: levels.contenders])
        if best.ratio > levels.linear:  # strong enough for something that is there in part to pass as another
            known = {s.candidate.key for s in leading}
            more = beginning(current, scores, levels.contenders)
            leading += [s for s in more if s.candidate.key not in known]
        leading = [with_onset(current, s, levels.alias) for s in leading]
        best = max(leading, key=lambda s: s.information_gain(current.run.samples))
        accepted = _accept(current, best, scores, levels)
        if accepted is None:
            rest = [c for c in rest if c.key != best.candidate.key]
            continue
        cause, found = accepted
        causes.append(cause)
        strong = cause.ratio > levels.linear
        fitted = refitted(replace(fitted, fit=found), strong=strong)
        current = fitted.fit
        if strong or fitted.misfit:
            columns.clear()
        rest = [c for c in rest if c.key != cause.score.candidate.key]
    for i, cause in enumerate(causes):
        still, current = always(current, cause.score, levels.alias)
        causes[i] = replace(cause, score=still)
    causes, current = _pruned(causes, current, nominal, levels, len(candidates))
    clock["tests"] = time.process_time()
    blocks = adequacy(current)
    end = time.process_time()
    seconds = {
        "nominal": clock["search"] - clock["nominal"],
        "search": clock["tests"] - clock["search"],
        "tests": end - clock["tests"],
    }
    return Search(
        nominal, current, tuple(causes), tuple(scores), tuple(blocks), len(candidates),
        current.run.samples, fitted.by_channel, fitted.misfit,
        (before, strayed(current.run, fitted.factors)), seconds, levels,
        coarse,
    )  # fmt: skip


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
        key=lambda s: -s.information_gain(found.run.samples),
    )


def _best(scores: Sequence[Score], tried: int, samples: int, levels: Levels) -> Score | None:
    for s in scores:
        if s.freedom and s.p_value * tried < levels.candidate and s.information_gain(samples) > 0.0:
            return s
    return None


def _accept(current: Fit, best: Score, scores: Sequence[Score], levels: Levels) -> tuple[Cause, Fit] | None:
    """Refit the best candidate, and its contenders where the linear score may be off; return the winner."""
    samples = current.run.samples
    gain = best.information_gain(samples)
    rivals = [s for s in scores if s.candidate.key != best.candidate.key]
    near = [s for s in rivals if gain - s.information_gain(samples) < levels.alias]
    contenders = [best]
    if best.ratio > levels.linear:
        close = [s for s in rivals if s.ratio > 0.9 * best.ratio]
        contenders += close[: levels.contenders - 1]
    fitted: list[tuple[float, Score, Fit]] = []
    for s in contenders:
        found = _refit(current, s)
        if found is None:
            continue
        ratio = 2.0 * (current.objective - found.objective)
        if ratio > SURPLUS * s.ratio + levels.linear:
            # the others' fit had perhaps not come to rest: what do they reach from here without it?
            current = _without(current, found, s.candidate)
            ratio = 2.0 * (current.objective - found.objective)
        LOGGER.info("%s: ratio %.1f linear, %.1f refitted", s.candidate.key, s.ratio, ratio)
        fitted.append((ratio - (s.ratio - s.information_gain(samples)), s, found))
    if not fitted:
        return None
    value, winner, found = max(fitted, key=lambda x: x[0])
    ratio = 2.0 * (current.objective - found.objective)
    value = ratio - (winner.ratio - winner.information_gain(samples))
    if value <= 0.0 or chi2.sf(ratio, max(winner.freedom, 1)) * len(scores) > levels.candidate:
        return None
    if best.ratio > levels.linear:
        reached = {id(s): v for v, s, _ in fitted}
        near = [s for s in contenders if value - reached.get(id(s), -np.inf) < levels.alias]
        near += [
            s for s in rivals if s not in contenders and gain - s.information_gain(samples) < levels.alias
        ]
    aliases = tuple((s, correlation(winner, s)) for s in near if s is not winner)
    beside = tuple(u.name for u in current.unknowns)
    return Cause(winner, tuple(a for a in aliases if a[1] > 0.5), ratio, beside), found


def _without(current: Fit, found: Fit, candidate: Candidate) -> Fit:
    """Return the better of a fit and its continuation from where a candidate's refit ended, without it."""
    point = found.point
    if candidate.effect is not None:
        known = {e.name for e in current.point.description.effect}
        kept = tuple(e for e in point.description.effect if e.name in known)
        point = replace(point, description=point.description.model_copy(update={"effect": kept}))
        mine = [e for e in current.point.description.effect if e.name == candidate.effect.name]
        point = point.with_effect(mine[0]) if mine else point
    try:
        further = fit(point, current.unknowns, current.problem, iterations=8)
    except (SmsidError, np.linalg.LinAlgError):
        return current
    return further if further.objective < current.objective else current


def _refit(current: Fit, s: Score) -> Fit | None:
    """Return the fit with a candidate's parameters free, started from its linear estimate."""
    candidate = s.candidate
    own = candidate.unknowns(current.unknowns)
    kept = [u for u in current.unknowns if u.name not in {o.name for o in own}]
    point = current.point
    if candidate.effect is not None:
        point = point.with_effect(candidate.instance(point))
    unknowns = (*kept, *own)
    # what stood in for the effect goes back, the effect comes in
    back = -(s.taken @ s.estimate) * current.scales
    start = point.moved(current.unknowns, back).moved(own, s.estimate * np.array(candidate.steps))
    for at in (start, point):
        try:
            if not at.physical():
                continue
            return _with_more(fit(at, unknowns, current.problem, iterations=8), candidate)
        except (SmsidError, np.linalg.LinAlgError) as error:
            LOGGER.info("%s cannot be fitted: %s", candidate.key, error)
    return None


def _with_more(found: Fit, candidate: Candidate) -> Fit:
    """Return the fit with a candidate's further parameters free too, where they gain what they cost."""
    if not candidate.also:
        return found
    parameters = {p.name: p for p in candidate.instance(found.point).parameters()}
    more = tuple(
        Unknown(n, "effect", p.unit, p.value, np.inf, 1e-2, lower=p.lower, upper=p.upper)
        for n in candidate.also
        for p in (parameters[n],)
    )
    try:
        larger = fit(found.point, (*found.unknowns, *more), found.problem, iterations=4)
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("%s: %s stay as they are: %s", candidate.key, candidate.also, error)
        return found
    gained = 2.0 * (found.objective - larger.objective)
    return larger if gained > len(more) * np.log(found.run.samples) else found


def _pruned(
    causes: list[Cause], last: Fit, nominal: Fit, levels: Levels, tried: int
) -> tuple[list[Cause], Fit]:
    """Leave out causes that the others made unnecessary, by Wald's statistic."""
    while len(causes) > 1:
        covariance = last.covariance()
        names = [u.name for u in last.unknowns]
        worst, least = None, np.inf
        for cause in causes:
            index = [names.index(n) for n in cause.score.candidate.free]
            shift = np.array([last.point.value(last.unknowns[i]) - last.unknowns[i].nominal for i in index])
            sigma = np.sqrt(np.diag(covariance)[index])  # units differ by more than pinv takes for nothing
            own = covariance[np.ix_(index, index)] / np.outer(sigma, sigma)
            wald = float((shift / sigma) @ np.linalg.pinv(own) @ (shift / sigma))
            p = chi2.sf(wald, len(index)) * tried
            if p > levels.candidate and wald < least:
                worst, least = cause, wald
        if worst is None:
            break
        causes = [c for c in causes if c is not worst]
        current = replace(nominal, problem=last.problem)  # its noise levels may be finer
        for cause in causes:
            again = _refit(current, cause.score_beside([u.name for u in current.unknowns]))
            current = again if again is not None else current
        last = current
    return causes, last
