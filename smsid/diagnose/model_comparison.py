"""A cause is accepted by a refit beside its rivals."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from math import comb

import numpy as np
from scipy.stats import chi2

from smsid.diagnose._plausibility import impossible_fit
from smsid.diagnose._profiled_hypothesis import ResolvedHypothesis
from smsid.diagnose._wald_test import chance_of_nothing
from smsid.diagnose.score_test import Candidate, Score, can_do_the_same, correlation, odds
from smsid.diagnose.thresholds import THRESHOLDS, DetectionThresholds
from smsid.errors import SmsidError
from smsid.estimation.map_estimate import NEARLY_AT_REST, MapFit, fit, within_reach
from smsid.estimation.parameter_vector import Unknown

LOGGER = logging.getLogger(__name__)
NEAR = THRESHOLDS.near
AGAIN = 12  # steps of a fit that begins again from the nominal parameters
AXES = (".x", ".y", ".z")
OUT_OF_REACH = 0.01  # of what the best contender gains, by which another may fall behind on its way


@dataclass(frozen=True)
class Cause:
    """An accepted candidate with its score, and those this experiment does not tell from it.

    ``aliases`` pairs scores with their correlation, ``equivalent`` are the keys of those that can do all that
    it does; ``ratio`` is the likelihood ratio after the refit.
    """

    score: Score
    aliases: tuple[tuple[Score, float], ...]
    ratio: float
    equivalent: frozenset[tuple[str, str, str]] = frozenset()

    @classmethod
    def of(cls, score: Score, aliases: Sequence[tuple[Score, float]], ratio: float) -> Cause:
        """Return an accepted score with its aliases, all of one fit."""
        same = frozenset(s.candidate.key for s, _ in aliases if can_do_the_same(score, s))
        return cls(score, tuple(aliases), ratio, same)

    def with_own_columns(self) -> Cause:
        """Return it with columns of its own: a fit that is left again, and all of its candidates', may go."""
        aliases = tuple((s.with_own_columns(), how) for s, how in self.aliases)
        return replace(self, score=self.score.with_own_columns(), aliases=aliases)


