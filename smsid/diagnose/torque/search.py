"""The search for what an arm's torques lack: score every candidate, take the best, fit again, prune."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.stats import f

from smsid.diagnose.thresholds import THRESHOLDS, DetectionThresholds
from smsid.diagnose.torque._equations import TorqueEquations, torque_equations
from smsid.diagnose.torque._fit import (
    TorqueFit,
    TorquePrior,
    TorqueTerm,
    fit_torques,
    moved_values,
    refit_as_identification,
    with_equations,
)
from smsid.diagnose.torque._noise import learn_noise
from smsid.diagnose.torque._scores import (
    TorqueScore,
    acts_on_all,
    correlation,
    predicts,
    score,
    score_candidates,
)
from smsid.diagnose.torque.candidates import SIMPLE, TorqueCandidate, instance
from smsid.diagnose.torque.whitening import CLUSTERS
from smsid.recording import Recording

LOGGER = logging.getLogger(__name__)
SETTLED = {"zero": 1e-3, "clock": 1e-4, "tilt": 1e-4}
"""A joint's zero [rad], a clock [s] or a tilt [rad] further off than this has the equations made again."""


LEVELS = DetectionThresholds(block=THRESHOLDS.torque_block, alias=THRESHOLDS.torque_alias)
"""Levels over all candidates and over all generic tests of measured torques."""


@dataclass(frozen=True)
class TorqueCause:
    """An accepted candidate with its score beside all other causes, and those not told from it, with
    correlations.
    """

    term: TorqueTerm
    score: TorqueScore
    aliases: tuple[tuple[TorqueScore, float], ...] = ()


@dataclass(frozen=True)
class TorqueSearch:
    """How a search ended: the fits without and with the causes, and the last scores, the best first.

    ``values`` is the last fit with values and covariance as identification has them.
    """

    nominal: TorqueFit
    last: TorqueFit
    values: TorqueFit
    causes: tuple[TorqueCause, ...]
    scores: tuple[TorqueScore, ...]
    candidates: int


def search_torques(
    equations: TorqueEquations,
    recording: Recording | Sequence[Recording],
    prior: TorquePrior,
    candidates: Sequence[TorqueCandidate],
) -> TorqueSearch:
    """Return the effects that a recording's torques ask for, found one after the other.

    What a joint's own viscous and Coulomb friction, rotor and constant torque explain is theirs; others at
    that joint must explain more, and couplings come last. A cause must be significant, gain in Bayes's
    criterion, and predict parts of the recording it was not fitted to.

    Raises:
        RecordingError: as `torque_equations`.
    """
    simple = [c for c in candidates if c.shape in SIMPLE]
    # any pair may be asked after the ones before; a sum and a difference ask the same of its second joint
    pairs = max(1, len({frozenset(c.joints) for c in candidates if len(c.joints) > 1}))
    # laws that come after simpler ones are spanned by those well enough, and each column takes noise away
    whitening = learn_noise(equations, [c for c in candidates if not c.simpler])
    nominal = current = fit_torques(equations, prior, (), whitening)
    causes: list[TorqueCause] = []
    rest, tried = list(candidates), len(candidates)
    coupled = False
    refused: set[int] = set()
    while len(causes) < THRESHOLDS.torque_causes * equations.torque.shape[1]:
        scores = score_candidates(current, rest if coupled else [c for c in rest if len(c.joints) == 1])
        hopeful = (s for s in scores if id(s.candidate) not in refused)
        best = next((s for s in hopeful if _significant(s, current, tried)), None)
        if best is None:
            if coupled:
                break
            coupled = True
            continue
        if not (predicts(current, best) and acts_on_all(current, best, simple, LEVELS.candidate / pairs)):
            LOGGER.info("%s does not hold everywhere", best.candidate.key)
            refused.add(id(best.candidate))
            continue
        best = _simplest(best, scores, current, tried)
        LOGGER.info("%s: ratio %.1f", best.candidate.key, best.ratio)
        rest = [c for c in rest if c is not best.candidate]
        refused.clear()  # what another hid may hold now
        cause = TorqueCause(TorqueTerm(best.candidate, best.kept), best)
        if best.candidate.moves:  # later the equations have it in them, and nothing of it is left to score
            cause = _beside_all(current, causes, cause, candidates)
        causes.append(cause)
        if best.candidate.shape == "stribeck":  # one curve a joint
            rest = [c for c in rest if c.key != best.candidate.key]
        causes, current = _refit_causes(current, causes, recording)
        causes, current = _backward_elimination(causes, current, recording, partial(_chance, tried=tried))
    told = partial(_chance_beside_all, tried=tried)  # with the p-value that a cause is told with
    fewer, current = _backward_elimination(causes, current, recording, told)
    if len(fewer) < len(causes):  # a joint's zero may have been needed beside it alone
        fewer, current = _refit_causes(current, fewer, recording)
        fewer, current = _backward_elimination(fewer, current, recording, partial(_chance, tried=tried))
    causes = fewer
    scores = score_candidates(current, rest)
    causes = [c if c.term.candidate.moves else _beside_all(current, causes, c, candidates) for c in causes]
    values = refit_as_identification(current)
    return TorqueSearch(nominal, current, values, tuple(causes), tuple(scores), tried)


