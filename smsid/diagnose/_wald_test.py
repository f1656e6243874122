"""Wald's test of a candidate: whether its parameters, at a fit, are away from where they do nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.fft import dct
from scipy.stats import beta, chi2
from scipy.stats import f as fisher

from smsid._statistics import NORMAL95, squared_length
from smsid.diagnose.score_test import Candidate, Score
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.estimation.map_estimate import MapFit

STILL = 1e-6  # of a step: a strength that moved less is where the effect does nothing


def wald(found: MapFit, candidate: Candidate, *, held: bool = False, strength: bool = False) -> float:
    """Return Wald's statistic of a candidate's parameters at a fit: how far they are from doing nothing.

    Small beside a large likelihood ratio, they ran away: only without end would they explain what is there.
    ``held``: with its further parameters, which mean nothing without the effect, as they are. ``strength``:
    of what makes it do something alone; its frequency may be known where its mass is not. Beside misfit it is
    one as unlikely by chance as what it is over the errors along its own signature (`MapFit.slow_errors`).
    """
    index, shift = _shift_from_nothing(found, candidate)
    if strength:
        index, shift = index[strengths(candidate)], shift[strengths(candidate)]
    still = candidate.also if held else ()
    covariance = found.covariance(still, white=True)[index][:, index]
    if not found.problem.coloured:
        return squared_length(shift, covariance)
    # levels that were read with the cause in the errors bound the statistic, not its spread as it is now
    sigma = np.sqrt(np.diag(covariance))
    wider = np.linalg.norm(found.slow_errors(still)[index], axis=1) / np.where(sigma > 0.0, sigma, 1.0)
    wider, d = np.maximum(wider, 1e-9), int((sigma > 0.0).sum())
    far = squared_length(shift, covariance * np.outer(wider, wider))
    return float(chi2.isf(fisher.sf(far / d, d, THRESHOLDS.cosines), d)) if d else 0.0


def distance(found: MapFit, candidate: Candidate) -> float:
    """Return how many standard deviations, in squares, a candidate's parameters are from doing nothing."""
    index, shift = _shift_from_nothing(found, candidate)
    return squared_length(shift, found.covariance()[index][:, index])


def chance_of_nothing(found: MapFit, candidate: Candidate, before: MapFit, *, held: bool = False) -> float:
    """Return the chance, by Wald's statistic, of parameters as far from doing nothing as they are at a fit.

    Beside misfit, what its errors along one signature say of themselves is little; there it is that of taking
    as much of the misfit away as is left in the fit ``before``, without it, if that is less.
    """
    own = float(chi2.sf(wald(found, candidate, held=held), len(candidate.free)))
    return min(own, chance_of_share(before, found, candidate)) if found.problem.coloured else own


def chance_of_share(before: MapFit, after: MapFit, candidate: Candidate) -> float:
    """Return the chance that as much of any component's errors is gone ``after`` a candidate by nothing but
    their looking alike, all components paid for.

    Of errors with their power in n frequencies alike, d directions take a share that is Beta(d / 2, (n - d) /
    2) distributed. Directions of slow signatures are where slow errors have most: n is no more than the whole
    power over the largest at a frequency, so that of errors slower than the recording any share is chance.
    """
    power = np.asarray(dct(errors_left(before), axis=0, norm="ortho")) ** 2
    left, there = (errors_left(after) ** 2).sum(axis=0), power.any(axis=0)
    whole, largest, left = power.sum(axis=0)[there], power.max(axis=0)[there], left[there]
    freedom = len({u.name for u in after.unknowns} & candidate.parameters)
    rest = whole / largest - freedom
    told = rest > 0.0
    share = np.clip(1.0 - left / whole, 0.0, 1.0)[told]
    chances = beta.sf(share, 0.5 * freedom, 0.5 * rest[told])
    return min(1.0, len(whole) * float(chances.min(initial=1.0)))


def errors_left(found: MapFit) -> np.ndarray:
    """Return the errors (N, rows) that a fit leaves, or to first order what a step of it would."""
    q, _ = found.factors
    left = found.residual - q @ (q.T @ found.residual)
    return left[: found.run.innovations.size].reshape(found.run.innovations.shape)


def strengths(candidate: Candidate) -> np.ndarray:
    """Return which free parameters (d,) make it do something: the first, where the effect does not say."""
    fields = [name.split(".")[1] for name in candidate.free]
    stated = fields if candidate.effect is None else candidate.effect.strength
    named = np.array([field in stated for field in fields])
    return named if named.any() else np.arange(len(fields)) == 0


def each_may_be_zero(found: MapFit, candidate: Candidate) -> bool:
    """Whether the 95 % interval of every parameter that makes a candidate do something holds nothing."""
    names = [u.name for u in found.unknowns]
    index = np.array([names.index(n) for n in candidate.free])[strengths(candidate)]
    sigma = np.sqrt(np.diag(found.covariance())[index])
    shift = [found.point.value(found.unknowns[i]) - found.unknowns[i].nominal for i in index]
    return bool((np.abs(shift) <= NORMAL95 * sigma).all())


def as_fitted(score: Score, found: MapFit) -> Score:
    """Return a score as of a fit with its candidate: by Wald, where no model without it follows."""
    own = {u.name: found.point.value(u) - u.nominal for u in found.unknowns}
    free = zip(score.candidate.free, score.candidate.steps, strict=True)
    return replace(
        score, ratio=wald(found, score.candidate), estimate=np.array([own[n] / s for n, s in free])
    )


def _shift_from_nothing(found: MapFit, candidate: Candidate) -> tuple[np.ndarray, np.ndarray]:
    """Return the places (d,) of a candidate's parameters in a fit, and how far they moved (d,): nothing where
    what makes it do something has not, whatever its spring and its place are.
    """
    names = [u.name for u in found.unknowns]
    index = np.array([names.index(n) for n in candidate.free])
    shift = np.array([found.point.value(found.unknowns[i]) - found.unknowns[i].nominal for i in index])
    still = (np.abs(shift) < STILL * np.array(candidate.steps))[strengths(candidate)].all()
    return index, np.zeros_like(shift) if still else shift