def accept(
    current: MapFit,
    best: Score,
    scores: Sequence[Score],
    levels: DetectionThresholds,
    tried: int,
    worth: Callable[[Score], float] = lambda s: s.ratio,
    follows: Callable[[MapFit], bool] = lambda found: False,
    hopeful: Callable[[Score], bool] = lambda s: False,
    in_vain: set[tuple[str, str, str]] | None = None,
    has_room: Callable[[Candidate], bool] = lambda candidate: True,
) -> tuple[Cause | None, MapFit]:
    """Refit the best candidate, and its contenders where the linear score may be off; return the winner.

    ``tried`` is the number of candidates, which chances are corrected for; contenders are ``worth`` nearly as
    much as the best, and causes that the search ``has_room`` for. What the winner explains is no chance where
    the model ``follows`` with it, as it did not without; that is asked of the best where it is ``hopeful``,
    and of a winner that gains much. Without a winner the fit is ``current``, or a better one without the
    candidates that their refits led to; the keys of those that are by chance are put ``in_vain``: beside this
    fit they would be again.
    """
    samples, in_vain = current.run.samples, set() if in_vain is None else in_vain
    rivals = [s for s in scores if s.candidate.key != best.candidate.key]
    near = [s for s in rivals if not is_distinguishable(best, s, samples, levels)]
    contenders = [best] if best.another is None else [best, best.another]
    if best.ratio > levels.linear:
        asked = [s for s in rivals if has_room(s.candidate)]
        close = [s for s in asked if worth(s) > THRESHOLDS.close * worth(best)]
        contenders += close[: levels.contenders - 1]
        # large and curved, what is there all the time scores less than it explains
        if best.candidate.start is not None:
            still = next((s for s in asked if s.candidate.start is None), None)
            if still is not None and not any(s is still for s in contenders):
                contenders.append(still)
    fitted: list[tuple[float, Score, float]] = []  # criterion and objective; of fits the best alone is kept
    leader, at_most, followed = current, np.inf, False
    nothing: dict[int, float] = {}
    unasked = set[tuple[str, str, str]]()  # they may be the best of the next round
    for s in contenders:
        found = refit(current, s, at_most)
        if found is None:
            continue
        ratio = 2.0 * (current.objective - found.objective)
        if ratio > THRESHOLDS.surplus * s.ratio + levels.linear:
            # the others' fit had perhaps not come to rest: what do they reach from here without it?
            current = without_candidate(current, found, s.candidate)
        LOGGER.info("%s: ratio %.1f linear, %.1f refitted", s.candidate.key, s.ratio, ratio)
        nothing[id(s)] = chance_of_nothing(found, s.candidate, current)
        price = cost(current, s, found)
        if nothing[id(s)] > levels.candidate:
            LOGGER.info("%s is nothing by a chance of %.3g", s.candidate.key, nothing[id(s)])
            followed = s is best and hopeful(s) and follows(found)
            if not followed:  # it ran away
                unasked |= {s.candidate.key} if s is not best and hopeful(s) else set()
                continue
            contenders = [s]  # others are told from it by their scores alone
            fitted, leader = [(-2.0 * found.objective - price, s, found.objective)], found
            break
        if all(-2.0 * found.objective - price > value for value, *_ in fitted):
            leader = found
        fitted.append((-2.0 * found.objective - price, s, found.objective))
        # one that comes nowhere near is neither the winner nor an alias, wherever it ends
        room = levels.alias + price + OUT_OF_REACH * ratio
        at_most = min(at_most, found.objective + 0.5 * room)
    if not fitted:
        in_vain.update({s.candidate.key for s in contenders} - unasked)
        return None, current
    (value, winner, _), found = max(fitted, key=lambda x: x[0]), leader
    ratio = 2.0 * (current.objective - found.objective)

    def is_chance(s: Score, gained: float) -> bool:
        """Whether a contender is by chance: a likelihood of white noise knows nothing of slow misfit."""
        sure = replace(s, ratio=gained).p_value
        if found.problem.coloured:
            sure = max(sure, s.chance_of(nothing[id(s)]))
        return sure * tried > levels.candidate

    chance = is_chance(winner, ratio) and not followed
    if chance and not ((ratio > THRESHOLDS.linear or hopeful(winner)) and follows(found)):
        gains = [(s, 2.0 * (current.objective - objective)) for _, s, objective in fitted]
        in_vain.update(s.candidate.key for s, gained in gains if is_chance(s, gained))
        return None, current
    reached = {id(s): v for v, s, _ in fitted}
    if best.ratio > levels.linear:
        explains = {}
        for criterion, s, objective in fitted:  # less what its further parameters cost
            more = -2.0 * objective - criterion - (s.ratio - s.information_gain(samples))
            explains[id(s)] = replace(s, ratio=2.0 * (current.objective - objective) - more)

        def as_good(s: Score) -> bool:
            """Whether a contender is no worse by what it costs, or can do the same at any price."""
            ahead = value - reached.get(id(s), -np.inf)
            if ahead < levels.alias or id(s) not in explains:
                return ahead < levels.alias
            return not is_distinguishable(explains[id(winner)], explains[id(s)], samples, levels)

        others = [s for s in contenders if s is winner or s.candidate.key != winner.candidate.key]
        near = [s for s in others if as_good(s)]
        near += [
            s for s in rivals if s not in contenders and not is_distinguishable(best, s, samples, levels)
        ]
    return Cause.of(winner, aliases_of(winner, near, samples, reached), ratio).with_own_columns(), found


def simplest_law(best: Score, scores: Sequence[Score], samples: int, levels: DetectionThresholds) -> Score:
    """Return the simplest law of the same place that the best candidate is not told from, or that one."""
    for shape in best.candidate.simpler:
        for s in scores:
            own = best.candidate.extends(s.candidate) and s.candidate.shape == shape and s.freedom > 0
            if own and correlation(best, s) > NEAR and not is_distinguishable(best, s, samples, levels):
                return s
    return best


