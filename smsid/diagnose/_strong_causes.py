"""Strong causes first: where the nominal model cannot follow, one that may err names what is wrong.

Far off, the filter of the nominal model loses the recording, or runs along a motion that never was: no
derivative there means anything. With process noise of a good part of what drives the motion it follows the
motion as measured. Strong causes are tried so, each from where a strong one would be, fitted with less and
less of that noise, and compared by their likelihoods without any.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from smsid.diagnose._cause_in_motion import with_dynamics
from smsid.diagnose._noise_covariance import MISFIT, SHARES, normalised_rmse
from smsid.diagnose._open_shape import may_be_open, with_open_shape
from smsid.diagnose._plausibility import impossible_fit
from smsid.diagnose._wald_test import as_fitted, strengths
from smsid.diagnose.model_comparison import Cause, unfitted_parameters
from smsid.diagnose.score_test import Candidate, score_candidates, signatures
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.errors import SmsidError
from smsid.estimation.joint_problem import at_point, thin_problem, with_likely_timing, with_timing_of
from smsid.estimation.kalman import run_filter
from smsid.estimation.loosening import loosen_model
from smsid.estimation.map_estimate import MapFit, evaluate, fit
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.estimation.problem import Problem

LOGGER = logging.getLogger(__name__)
COMPARISON_RATE = 5.0  # [Hz] at which strong causes are compared at first
SUBSTEP = 0.05  # [s] of the integration there
LIKELY = 12  # candidates that are begun as strong as to first order
AHEAD = 8  # candidates that are compared where each is likeliest
ENOUGH = 10.0  # gain of the log-likelihood below which that is near enough
TRIED = 3  # candidates that are fitted, and more where none of them leads anywhere
LEAST = -1e12  # log-likelihood of a model that is lost, for comparison


@dataclass(frozen=True)
class Coarse:
    """A cause with which the model follows the recording (or two laws of one), and the fit with it, to the
    noise as stated.

    ``nominal`` is of the nominal parameters as given, in a model that may err.
    """

    nominal: MapFit
    fit: MapFit
    causes: tuple[Cause, ...]


def coarse_cause(
    point: Point, problem: Problem, unknowns: Sequence[Unknown], candidates: Sequence[Candidate]
) -> Coarse | None:
    """Return the strong cause that makes the model follow a recording, if one does.

    What cannot be filtered or fitted loses that candidate only.
    """
    coarse = replace(thin_problem(problem, COMPARISON_RATE), substep=SUBSTEP)
    best: dict[tuple[str, str, str], tuple[float, Candidate, Point]] = {}
    starts = _starts(point, candidates, [p.label for p in problem.parts])
    for candidate, start in chain(starts, _linear_starts(point, coarse, unknowns, candidates)):
        likely = _likelihood(start, coarse)
        if candidate.key not in best or likely > best[candidate.key][0]:
            best[candidate.key] = likely, candidate, start
    nothing = max(_likelihood(point, coarse), LEAST)
    ahead = sorted((s for s in best.values() if s[0] > nothing), key=lambda s: -s[0])
    ahead = [(*_as_likely_as_can_be(at, c, coarse, likely), c) for likely, c, at in ahead[:AHEAD]]
    ahead = sorted(((likely, c, at) for likely, at, c in ahead), key=lambda s: -s[0])
    LOGGER.info("coarse: %.1f without; %s", nothing, [(c.key, likely) for likely, c, _ in ahead])
    fitted: list[tuple[Candidate, MapFit, tuple[Cause, ...]]] = []
    tried = 0
    for likely, c, at in ahead:
        most, best_one, _ = ahead[0]
        close = likely - nothing > THRESHOLDS.close * (most - nothing)
        # where a model may err, laws of one effect differ less by their likelihood than by where they begin
        alike = close or c.key[:2] == best_one.key[:2]
        known = any(laws and c.key[:2] == own.key[:2] for own, _, laws in fitted)
        if known or (fitted and (tried >= TRIED or not alike)):
            continue
        tried += 1
        found = _fit_with_less_process_noise(c, at, problem, unknowns, candidates)
        fitted += [] if found is None else [(c, *found)]
    if not fitted:
        return None
    candidate, found, laws = min(fitted, key=lambda x: x[1].objective)
    try:
        nominal = evaluate(point, unknowns, loosen_model(point.model(), problem, SHARES[0]))
        if laws:
            return Coarse(nominal, found, laws)
        score = score_candidates(nominal, [candidate], list(signatures(nominal, [candidate]).values()))[0]
    except (SmsidError, np.linalg.LinAlgError, IndexError) as error:
        LOGGER.info("%s cannot be scored: %s", candidate.key, error)
        return None
    # not against the model without it, which loses the recording, nor in one that may err: all are alike
    score = as_fitted(score, found)
    return Coarse(nominal, found, (Cause(score, (), score.ratio).with_own_columns(),))


def _starts(
    point: Point, candidates: Sequence[Candidate], recordings: Sequence[str]
) -> Iterator[tuple[Candidate, Point]]:
    """Yield candidates with points at which they are strong, one parameter at a time; in all recordings, and
    in each of several alone.
    """
    for candidate in candidates:
        if candidate.effect is None:
            continue
        effect = candidate.instance(point)
        names = [n for n, strong in zip(candidate.free, strengths(candidate), strict=True) if strong]
        values = [effect.strong.get(name.split(".")[1], ()) for name in names]
        if not all(values):
            continue
        for name, strong_ones in zip(names, values, strict=True):
            for value in strong_ones:
                try:
                    strong = effect.with_values({name: value})
                except SmsidError:  # beyond its bounds
                    continue
                for recording in ("", *recordings):
                    own = replace(candidate, recording=recording)
                    yield own, point.with_effect(strong, recording)


def _linear_starts(
    point: Point, problem: Problem, unknowns: Sequence[Unknown], candidates: Sequence[Candidate]
) -> Iterator[tuple[Candidate, Point]]:
    """Yield candidates, those that explain most, with points at which they are as strong as to first order.

    Nobody can state how strong a strong one is of what acts with its size (a force from outside, a bias), and
    a model that may err is linear about nearly the motion that was measured. Of what has values that are
    strong (a motor that turns the other way), some between these may be as strong for this recording.
    """
    sized = [c for c in candidates if c.effect is not None]
    try:
        loose = evaluate(point, unknowns, loosen_model(point.model(), at_point(point, problem), SHARES[0]))
        known = signatures(loose, sized)
        scores = score_candidates(loose, [sized[i] for i in known], list(known.values()))
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("nothing is known to first order: %s", error)
        return
    scores = sorted((s for s in scores if s.freedom), key=lambda s: -s.ratio)
    stated = [s for s in scores if s.candidate.effect and s.candidate.effect.strong]
    others = [s for s in scores if s.candidate.effect and not s.candidate.effect.strong]
    for s in (*others[:LIKELY], *stated[:LIKELY]):
        c = s.candidate
        try:
            size = s.estimate * np.array(c.steps)
            yield c, point.with_effect(c.instance(point), c.recording).moved(c.unknowns(()), size)
        except SmsidError as error:
            LOGGER.info("%s is not as large as to first order: %s", c.key, error)


def _likelihood(point: Point, problem: Problem) -> float:
    """Return the log-likelihood with a model that may err; minus infinity where there is none."""
    try:
        if not point.physical():
            return -np.inf
        model = point.model()
        found = run_filter(model, loosen_model(model, at_point(point, problem), SHARES[0])).log_likelihood
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.debug("no likelihood: %s", error)
        return -np.inf
    return found if np.isfinite(found) else -np.inf


def _as_likely_as_can_be(
    start: Point, candidate: Candidate, problem: Problem, likely: float
) -> tuple[float, Point]:
    """Return the log-likelihood that a candidate's own parameters come to with a model that may err, and
    where; that of the start where they come nowhere.
    """
    try:
        own, loose = candidate.unknowns(()), loosen_model(start.model(), problem, SHARES[0])
        found = fit(start, own, loose, iterations=4, enough=ENOUGH)
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("%s stays as it was begun: %s", candidate.key, error)
        return likely, start
    reached = _likelihood(found.point, problem)  # its own noise goes with the model, there and here
    return (reached, found.point) if reached > likely else (likely, start)


def _fit_with_less_process_noise(
    candidate: Candidate,
    start: Point,
    problem: Problem,
    nominal: Sequence[Unknown],
    candidates: Sequence[Candidate],
) -> tuple[MapFit, tuple[Cause, ...]] | None:
    """Return a fit with less and less process noise, to none, or with its causes one with the shape of its
    law left open; nothing where it does not follow then.

    Nominal parameters are free only where the cause has been fitted: before, they would go anywhere.
    """
    own = candidate.unknowns(nominal)
    unknowns = (*(u for u in nominal if u.name not in {o.name for o in own}), *own)
    try:
        first = loosen_model(start.model(), problem, SHARES[0])
        begun = fit(start, own, first, iterations=6)
        point = begun.point  # of a strong payload, where its mass is matters
        unknowns = (*unknowns, *unfitted_parameters(begun, candidate))
        # only now does it show how commands act between samples
        problem = with_timing_of(
            problem, with_likely_timing(point, loosen_model(point.model(), problem, SHARES[1]))
        )
        for share in SHARES[1:]:
            point = fit(point, unknowns, loosen_model(point.model(), problem, share), iterations=6).point
        found = fit(point, unknowns, problem, iterations=10)
        if normalised_rmse(found.run) > THRESHOLDS.noise_left:
            found = with_dynamics(found, candidate, start)
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("%s does not follow: %s", candidate.key, error)
        return None
    left = normalised_rmse(found.run)
    LOGGER.info("%s leaves %.3g times the noise", candidate.key, left)
    if impossible_fit(found, candidate):
        return None
    if left <= MISFIT:
        return None if found.stretch > THRESHOLDS.strays else (found, ())
    if not may_be_open(candidate, problem):
        return None
    opened = with_open_shape(point, unknowns, problem, candidate, candidates)  # the last fit is bent to it
    return None if opened is None or opened[0].stretch > THRESHOLDS.strays else opened
