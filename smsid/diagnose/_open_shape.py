"""A law of friction that nature has in size only: its shape is left open, its torque errs as is likeliest.

What a sign of the rate looks like near rest, or how a curve falls, no catalogue has exactly. Of a strong one
far more than the noise is left. Then the torque of its joint has noise whose errors repeat with the rate, see
`smsid.estimation._shape_errors`; which law it is, is asked of all at once.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.stats import chi2

from smsid.arm.columns import JointStates
from smsid.diagnose._noise_covariance import fit_to_stated_noise
from smsid.diagnose._step_size_check import refine_steps
from smsid.diagnose._wald_test import as_fitted
from smsid.diagnose.model_comparison import Cause
from smsid.diagnose.score_test import (
    Candidate,
    Score,
    correlation,
    linear_torques,
    score_candidates,
    signatures,
)
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.errors import SmsidError
from smsid.estimation.joint_problem import at_point
from smsid.estimation.kalman import run_filter
from smsid.estimation.map_estimate import MapFit, evaluate, fit
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.estimation.problem import Problem

LOGGER = logging.getLogger(__name__)
ROUNDS = 8  # times at most that a fit and the likeliest noise of its torque are brought together
SPAN = 4.0  # decades below the torque itself in which that noise is looked for
NEAR = 0.1  # decades within which it stays, at which a search ends
EXACT = 0.02  # decades to which it is looked for: by 0.1 off, laws differ by more than their odds
TOGETHER = 2  # laws of one joint at most
STANDING = 3  # sets of laws that are fitted without the others of their place


def may_be_open(candidate: Candidate, problem: Problem) -> bool:
    """Whether a candidate's law is known in size only, and there all the time."""
    effect = candidate.effect
    own = effect is not None and bool(effect.open_shape) and type(candidate) is Candidate
    return own and candidate.start is None and not candidate.recording and not problem.noise.shapes


def with_errors_of_shape(
    found: MapFit, candidate: Candidate, candidates: Sequence[Candidate]
) -> tuple[MapFit, tuple[Cause, ...]]:
    """Return the fit with the torque of a law that is named erring as is likeliest, and none; or with a
    simpler law of its place that is about as likely if it errs (by Bayes's criterion), and the cause it is.

    A law that follows to a thousandth of what it does is nature's in size, not in shape: of a strong one the
    rest is far beyond the noise, and intervals that trust the shape do not hold. Nor may a law that was
    better while none could err be any better then.
    """
    dof = _dof(found.point, candidate.location)
    erring = _fit_torque_noise(found.point, found.unknowns, found.problem, dof)
    within = [c for c in candidates if candidate.holds(c) or candidate.extends(c)]
    simpler = [c for c in within if c is not candidate and may_be_open(c, found.problem)]
    laws = [candidate, *simpler]
    own = {n for c in laws for n in c.free} | {u.name for c in laws for u in _further(erring.point, c)}
    rest = [u for u in erring.unknowns if u.name not in own]
    every = {u.name: u for c in laws for u in (*c.unknowns(rest), *_further(erring.point, c))}
    taken = len(erring.unknowns) - len(rest)
    least, causes = 2.0 * erring.objective + taken * float(np.log(erring.run.samples)), ()
    least += THRESHOLDS.alias
    for law in simpler:
        paid, alone = _fit_alone(erring, (law,), laws, every, rest, dof)
        LOGGER.info("%s errs: %.1f, asked: %.1f", law.key, paid, least)
        if paid < least:
            least, erring = paid, alone
            causes = _causes(alone, rest, (law,), {candidate.key: candidate})
    return erring, causes