def aliases_of(
    winner: Score, near: Sequence[Score], samples: int, reached: Mapping[int, float] | None = None
) -> tuple[tuple[Score, float], ...]:
    """Return those of the candidates not rejected that look like the winner, with their correlations; the
    likeliest first.

    Of more than two, the least likely are left out that hold `THRESHOLDS.left_out` of the chances at most (by
    their odds); never one that explains as much as the winner does or can do the same. ``reached`` are the
    criteria of scores after a refit, by ``id``; the others' are linear.
    """
    alike = [(s, correlation(winner, s)) for s in near if s is not winner]
    alike = [a for a in alike if a[1] > NEAR]
    refitted, best = reached or {}, winner.odds(samples)

    def chance(s: Score) -> float:
        both = id(s) in refitted and id(winner) in refitted
        lead = refitted[id(winner)] - refitted[id(s)] if both else best - s.odds(samples)
        return float(np.exp(-0.5 * max(lead, 0.0)))

    left = THRESHOLDS.left_out * (1.0 + sum(chance(s) for s, _ in alike))
    for s, how in sorted(alike, key=lambda a: chance(a[0])):
        if len(alike) <= THRESHOLDS.aliases or chance(s) > left:
            break
        if s.ratio < winner.ratio and how <= THRESHOLDS.contained:
            left -= chance(s)
            alike = [a for a in alike if a[0] is not s]
    return tuple(sorted(alike, key=lambda a: -chance(a[0])))


def is_distinguishable(winner: Score, rival: Score, samples: int, levels: DetectionThresholds) -> bool:
    """Whether a rival is rejected beside the winner.

    Were it what is there, the winner would explain no more than it does but for chance, on as many degrees
    of freedom as the winner has and for every variant of it that was searched: beyond that it is rejected,
    however few its parameters are. (Not above ``levels.linear``, where linear scores are not believed.)

    A sibling with more parameters may hold the winner as a special case; its higher price alone rejects
    nothing then, but that what it has more explains no more than chance does, and, of a weak one, is small.
    One that only looks like the winner (a friction that goes with the cosine of a small angle) is rejected by
    what it leaves. Nor does its price reject what elsewhere can do just what the winner does (the inertia of
    a link, that of a motor): no data tell them. It is as likely as the few of its parameters are that it
    takes.
    """
    a, b = winner.candidate, rival.candidate
    more = rival.freedom - winner.freedom
    lead = winner.ratio - rival.ratio
    chance = THRESHOLDS.beyond / a.grid
    if winner.ratio <= levels.linear and lead > float(chi2.isf(chance, max(winner.freedom, 1))):
        return True
    if more > 0 and (a.location, a.family) == (b.location, b.family):
        if b.extends(a):
            return -lead < float(chi2.isf(THRESHOLDS.nested, more))
        if set(a.free) <= set(b.free):
            weak = winner.ratio <= levels.linear  # else what it adds would show
            return -lead < float(chi2.isf(THRESHOLDS.nested, more)) and not (
                weak and _may_add_much(winner, rival)
            )
        if lead < levels.alias and correlation(winner, rival) > THRESHOLDS.contained_better:
            return False
    if more > 0 and winner.freedom == 1 and lead < levels.alias:
        alike = correlation(winner, rival)
        if alike > THRESHOLDS.contained or (lead <= 0.0 and alike > THRESHOLDS.contained_better):
            return winner.odds(samples) - best_subset_odds(rival, samples) >= levels.alias
    return winner.odds(samples) - rival.odds(samples) >= levels.alias


def _may_add_much(winner: Score, rival: Score) -> bool:
    """Whether what a rival has beside the winner's parameters may be half as large as these are."""
    mine = np.array([n in winner.candidate.free for n in rival.candidate.free])
    spread = np.sqrt(np.diag(rival.covariance))[~mine]
    may_be = np.abs(rival.estimate[~mine]) + THRESHOLDS.adds_sure * spread
    return bool((may_be > THRESHOLDS.adds_much * np.abs(winner.estimate).max(initial=0.0)).any())


