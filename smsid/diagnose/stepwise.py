"""The search for causes: fit what is uncertain, score every candidate, fit the best, again, and prune."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain

import numpy as np

from smsid._short_repr import short_repr
from smsid.diagnose._forward_step import SearchState
from smsid.diagnose._noise_covariance import (
    FOLLOWED,
    InflatedFit,
    but_for_one,
    erring_fit,
    first_fit,
    normalised_rmse,
    strays_by_row,
    with_levels,
)
from smsid.diagnose._open_loop import unexplained_fraction
from smsid.diagnose._step_size_check import refine_steps
from smsid.diagnose._strong_causes import coarse_cause
from smsid.diagnose._unknown_input import unknown_input_tests
from smsid.diagnose._unknown_structure import unknown_structures
from smsid.diagnose.model_comparison import Cause, with_further
from smsid.diagnose.score_test import Candidate, Score
from smsid.diagnose.specification_tests import (
    PAST,
    SpecificationTest,
    adequacy,
    band_tests,
    is_at,
)
from smsid.diagnose.thresholds import THRESHOLDS, DetectionThresholds
from smsid.errors import RecordingError, SmsidError
from smsid.estimation.map_estimate import MapFit, continue_fit, fit
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.estimation.problem import Problem

LOGGER = logging.getLogger(__name__)
# as steps that failed are called
PRUNING, LAW, MOTION = "leaving out needless causes", "letting a law err", "setting a cause in motion"


@short_repr
@dataclass(frozen=True)
class Search:
    """How a search ended: the fit of the nominal parameters alone, the last fit, causes and tests.

    ``scores`` are those of the last round, the best first, without their columns; ``before`` are the generic
    tests of the nominal model, ``blocks`` those with the causes. ``noise`` are noise levels over the stated
    ones by channel, as fitted, ``factors`` (rows,) by component; with ``misfit`` they count what the model
    cannot follow.
    ``normalised_rmse`` are rms of the prediction errors over the stated noise, before and after.
    ``bands`` are where in frequency the last fit leaves more than the noise; ``coarse`` are components read
    in steps.
    ``failed`` says in sentences what could not be done for numerical reasons, or was taken as unknown.
    ``bent`` are 95 % intervals of parameters whose likelihood is no Gaussian's, by name. ``one_unknown``:
    one torque that is unknown explains more than all causes do, which are parts of it; its test beside the
    nominal parameters is among ``before`` and ``blocks``. ``listed`` is as `least_beside_listed` returns it.
    """

    nominal: MapFit
    last: MapFit
    causes: tuple[Cause, ...]
    scores: tuple[Score, ...]
    before: tuple[SpecificationTest, ...]
    blocks: tuple[SpecificationTest, ...]
    candidates: int
    samples: int
    noise: dict[str, float]
    misfit: bool = False
    normalised_rmse: tuple[float, float] = (1.0, 1.0)
    seconds: dict[str, float] = field(default_factory=dict)
    levels: DetectionThresholds = field(default_factory=DetectionThresholds)
    coarse: frozenset[str] = frozenset()
    failed: tuple[str, ...] = ()
    factors: np.ndarray = field(default_factory=lambda: np.ones(0))
    bands: tuple[SpecificationTest, ...] = ()
    bent: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    one_unknown: bool = False
    listed: Mapping[tuple[str, str], float] = field(default_factory=dict)

    @property
    def left(self) -> tuple[SpecificationTest, ...]:
        """The generic tests that are still significant."""
        return _significant(
            self.blocks, self.causes, self.levels, self.coarse, self.listed, white=not self.misfit
        )

    @property
    def left_before(self) -> tuple[SpecificationTest, ...]:
        """The generic tests that are significant without any cause."""
        return _significant(self.before, (), self.levels, self.coarse, self.listed, white=not self.misfit)

    @property
    def followed(self) -> float:
        """Share of the squared prediction errors, in stated noise, that the causes take away."""
        before, after = self.normalised_rmse
        return 1.0 - (after / before) ** 2


def search(
    point: Point,
    problem: Problem,
    unknowns: Sequence[Unknown],
    candidates: Sequence[Candidate],
    levels: DetectionThresholds = THRESHOLDS,
    coarse: frozenset[str] = frozenset(),
) -> Search:
    """Return the causes that explain a recording, found one after the other.

    ``coarse`` names the components of channels that are read in steps: their errors are not white.

    Raises `SimulationError` when the nominal model cannot be filtered at all, `RecordingError` when it
    predicts nothing of the motion.
    """
    clock = [time.process_time()]
    state = _initial_state(point, problem, tuple(unknowns), candidates, levels)
    clock.append(time.process_time())
    _look(state)
    if state.lost and state.fitted.strict:  # no cause lets it follow as a model that does not err
        raise state.lost
    unknown = state.fitted.unknown
    if unknown:  # afterwards misfit counts, and what was proven before it did is not judged again
        state.guarded(PRUNING, state.prune)
        if state.guarded(f"taking '{unknown}' in again", lambda: state.restore(problem)):
            _look(state)
    state.forget_columns()
    one = (state.one_unknown.test,) if state.one_unknown else ()
    blocks = (*one, *adequacy(state.current)) if one else _apply_generic_tests(state, coarse)
    state.forget_columns()
    clock.append(time.process_time())
    before = (*one, *adequacy(state.nominal)) if state.causes else blocks
    sensor = state.fitted.alone and not state.causes
    if one:
        before = tuple(sorted(before, key=lambda b: b.order))
    elif not (state.fitted.misfit or sensor) and _is_unexplained(state, blocks, coarse):  # of no law, perhaps
        before = tuple(sorted((*before, *unknown_input_tests(state.nominal)), key=lambda b: b.order))
    clock.append(time.process_time())
    return Search(
        state.nominal, state.current, tuple(state.causes), tuple(state.scores), before, blocks,
        len(candidates), state.samples, state.fitted.by_channel, state.fitted.misfit,
        (state.normalised_rmse, normalised_rmse(state.current.run, state.fitted.factors)),
        {part: float(x) for part, x in zip(("nominal", "search", "tests"), np.diff(clock), strict=True)},
        levels, coarse, tuple(state.failed),
        state.fitted.factors,
        tuple(band_tests(state.current, state.fitted.factors)),
        one_unknown=bool(one), listed=state.least_listed,
    )  # fmt: skip


def _look(state: SearchState) -> None:
    further = True
    while further:
        while state.guarded("looking for a further cause", state.forward_step):
            pass
        state.guarded("judging the causes beside each other", state.close)
        further = state.guarded("holding one unknown torque against the causes", state.go_on)


def _initial_state(
    point: Point,
    problem: Problem,
    unknowns: tuple[Unknown, ...],
    candidates: Sequence[Candidate],
    levels: DetectionThresholds,
) -> SearchState:
    """Return where a search begins: with the nominal parameters fitted, or, where that leads nowhere, with a
    strong cause beside them.
    """
    first = fitted = None
    lost: SmsidError | np.linalg.LinAlgError | None = None
    strays, bent = True, False
    try:
        first = first_fit(point, problem, unknowns)
        strays = normalised_rmse(first.fit.run) > THRESHOLDS.strays
        if not strays and first.fit.stretch > THRESHOLDS.strays:
            first = replace(first, fit=continue_fit(first.fit, iterations=8))
            bent = strays = _is_bent(first.fit)
        fitted = with_levels(first, point)
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("the nominal parameters cannot be fitted: %s", error)
        lost, fitted = error, but_for_one(point, problem, unknowns, np.ones(problem.data.rows))
    # one sensor alone, or misfit where it is: no cause of the whole motion is as strong as that
    local = fitted is not None and strays and not bent and (fitted.alone or _is_local(fitted))
    if strays and not local:
        # beside a structure that does not move as described, nothing follows but with that unknown; where the
        # rest does then, no cause elsewhere is as strong
        structures = () if first is None else unknown_structures(first.fit, problem)
        for place, seen in chain([("", problem)], structures):
            if first is not None and place and _follows(first.fit.point, unknowns, seen):
                break
            elsewhere = [c for c in candidates if not (place and is_at(c.location, place))]
            coarse = coarse_cause(point, seen, unknowns, elsewhere)
            if coarse is None or (bent and first and coarse.fit.objective > first.fit.objective):
                continue
            try:
                begun = with_levels(InflatedFit(coarse.fit, np.ones(problem.data.rows), unknown=place))
                if not begun.misfit:
                    begun = replace(begun, fit=refine_steps(begun.fit))
                return SearchState(begun, candidates, levels, known=coarse.causes, nominal=coarse.nominal)
            except (SmsidError, np.linalg.LinAlgError) as error:
                LOGGER.info("the search does not go on from a strong cause: %s", error)
    strange = fitted is not None and fitted.misfit and not local
    if fitted and not (strange and unexplained_fraction(fitted.fit, fitted.by_channel) > THRESHOLDS.lost):
        return SearchState(fitted, candidates, levels)
    lost = lost or RecordingError(
        "The model predicts the motion worse than no motion would, with its parameters fitted.",
        advice="Is the recording of another spacecraft? Check signs and order of the commands.",
        recording=problem.recording.name,
    )
    erring = erring_fit(point, problem, unknowns)
    if erring is None:
        raise lost
    return SearchState(erring, candidates, levels, lost=lost)


def _follows(point: Point, unknowns: Sequence[Unknown], problem: Problem) -> bool:
    """Whether nominal parameters alone follow, but for misfit: there is nothing strong to be found then."""
    try:
        return normalised_rmse(fit(point, unknowns, problem, iterations=2).run) <= THRESHOLDS.misfit
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("not followed: %s", error)
        return False


def _is_bent(found: MapFit) -> bool:
    """Whether a fit follows, but not to the noise, and with nominal parameters that nobody would believe."""
    left = normalised_rmse(found.run)
    return THRESHOLDS.noise_left < left and found.stretch > THRESHOLDS.strays


def _is_local(fitted: InflatedFit) -> bool:
    """Whether most components are followed with the noise levels of the misfit."""
    left = float(np.median(strays_by_row(fitted.fit.run, fitted.factors)))
    LOGGER.info("with misfit where it is, half of the components are left at %.3g times their noise", left)
    return left <= FOLLOWED


def _apply_generic_tests(state: SearchState, coarse: frozenset[str]) -> tuple[SpecificationTest, ...]:
    """Let the generic tests have their say - on further parameters of the causes, on needless ones -, and
    return them.
    """
    blocks = (*state.held, *adequacy(state.current))
    if not state.fitted.misfit and _is_unexplained(state, blocks, coarse):
        larger = with_further(state.current, state.causes)
        again = () if larger is None else (*state.held, *adequacy(larger))
        if larger is not None and not _is_unexplained(state, again, coarse):
            state.take(larger)
            blocks = again
    left_out = state.guarded(PRUNING, state.prune)  # what else is left, causes that are needed may stand
    blocks = (*state.held, *adequacy(state.current)) if left_out else blocks
    if state.fitted.misfit or _is_unexplained(state, blocks, coarse):
        return blocks
    for what, step in ((MOTION, state.set_in_motion), (LAW, state.let_law_err)):
        law = _significant(blocks, (), state.levels, coarse, {})  # beside noise, not beside its cause
        before = {**vars(state)}
        if not state.guarded(what, partial(step, law)):
            continue
        again = (*state.held, *adequacy(state.current))
        if not _is_unexplained(state, again, coarse):
            blocks = again
            continue
        vars(state).update(before)
        state.forget_columns()
    return blocks


def _is_unexplained(state: SearchState, blocks: Sequence[SpecificationTest], coarse: frozenset[str]) -> bool:
    return bool(_significant(blocks, state.causes, state.levels, coarse, state.least_listed))


def _of_shape(test: SpecificationTest, listed: Mapping[tuple[str, str], float]) -> list[float]:
    """Return ratios up to which what a test finds may be the shape of laws that are listed at its place."""
    shaped = test.dependence in ("rate", "load")
    return [0.0, *(x for (place, _), x in listed.items() if shaped and place == test.location)]


def _significant(
    blocks: Sequence[SpecificationTest],
    causes: Sequence[Cause],
    levels: DetectionThresholds,
    coarse: frozenset[str],
    listed: Mapping[tuple[str, str], float],
    *,
    white: bool = True,
) -> tuple[SpecificationTest, ...]:
    """Return the tests that are significant; misfit (not ``white``) and rounding need not be white, and of a
    law's shape, of causes or ``listed``, nature has the last word.
    """
    least = levels.beside * max((c.ratio for c in causes), default=0.0)
    return tuple(
        b
        for b in blocks
        if b.p_value * len(blocks) < levels.block
        and b.ratio > max(least, *_of_shape(b, listed))
        and (b.dependence != PAST or (white and b.where not in coarse))
    )