def _simplest(
    best: TorqueScore,
    scores: Sequence[TorqueScore],
    current: TorqueFit,
    tried: int,
) -> TorqueScore:
    """Return the simplest law of the same joint that explains about as much as the best, or that one."""
    enough = best.gain(current.samples) - LEVELS.alias
    for shape in best.candidate.simpler:
        for s in scores:
            same = (s.candidate.location, s.candidate.shape) == (best.candidate.location, shape)
            if same and s.gain(current.samples) > enough and _significant(s, current, tried):
                return s
    return best


def _significant(s: TorqueScore, current: TorqueFit, tried: int) -> bool:
    if _is_below_stamps(s.candidate, s.estimate, current.equations):
        return False
    return s.p_value * tried < LEVELS.candidate and s.gain(current.samples) > 0.0


def _is_below_stamps(candidate: TorqueCandidate, x: np.ndarray, equations: TorqueEquations) -> bool:
    """Whether a delay is shorter than time stamps are to be believed."""
    return candidate.units == ("s",) and abs(float(x[0])) < THRESHOLDS.stamps * equations.interval


def _beside_all(
    current: TorqueFit,
    causes: Sequence[TorqueCause],
    cause: TorqueCause,
    candidates: Sequence[TorqueCandidate],
) -> TorqueCause:
    """Return a cause with its score beside all others, and what explains about as much in its place."""
    others = [c.term for c in causes if c is not cause]
    without = current.without(others)
    own = score(without, cause.term.candidate)
    if own is None:
        return cause
    named = {t.candidate.key for t in others} | {cause.term.candidate.key}
    # only what touches the same joints can stand in for it, and a coupling only for a coupling
    rivals = [
        c
        for c in candidates
        if c.key not in named
        and (set(c.joints) & set(own.candidate.joints) or "tilt" in {c.moves, own.candidate.moves})
        and len(c.joints) <= len(own.candidate.joints)
    ]
    best: dict[tuple[str, str, str], tuple[TorqueScore, float]] = {}
    for rival in rivals:
        s = score(without, rival)
        if s is None or own.gain(without.samples) - s.gain(without.samples) > LEVELS.alias:
            continue
        together = correlation(own, s)
        if together > THRESHOLDS.near and (rival.key not in best or best[rival.key][0].ratio < s.ratio):
            best[rival.key] = s, together
    return replace(cause, score=own, aliases=tuple(best.values()))