def best_subset_odds(s: Score, samples: int) -> float:
    """Return the odds of a score with those of its parameters alone that have most: few may do, the rest are
    paid for nothing. How many sets there are of as many is paid for.
    """
    if isinstance(
        s.candidate, ResolvedHypothesis
    ):  # where it is was searched for: it has all it was found with
        return s.odds(samples)
    columns, count = np.asarray(s.columns), len(s.estimate)
    gram = columns.T @ columns
    size = np.sqrt(np.where(np.diag(gram) > 0.0, np.diag(gram), 1.0))
    gram, slope = gram / np.outer(size, size), gram @ s.estimate / size
    best = s.odds(samples)
    for few in range(1, min(count, s.freedom)):
        for some in combinations(range(count), few):
            index = np.array(some)
            part, aim = gram[np.ix_(index, index)], slope[index]
            lost = float(slope @ (s.estimate * size) - aim @ np.linalg.pinv(part, hermitian=True) @ aim)
            price = 2.0 * float(np.log(s.candidate.grid * comb(count, few)))
            best = max(best, odds(s.ratio - lost, few, samples) - price)
    return best


def cost(current: MapFit, s: Score, found: MapFit) -> float:
    """Return what a refitted candidate costs in Bayes's criterion, the further parameters it freed too."""
    samples = found.run.samples
    more = {u.name for u in found.unknowns} & set(s.candidate.also) - {u.name for u in current.unknowns}
    return s.ratio - s.information_gain(samples) + len(more) * float(np.log(samples))


def without_candidate(current: MapFit, found: MapFit, candidate: Candidate) -> MapFit:
    """Return the better of a fit and one from where another ended, ``found``, that has a candidate more."""
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


def fit_from_nominal(found: MapFit, causes: Sequence[Candidate]) -> MapFit:
    """Return the better of a fit that has not come to rest and one from where its nominal parameters began,
    with the parameters of ``causes`` as they are; one at rest as it is.

    What stood in for a cause went far before that was there (a tank lost a tenth of its mass to an encoder's
    bias), and the way back may be barred.
    """
    if found.objective - within_reach(found) < NEARLY_AT_REST:
        return found
    own = {n for c in causes for n in c.parameters}
    nominal = [u for u in found.unknowns if u.kind in ("inertial", "effect") and np.isfinite(u.sigma)]
    nominal = [u for u in nominal if u.name not in own]
    back = np.array([u.nominal - found.point.value(u) for u in nominal])
    try:
        again = fit(found.point.moved(nominal, back), found.unknowns, found.problem, iterations=AGAIN)
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("not from the nominal parameters: %s", error)
        return found
    LOGGER.info("from the nominal parameters: %.1f, was %.1f", again.objective, found.objective)
    return min(found, again, key=lambda f: f.objective)


def refit(current: MapFit, s: Score, at_most: float = np.inf) -> MapFit | None:
    """Return the fit with a candidate's parameters free, started from its linear estimate; given up where it
    does not come to the objective ``at_most``, or to values that cannot be: no likelihood speaks for these.
    """
    at_most = min(at_most, current.objective)
    candidate = s.candidate
    own = candidate.unknowns(current.unknowns)
    kept = [u for u in current.unknowns if u.name not in {o.name for o in own}]
    point = current.point
    if candidate.effect is not None:
        point = point.with_effect(candidate.instance(point), candidate.recording)
    unknowns = (*kept, *own)
    # what stood in for the effect goes back, the effect comes in
    back = -(s.taken @ s.estimate) * current.scales
    start = point.moved(current.unknowns, back).moved(own, s.estimate * np.array(candidate.steps))
    absurd = partial(impossible_fit, candidate=candidate)
    for at in (start, point):
        try:
            if not at.physical():
                continue
            found = fit(at, unknowns, current.problem, iterations=12, at_most=at_most, in_vain=absurd)
            found = _fit_further_parameters(found, candidate) if found.objective < at_most else found
        except (SmsidError, np.linalg.LinAlgError) as error:
            LOGGER.info("%s cannot be fitted: %s", candidate.key, error)
            continue
        if not absurd(found):
            return found
        LOGGER.info("%s is not believed: %s", candidate.key, absurd(found))
    return None


