"""The rounds of a search: score the candidates left, fit the likeliest, accept it beside its rivals."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from smsid.diagnose._candidate_scores import CandidateScores
from smsid.diagnose._cause_count import STRUCTURES, cause_count, has_room
from smsid.diagnose._cause_in_motion import in_motion
from smsid.diagnose._change_point import (
    best_onsets,
    drop_onset,
    refine_onset,
    scan_onsets,
    sync_onset,
    with_onset,
)
from smsid.diagnose._described_effects import least_beside_listed, least_for
from smsid.diagnose._exchange_step import eliminate_backward, exchange_step, recompute_evidence
from smsid.diagnose._merge_step import merge_step
from smsid.diagnose._misfit_proof import follows, is_hopeful, with_what_it_lacks
from smsid.diagnose._noise_covariance import InflatedFit, normalised_rmse
from smsid.diagnose._open_shape import may_be_open, with_errors_of_shape, with_open_shape
from smsid.diagnose._step_size_check import refine_steps
from smsid.diagnose._unknown_input import UnknownInput, one_unknown_input
from smsid.diagnose._unknown_structure import refit_noise, with_structure_again
from smsid.diagnose._wald_test import distance
from smsid.diagnose.model_comparison import (
    Cause,
    accept,
    fit_from_nominal,
    simplest_law,
    with_further,
)
from smsid.diagnose.score_test import Candidate, Score, is_same_error
from smsid.diagnose.specification_tests import SpecificationTest, is_at, memory, open_joints
from smsid.diagnose.thresholds import THRESHOLDS, DetectionThresholds
from smsid.errors import SmsidError
from smsid.estimation.filter_run import FilterRun
from smsid.estimation.map_estimate import MapFit, evaluate
from smsid.estimation.problem import Problem

LOGGER = logging.getLogger(__name__)
ON_THE_BUS = (*STRUCTURES, "external")  # families that a structure of unknown motion looks like
RESTLESS = 5  # times at most that a search goes on from a better fit that a candidate led to


class SearchState:
    """Where a search stands: the last fit, the causes in it, and the candidates left with their scores.

    ``nominal`` is the fit without causes, ``normalised_rmse`` the rms of its prediction errors over
    the stated noise; ``held`` are the tests for memory that end a search, where the next cause would stand
    in for a piece of it.
    """

    def __init__(
        self,
        fitted: InflatedFit,
        candidates: Sequence[Candidate],
        levels: DetectionThresholds,
        *,
        known: Sequence[Cause] = (),
        nominal: MapFit | None = None,
        lost: SmsidError | np.linalg.LinAlgError | None = None,
    ) -> None:
        """Begin with the nominal parameters fitted, or with causes ``known`` beside them already.

        ``nominal`` is then the fit without it, in a model that may err. ``lost`` is why it has to err
        (`erring_fit`).
        """
        self.lost = lost
        self.fitted, self.candidates, self.levels = fitted, tuple(candidates), levels
        self.causes: list[Cause] = list(known)
        self.held: tuple[SpecificationTest, ...] = ()
        # keys of causes found while a structure was taken as unknown
        self._found_elsewhere: frozenset[tuple[str, str, str]] = frozenset()
        self._nominal()
        if nominal is not None:
            self.nominal = nominal
            self.normalised_rmse = normalised_rmse(nominal.run)
        self.failed: list[str] = []
        self._restarts = 0
        self.one_unknown: UnknownInput | None = None  # that explains more than several causes do
        self._doubted = 0  # causes beside which that was asked
        self._alone: tuple[MapFit, bool] | None = None  # a fit, and whether it follows to the noise as stated
        # whether the noise is finer now than when the last cause was chosen
        self._finer = bool(known)
        # keys of causes that were chosen beside one that has given way
        self._recheck: frozenset[tuple[str, str, str]] = frozenset()
        self._out: set[tuple[str, str, str]] = set()  # keys of candidates that were tried in vain
        self._scoring = CandidateScores(levels.onset)
        self._score_anew()

    @property
    def current(self) -> MapFit:
        """The last fit."""
        return self.fitted.fit

    @property
    def samples(self) -> int:
        """The number of samples that odds are of."""
        return self.current.run.samples

    def guarded(self, what: str, step: Callable[[], bool | None]) -> bool:
        """Take a step of the search; return what it returns. One that fails numerically is undone and noted:
        what was found before stays.
        """
        before = {**vars(self), "causes": list(self.causes)}
        try:
            return bool(step())
        except (SmsidError, np.linalg.LinAlgError, ArithmeticError) as error:
            LOGGER.info("%s failed: %s", what, error, exc_info=True)
            vars(self).update(before)
            self._scoring.columns.clear()  # they may be those of the fit that is left again
            self.failed.append(f"{what} failed numerically and was left out: {error}")
            return False

    def forward_step(self) -> bool:
        """Look for one cause more; return whether there may be another."""
        leading = self._leading_scores()
        if not leading:
            return False
        counting = [s for s in leading[1:] if self._counts(s)] or leading[:1]
        best = max(counting, key=self._worth)
        best = simplest_law(best, [*counting, *self.scores], self.samples, self._asked)
        if not self.fitted.misfit:  # else the tests do not decide
            self.held = self._memory(best)
        if self.held:  # the next would stand in for a piece of it
            return False
        larger = with_further(self.current, self.causes)  # what is there already comes first
        if larger is not None:
            gained = 2.0 * (self.current.objective - larger.objective)
            self._move(larger, strong=gained > self.levels.linear)
            self._score_anew()
            return True
        if self._is_one_unknown():
            return False
        own = {s.candidate.key: s for s in leading[1:]}
        rivals = [own.get(s.candidate.key, s) for s in self.scores]
        rivals.sort(key=self._worth, reverse=True)
        in_vain = {best.candidate.key}
        proof = {"worth": self._worth, "hopeful": partial(is_hopeful, self.fitted), "follows": self._follows}
        worth = proof if self.fitted.misfit else {}
        cause, found = accept(
            self.current, best, rivals, self._asked, len(self.candidates),
            in_vain=in_vain, has_room=self._has_room, **worth,
        )  # fmt: skip
        if cause is not None:
            self._add(cause, found)
        elif (
            2.0 * (self.current.objective - found.objective) > self.levels.linear
            and self._restarts < RESTLESS
        ):
            self._restart(found)
        else:
            tried = [s for s in self.scores if s.candidate.key in in_vain]
            rest = [s for s in self.scores if s.candidate.key not in in_vain]
            same = {s.candidate.key for s in rest if any(is_same_error(s, t) for t in tried)}
            self._out |= in_vain | same
            self.scores = [s for s in rest if s.candidate.key not in same]
        return True

    def _is_one_unknown(self) -> bool:
        """Whether one torque that is unknown explains more than several causes do; asked before one more."""
        few = THRESHOLDS.several if not (self.fitted.misfit or self.fitted.unknown) else np.inf
        count = cause_count([c.score.candidate for c in self.causes])
        if count < max(few, self._doubted + 1) or open_joints(self.current):
            return False
        self._doubted = count
        self.one_unknown = one_unknown_input(self.nominal, self.current, self.levels)
        return self.one_unknown is not None

    def go_on(self) -> bool:
        """Hold the one unknown torque, if there is one, against the causes as they have been judged beside
        each other; return whether there may be a further cause after all.
        """
        one = self.one_unknown
        if one is None:
            return False
        if not one.explains_more(self.current, self.levels):
            LOGGER.info("%s explains no more than the causes as they are now", one.test.where)
            self.one_unknown = None
            return True
        told = f"{one.test.where}, if it is unknown, explains more than {len(self.causes)} causes do"
        LOGGER.info(told)
        self.failed.append(f"{told}, and leaves nothing: they are parts of it, and no more were looked for")
        return False

    def close(self) -> None:
        """Judge the causes beside each other: what is there all the time, and which of them they are."""
        reached = self.current
        self._there_always()
        if self.current is not reached:
            self._score_again(reached.run)
        if not self.causes or (len(self.causes) == 1 and not self._finer):
            return
        # beside an unknown structure, what a rival gives the bus is hidden: nothing speaks against it
        told = not (self.fitted.misfit or self.fitted.unknown)
        # else a rival is told from a law that is not yet all it can be
        while told and (larger := with_further(self.current, self.causes)) is not None:
            self.take(larger)
        before = [c.score.candidate.key for c in self.causes]
        asked, settled, found = (self.nominal, self.candidates, self.levels), self._settled, self.current
        if told:
            self.causes, found = merge_step(self.causes, found, *asked, settled)
        anew = self._finer or len(self.causes) < len(before)
        self.causes, found = exchange_step(
            self.causes, found, *asked, exchange=told, last_too=anew, settled=settled
        )
        now = frozenset(c.score.candidate.key for c in self.causes)
        gone = next((i for i, key in enumerate(before) if key not in now), len(before))
        self._recheck = now & self._recheck.union(before[gone:])
        self.take(found)

    def prune(self) -> bool:
        """Drop the causes that the others have made needless; return whether any was."""
        self.causes, found = eliminate_backward(
            self.causes, self.current, self.nominal, self._asked, len(self.candidates), self._proven,
            self._recheck,
        )  # fmt: skip
        self._recheck = frozenset()  # they are missed
        return self.take(found)

    def restore(self, problem: Problem) -> bool:
        """Take in again the structure that was taken as unknown, and say so; causes elsewhere stay.

        ``problem`` is the whole one, as the search began.
        """
        self._found_elsewhere = frozenset(c.score.candidate.key for c in self.causes) - self._settled
        whole = replace(self.current.problem, data=problem.data, noise=problem.noise)
        own = {n for c in self.causes for n in c.score.candidate.parameters}
        self.fitted = with_structure_again(self.fitted, whole, self.nominal, own)
        self.nominal = evaluate(self.nominal.point, self.nominal.unknowns, self.current.problem)
        self.normalised_rmse = normalised_rmse(self.nominal.run, self.fitted.factors)
        if not self.fitted.misfit:  # ratios are of this noise then
            self.causes = recompute_evidence(self.causes, self.current, self.nominal)
        self._out.clear()
        self._score_anew()
        return True

    def take(self, found: MapFit) -> bool:
        """Go on from another fit, as judged anew; return whether it is another."""
        if found is self.current:
            return False
        before = self.current.run
        self._keep(found)
        self._there_always()  # what had begun beside another cause
        self._score_again(before)
        return True

    def leave_open(self) -> bool:
        """Leave open the shape of a law among the causes, where all is followed to the noise so; return
        whether one was.
        """
        last = self.current
        for cause in self.causes:
            own = cause.score.candidate
            if not may_be_open(own, last.problem):
                continue
            opened = with_open_shape(last.point, last.unknowns, self.fitted.stated, own, self.candidates)
            if opened is not None:
                found, laws = opened
                self.causes = [*(c for c in self.causes if c.score.candidate.key[:2] != own.key[:2]), *laws]
                self.fitted = InflatedFit(found, np.ones_like(self.fitted.factors))
                return True
        return False

    def set_in_motion(self, left: Sequence[SpecificationTest]) -> bool:
        """Let what a cause brings along move by itself, where tests say that it does not follow at once;
        return whether one does.
        """
        found = in_motion(self.current, self.causes, left)
        if found is None:
            return False
        self._keep(refine_steps(found))
        self.nominal = evaluate(self.nominal.point, self.nominal.unknowns, self.current.problem)
        self._scoring.columns.clear()
        return True

    def let_law_err(self, left: Sequence[SpecificationTest]) -> bool:
        """Let the torque of a law among the causes err, where tests say that it is not all that acts there;
        return whether one does.
        """
        for cause in self.causes:
            own = cause.score.candidate
            if may_be_open(own, self.current.problem) and any(t.location == own.location for t in left):
                found, laws = with_errors_of_shape(self.current, own, self.candidates)
                if laws:
                    self.causes = [*(c for c in self.causes if c is not cause), *laws]
                self._keep(found)
                self._score_anew()  # what else acts there is not asked then
                return True
        return False

    @property
    def _proven(self) -> frozenset[tuple[str, str, str]]:
        """Keys of causes that were found where misfit did not hide them, and that it would hide now."""
        return self._found_elsewhere if self.fitted.misfit else frozenset()

    @property
    def _settled(self) -> frozenset[tuple[str, str, str]]:
        """Keys of causes that are not judged again: where their place is unknown, or was when they were, or
        the shape of their law is left open, which was judged with all others of its place.
        """
        causes, place = [c.score.candidate for c in self.causes], self.fitted.unknown
        judged = frozenset(c.key for c in causes if c.location in open_joints(self.current))
        return judged | (
            frozenset(c.key for c in causes if is_at(c.location, place)) if place else self._proven
        )

    @property
    def _asked(self) -> DetectionThresholds:
        asked = self.levels.beside_a_cause if self.causes else self.levels
        # ratios that count what is not followed: small ones may be of large effects, those found before of
        # other noise, and what the law of a cause leaves is counted, too
        return replace(asked, linear=0.0, beside=0.0) if self.fitted.misfit else asked

    def _worth(self, s: Score) -> float:
        """Return what scores are ordered by: their odds.

        Where misfit is counted, noise that is raised to what a cause leaves bounds the odds of that cause,
        and those of many small ones are larger: what takes most of the errors away in stated noise is first.
        """
        if not self.fitted.misfit:
            return s.odds(self.samples)
        if not s.freedom or s.ratio <= 0.0:
            return -np.inf
        return self.fitted.explained(np.asarray(s.columns), s.estimate)

    def _follows(self, found: MapFit) -> bool:
        """Whether a fit goes on to the noise as stated, where misfit is counted, as the last one does not."""
        if self._alone is None or self._alone[0] is not self.current:
            self._alone = self.current, follows(self.fitted, self.current)
        return not self._alone[1] and follows(self.fitted, found)

    def _counts(self, s: Score) -> bool:
        """Whether there is something; odds order what counts, they do not decide."""
        return bool(s.freedom) and s.p_value * len(self.candidates) < self._asked.candidate

    def _leading_scores(self) -> list[Score]:
        """Return the likeliest score, then it and its contenders with the onset that each may have."""
        least = self._asked.beside * max((c.ratio for c in self.causes), default=0.0)
        asked = [s for s in self.scores if self._has_room(s.candidate)]
        strong = (
            s for s in asked if s.ratio > max(least, least_for(s.candidate, self.nominal, self.least_listed))
        )
        best = next((s for s in strong if self._counts(s)), None)
        if best is None:  # in noise as large as itself it counts for nothing
            best = next((s for s in asked if is_hopeful(self.fitted, s)), None)
        if best is None:
            return []
        few = self.levels.contenders
        leading = [best, *(s for s in asked if s is not best)][:few]
        clear = best.ratio > min(
            THRESHOLDS.beginnings_sought, self.levels.linear
        )  # enough for what is there in part to pass as another
        onsets = scan_onsets(self.current, asked if clear else leading)
        if clear:
            known = {s.candidate.key for s in leading}
            begun = best_onsets(self.current, asked, few, onsets)
            leading += [s for s in begun if s.candidate.key not in known]
        return [best, *(with_onset(self.current, s, self.levels.onset, onsets) for s in leading)]

    def _has_room(self, candidate: Candidate) -> bool:
        return has_room(candidate, [c.score.candidate for c in self.causes], self.levels.causes)

    def _memory(self, best: Score) -> tuple[SpecificationTest, ...]:
        """Return the tests for memory at the joints of causes that gain more than the next candidate does."""
        gain, level = best.information_gain(self.samples), self.levels.block / len(self.candidates)
        tests = memory(self.current, [c.score.candidate.location for c in self.causes])
        return tuple(t for t in tests if t.information_gain(self.samples) > gain and t.p_value < level)

    def _restart(self, found: MapFit) -> None:
        """Go on from a better fit of the same parameters that a candidate led to."""
        self._restarts += 1
        LOGGER.info("the fit had not come to rest: %.1f to %.1f", self.current.objective, found.objective)
        self._move(found, strong=True)
        if not self.causes:
            self._nominal()
        self._out.clear()
        self._score_anew()

    def _add(self, cause: Cause, found: MapFit) -> None:
        """Take an accepted cause in, in the place of those that are special cases of it."""
        levels, self._finer = self.levels, False
        (cause,) = self._with_fitted_onsets([cause], found)
        moved, found = refine_onset(found, cause.score)
        causes, found = drop_onset([*self.causes, replace(cause, score=moved)], found, levels)
        *self.causes, cause = self._with_fitted_onsets(causes, found)
        within = [c for c in self.causes if cause.score.candidate.holds(c.score.candidate)]
        cause = replace(cause, ratio=cause.ratio + sum(c.ratio for c in within))
        self.causes = [*(c for c in self.causes if all(c is not w for w in within)), cause]
        whole = with_what_it_lacks(self.fitted, cause, found) if self.fitted.misfit else found
        strong = cause.ratio > levels.linear or whole is not found
        found = whole
        counted, before = self.fitted.misfit, self.current.run
        self._move(found, strong=strong)
        self._out.update(c.score.candidate.key for c in within)
        strong = strong or (self._finer and max(c.ratio for c in self.causes) > levels.linear)
        if strong:
            self._keep(refine_steps(self.current))
        if counted:  # signatures are those in other noise
            self._score_anew()
        else:
            self._score_again(before)

    def _there_always(self) -> None:
        causes, found = drop_onset(self.causes, self.current, self.levels)
        self.causes = self._with_fitted_onsets(causes, found)
        self._keep(found)

    def _with_fitted_onsets(self, causes: Sequence[Cause], found: MapFit) -> list[Cause]:
        """Return causes with the starts that their effects have in a fit; described ones are left alone."""
        described = {e.name for e in self.nominal.point.description.effect}

        def own(cause: Cause) -> bool:
            effect = cause.score.candidate.effect
            return effect is not None and effect.name not in described

        return [replace(c, score=sync_onset(found, c.score)) if own(c) else c for c in causes]

    def _nominal(self) -> None:
        """The last fit is of the nominal parameters alone."""
        self.nominal = self.current
        self.normalised_rmse = normalised_rmse(self.current.run, self.fitted.factors)
        self.least_listed = least_beside_listed(self.current, self.candidates)

    def _move(self, found: MapFit, *, strong: bool) -> None:
        """Go on from another fit, with its noise levels.

        Where misfit is no longer counted, only now are beginnings seen as sharply as they can be, causes
        weigh what they do, and what was tried in vain is worth another trial.
        """
        counted = self.fitted.misfit
        self.current.changes.by_candidate.clear()
        found = fit_from_nominal(found, [c.score.candidate for c in self.causes])
        told = partial(_distances_of_causes, self.causes)
        self.fitted = refit_noise(replace(self.fitted, fit=found), strong=strong, told=told)
        if self.fitted.misfit:
            self.leave_open()
        if self.fitted.misfit or not counted:
            return
        self._finer = True
        self._out.clear()
        for i, before in enumerate(self.causes):
            still, found = refine_onset(self.current, before.score)
            self.causes[i] = replace(before, score=still)
            self._keep(found)
        self.causes = self._with_fitted_onsets(self.causes, self.current)
        self.causes = recompute_evidence(self.causes, self.current, self.nominal)

    def _keep(self, found: MapFit) -> None:
        """Go on from another fit with the noise levels as they are."""
        self.fitted = replace(self.fitted, fit=found)

    def forget_columns(self) -> None:
        """Let go of the columns of all candidates, which take the most memory: what is scored later has them
        made anew.
        """
        self._scoring.columns.clear()
        self.scores = [s.without_columns() for s in self.scores]

    def _score_anew(self) -> None:
        self._scoring.columns.clear()
        self.scores = self._ordered(self._scoring.score(self.current, self._left()))

    def _score_again(self, before: FilterRun) -> None:
        self.scores = self._ordered(self._scoring.score_again(self.current, self._left(), before))

    def _ordered(self, scores: Sequence[Score]) -> list[Score]:
        return sorted(scores, key=self._worth, reverse=True)

    def _left(self) -> list[Candidate]:
        """Return the candidates that may be a further cause, or rivals of one."""
        out = self._out | {c.score.candidate.key for c in self.causes}
        open_ = open_joints(self.current)  # what else is there, is not told from a law of unknown shape
        left = [c for c in self.candidates if c.key not in out and c.location not in open_]
        if not self.fitted.unknown:
            return left
        elsewhere = (c for c in left if not is_at(c.location, self.fitted.unknown))
        return [c for c in elsewhere if c.family not in ON_THE_BUS]


def _distances_of_causes(causes: Sequence[Cause], found: MapFit, place: str) -> list[float]:
    """Return how many standard deviations, in squares, each cause but those at a place is from doing nothing
    at a fit.
    """
    own = (c.score.candidate for c in causes)
    return [distance(found, c) for c in own if not is_at(c.location, place)]