def with_open_shape(
    point: Point,
    unknowns: Sequence[Unknown],
    problem: Problem,
    candidate: Candidate,
    candidates: Sequence[Candidate],
) -> tuple[MapFit, tuple[Cause, ...]] | None:
    """Return the fit with the shape of a cause's law left open, and the laws that it takes; nothing where the
    recording is not followed to the noise so, or the torque errs by more than `THRESHOLDS.mostly` leaves.

    All laws of the place are fitted together: those are named beside which the others may be nothing.
    Noise levels are those of the fit's problem.
    """
    laws = [c for c in candidates if c.key[:2] == candidate.key[:2] and may_be_open(c, problem)]
    laws = [c for c in laws if not c.simpler]  # else too many that can do the same, to first order
    try:
        dof = _dof(point, candidate.location)
        own = {n for c in (candidate, *laws) for n in c.free} | {
            u.name for c in laws for u in _further(point, c)
        }
        rest = [u for u in unknowns if u.name not in own]
        every = {u.name: u for c in laws for u in (*c.unknowns(rest), *_further(point, c))}
        both = [*rest, *every.values()]
        # what stiff friction does within a step would pass for an error of its shape
        fitted = refine_steps(
            _fit_torque_noise(point, both, problem, dof),
            lambda from_there, shorter: _fit_torque_noise(from_there, both, shorter, dof),
        )
        told = _smallest_accepted_sets(fitted, laws)
        if not told:
            return None
        # all of them may be what acts there if the rest errs; each by itself errs by as much as it lacks
        alone = [(*_fit_alone(fitted, some, laws, every, rest, dof), some) for some in told[:STANDING]]
        price, fitted, named = min(alone, key=lambda x: x[0])
        near = [some for paid, _, some in alone if some is not named and paid - price < THRESHOLDS.alias]
        near += told[STANDING:]
        exact = fit_to_stated_noise(fitted.point, fitted.unknowns, fitted.problem)
        if exact is None:
            return None
        torque = _torque(exact, named)
        ((_, sigma),) = exact.problem.noise.shapes
        LOGGER.info("torque of %s: %.4g, its shape left open by %.4g", candidate.location, torque, sigma)
        if sigma**2 > (1.0 - THRESHOLDS.mostly) * torque**2:
            return None
        return exact, _causes(exact, rest, named, {c.key: c for some in near for c in some})
    except (SmsidError, np.linalg.LinAlgError, KeyError) as error:
        LOGGER.info("%s: its shape is not left open: %s", candidate.key, error)
        return None


def _dof(point: Point, joint: str) -> int:
    groups = (point.base.arm_joints, point.base.wheels)
    return {n: int(v) for g in groups for n, v in zip(g.names, g.v, strict=True)}[joint]


def _further(point: Point, candidate: Candidate) -> list[Unknown]:
    """Return the further parameters of a law, and those of its shape."""
    effect = candidate.instance(point)
    known = {p.name: p for p in effect.parameters()}
    names = dict.fromkeys((*candidate.also, *(f"{effect.name}.{field}" for field in effect.open_shape)))
    return [Unknown.of_parameter(p, np.inf, 1e-2) for n in names for p in (known[n],)]


def _fit_torque_noise(point: Point, unknowns: Sequence[Unknown], problem: Problem, dof: int) -> MapFit:
    """Return a fit with the noise of a torque at which it is likeliest."""
    drive = problem.inputs(point.model()).applied(point.model())
    size = float(np.sqrt(np.mean([drive(float(t))[dof] ** 2 for t in problem.data.times[::10]])))
    tried = 1.0
    for _ in range(ROUNDS):
        model, here = point.model(), at_point(point, problem)

        def unlikely(decades: float, model=model, here=here) -> float:
            return -run_filter(model, _loose(here, dof, size * 10.0**decades)).log_likelihood

        best = minimize_scalar(unlikely, bounds=(-SPAN, 0.5), method="bounded", options={"xatol": EXACT})
        found = fit(point, unknowns, _loose(problem, dof, size * 10.0**best.x), iterations=6)
        point, problem, before, tried = found.point, found.problem, tried, best.x
        if abs(tried - before) < NEAR:
            break
    return found


def _loose(problem: Problem, dof: int, sigma: float) -> Problem:
    return replace(problem, noise=replace(problem.noise, shapes=((dof, sigma),)))