def unfitted_parameters(found: MapFit, candidate: Candidate) -> list[Unknown]:
    """Return the further parameters of a candidate's effect that a fit with it holds as they are, free."""
    fitted = {u.name for u in found.unknowns}
    names = [n for n in candidate.also if n not in fitted]
    known = {p.name: p for p in candidate.instance(found.point).parameters()} if names else {}
    return [Unknown.of_parameter(p, np.inf, 1e-2) for n in names for p in (known[n],)]


def _fit_further_parameters(found: MapFit, candidate: Candidate) -> MapFit:
    """Return the fit with a candidate's further parameters free too where they gain what they cost: all of
    them, else those that do alone (the components of a vector together).
    """
    more, price = _promising_parameters(found, candidate), float(np.log(found.run.samples))

    def freed(some: Sequence[Unknown]) -> tuple[float, MapFit]:
        try:
            free, least = (*found.unknowns, *some), found.objective - 0.5 * price
            larger = fit(found.point, free, found.problem, iterations=20, at_most=least)
        except (SmsidError, np.linalg.LinAlgError) as error:
            LOGGER.info("%s: %s stay as they are: %s", candidate.key, [u.name for u in some], error)
            return -np.inf, found
        if absurd := impossible_fit(larger, candidate):
            LOGGER.info("%s: %s stay as they are: %s", candidate.key, [u.name for u in some], absurd)
            return -np.inf, found
        return 2.0 * (found.objective - larger.objective) - len(some) * price, larger

    if not more:
        return found
    paid, larger = freed(more)
    groups: dict[str, list[Unknown]] = {}
    for u in more:
        groups.setdefault(u.name[:-2] if u.name.endswith(AXES) else u.name, []).append(u)
    if len(groups) > 1 and (np.isneginf(paid) or -price * (len(more) - 1) < paid <= 0.0):
        paid, larger = max((freed(some) for some in groups.values()), key=lambda x: x[0])
    return larger if paid > 0.0 else found


def with_further(found: MapFit, causes: Sequence[Cause]) -> MapFit | None:
    """Return a fit with further parameters of a cause free, of the first that has some which pay, else none.

    A payload whose centre of mass is not in the tool's frame leaves what another link's inertia would; freed
    when it was found, its place may not have paid for itself.
    """
    for cause in causes:
        larger = _fit_further_parameters(found, cause.score.candidate)
        if larger is not found:
            return larger
    return None


def _promising_parameters(found: MapFit, candidate: Candidate) -> list[Unknown]:
    """Return further parameters of a candidate that a fit holds, where slopes promise that they pay."""
    more = unfitted_parameters(found, candidate)
    try:
        promised = 2.0 * (within_reach(found) - within_reach(found.with_unfitted(more))) if more else 0.0
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("%s: nothing further: %s", candidate.key, error)
        return []
    return more if THRESHOLDS.curved * promised > float(np.log(found.run.samples)) else []


def own_component(found: MapFit, candidate: Candidate, factors: np.ndarray) -> int:
    """Return the row of the component that a candidate changes most in a fit, in stated noise; ``factors``
    (rows,) are the fit's levels over that.
    """
    index = [i for i, u in enumerate(found.unknowns) if u.name in candidate.free]
    away = [found.point.value(found.unknowns[i]) - found.unknowns[i].nominal for i in index]
    done = found.whitened[:, :, index] @ (np.array(away) / found.scales[index]) * factors
    return int(np.argmax((done**2).sum(axis=0)))