def _refit_causes(
    current: TorqueFit,
    causes: list[TorqueCause],
    recording: Recording | Sequence[Recording],
) -> tuple[list[TorqueCause], TorqueFit]:
    """Fit all causes; those that move the equations, on equations made with them, until they stay."""
    equations = current.equations
    for _ in range(5):
        load = current.load if current.equations is equations else None
        terms = [c.term for c in causes]
        prior = current.prior.on(equations)
        current = fit_torques(equations, prior, terms, current.whitening, load=load)
        moving = [c.term for c in causes if c.term.candidate.moves]
        shifts = [(t, current.term_values(t)[0]) for t in moving]
        if all(np.all(np.abs(x) < SETTLED[t.candidate.moves]) for t, x in shifts):
            break
        late, moved = equations.late, []
        for term, shift in shifts:
            if term.candidate.moves == "clock":
                late += float(shift[0])
            else:
                effect = instance(term.candidate, equations.description.effect)
                values = (moved_values(term) + shift).tolist()
                moved.append(effect.with_values(dict(zip(term.names, values, strict=True))))
        equations = torque_equations(
            equations.description.with_effects(*moved),
            recording,
            cutoff=equations.motion.cutoff,
            band=equations.band,
            late=late,
        )
        causes = [
            replace(c, term=with_equations(c.term, equations)) if c.term.candidate.moves else c
            for c in causes
        ]
    return causes, current


def _backward_elimination(
    causes: list[TorqueCause],
    current: TorqueFit,
    recording: Recording | Sequence[Recording],
    chance: Callable[[TorqueFit, TorqueCause, Sequence[TorqueCause]], float],
) -> tuple[list[TorqueCause], TorqueFit]:
    """Leave out, one by one, causes that the others made unnecessary, by the ``chance`` of one beside all."""
    while causes:
        chances = [chance(current, cause, causes) for cause in causes]
        worst = int(np.argmax(chances))
        if chances[worst] <= LEVELS.candidate:
            break
        LOGGER.info("%s is not needed any more", causes[worst].term.candidate.key)
        equations, load = current.equations, current.load
        if causes[worst].term.candidate.moves:
            equations = _moved_back(equations, causes[worst], recording)
            load = equations.motion.torque
        causes = [c for c in causes if c is not causes[worst]]
        terms = [c.term for c in causes]
        prior = current.prior.on(equations)
        current = fit_torques(equations, prior, terms, current.whitening, load=load)
    return causes, current


def _moved_back(
    equations: TorqueEquations, cause: TorqueCause, recording: Recording | Sequence[Recording]
) -> TorqueEquations:
    """Return the equations without what a joint's zero, the clock or the tilt moved them by."""
    own = cause.score.candidate
    assert own.effect is not None
    clock = own.moves == "clock"
    described = equations.description
    description = described if clock else described.with_effects(own.effect)
    late = 0.0 if clock else equations.late
    cutoff, band = equations.motion.cutoff, equations.band
    return torque_equations(description, recording, cutoff=cutoff, band=band, late=late)


def _chance_beside_all(
    current: TorqueFit, cause: TorqueCause, causes: Sequence[TorqueCause], *, tried: int
) -> float:
    """Corrected p-value of the score of a cause beside all others; nothing of one that moves the equations,
    which have it in them.
    """
    if cause.term.candidate.moves:
        return 0.0
    own = score(current.without([c.term for c in causes if c is not cause]), cause.term.candidate)
    return 1.0 if own is None else own.p_value * tried


def _chance(
    current: TorqueFit, cause: TorqueCause, causes: Sequence[TorqueCause] = (), *, tried: int
) -> float:
    """Corrected p-value of a cause beside all others, after Wald; 1 where Bayes's criterion loses.

    What moves the equations counts by how far they were moved.
    """
    index = [current.names.index(n) for n in cause.term.names]
    x, covariance = current.x[index], current.covariance[np.ix_(index, index)]
    if cause.term.candidate.moves:
        x = x + moved_values(cause.term) - moved_values(TorqueTerm(cause.score.candidate, cause.term.kept))
    if _is_below_stamps(cause.term.candidate, x, current.equations):
        return 1.0
    wald = float(x @ np.linalg.pinv(covariance) @ x)
    if wald < len(index) * np.log(current.samples):
        return 1.0
    return float(f.sf(wald / len(index), len(index), CLUSTERS - 1)) * tried