def _fit_alone(
    found: MapFit,
    named: Sequence[Candidate],
    laws: Sequence[Candidate],
    every: Mapping[str, Unknown],
    rest: Sequence[Unknown],
    dof: int,
) -> tuple[float, MapFit]:
    """Return what laws without the others of their place cost (Bayes's criterion), and the fit, in which the
    torque errs as is likeliest beside them.
    """
    mine = {n for c in named for n in c.free}
    off = {n: every[n].nominal for c in laws for n in c.free if n not in mine}
    effect = named[0].instance(found.point).with_values(off)
    kept = {u.name: u for c in named for u in (*c.unknowns(rest), *_further(found.point, c))}
    try:
        alone = _fit_torque_noise(
            found.point.with_effect(effect), [*rest, *kept.values()], found.problem, dof
        )
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("not by %s alone: %s", [c.shape for c in named], error)
        return np.inf, found
    return 2.0 * alone.objective + len(kept) * float(np.log(alone.run.samples)), alone


def _smallest_accepted_sets(found: MapFit, laws: Sequence[Candidate]) -> list[tuple[Candidate, ...]]:
    """Return the fewest laws beside which all others of a place may be nothing, in the order of the chance
    that they are.
    """
    names = [u.name for u in found.unknowns]
    covariance = found.covariance()
    for few in range(1, TOGETHER + 1):
        chances = []
        for some in combinations(laws, few):
            rest = {n for c in laws for n in c.free} - {n for c in some for n in c.free}
            index = [names.index(n) for n in rest]
            value = np.array([found.point.value(found.unknowns[i]) for i in index])
            sigma = np.sqrt(np.diag(covariance)[index])
            sigma = np.where(sigma > 0.0, sigma, 1.0)
            scaled = covariance[np.ix_(index, index)] / np.outer(sigma, sigma)
            told = float(value / sigma @ np.linalg.pinv(scaled, hermitian=True) @ (value / sigma))
            chances.append((float(chi2.sf(told, len(index))), some))
        LOGGER.info(
            "laws: %s",
            [(p, [c.shape for c in some]) for p, some in sorted(chances, key=lambda x: -x[0])[:6]],
        )
        stand = sorted((c for c in chances if c[0] > THRESHOLDS.beyond), key=lambda c: -c[0])
        if stand:
            return [some for _, some in stand]
    return []


def _torque(found: MapFit, named: Sequence[Candidate]) -> float:
    """Return the rms of the torque of laws along a motion."""
    s, effect = found.run.middle, named[0].instance(found.point)
    values = {p.name: p.value for p in effect.parameters()}
    free = sorted({n for c in named for n in c.free})
    states = JointStates(s.q, s.v, s.a, s.tau)
    own = linear_torques(effect, [n.partition(".")[2] for n in free], found.changes.model, states)
    return float(np.sqrt(np.mean(np.sum([values[n] * own[n].sum(axis=1) for n in free], axis=0) ** 2)))


def _causes(
    found: MapFit,
    rest: Sequence[Unknown],
    named: Sequence[Candidate],
    others: dict[tuple[str, str, str], Candidate],
) -> tuple[Cause, ...]:
    """Return laws as causes; those that are not rejected in their place look like each of them."""
    less = evaluate(found.point, rest, found.problem)
    both = [*named, *(c for c in others.values() if c not in named)]
    columns = signatures(less, both)
    scores: list[Score] = score_candidates(less, [both[i] for i in columns], list(columns.values()))
    own = {s.candidate.key: s for s in scores}
    out = []
    for c in named:
        near = [s for s in scores if s.candidate.key in others and s.candidate not in named]
        score = as_fitted(own[c.key], found)
        aliases = tuple((s, correlation(own[c.key], s)) for s in near)
        told = Cause.of(own[c.key], aliases, score.ratio)
        out.append(replace(told, score=score).with_own_columns())
    return tuple(out)
