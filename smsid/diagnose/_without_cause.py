"""A fit less one of its causes, to first order, and what the cause explains beside the others."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from smsid.diagnose.model_comparison import Cause
from smsid.diagnose.score_test import Candidate, Score, signatures
from smsid.errors import NotIdentifiableError, SmsidError
from smsid.estimation.map_estimate import MapFit, evaluate, fit, prior_of
from smsid.estimation.sensitivities import propagate

LOGGER = logging.getLogger(__name__)


def without_cause(found: MapFit, candidate: Candidate, nominal: MapFit) -> MapFit:
    """Return a fit less a cause, to first order: what its effect does along the motion is left again. Of one
    that moves by itself, without which there is less to move, it is filtered again.

    Its parameters are bound by their priors again, or no longer there; the others are free to make up for it,
    but do not yet. Raises `SimulationError` where that cannot be filtered.
    """
    own = candidate.parameters
    point, run, effect = found.point, found.run, candidate.effect
    bound = {u.name: u for u in nominal.unknowns if u.name in own}
    kept = [i for i, u in enumerate(found.unknowns) if u.name not in own or u.name in bound]
    free = [found.unknowns[i] for i in kept]
    unknowns = tuple(bound.get(u.name, u) for u in free)
    whitened = found.whitened[:, :, kept] * [b.scale / u.scale for b, u in zip(unknowns, free, strict=True)]
    if effect is not None:
        mine, stated = candidate.instance(point), {p.name: p.value for p in effect.parameters()}
        plain = mine.with_values({n: stated[n] for n in candidate.free})
        try:
            done = propagate(run, [found.changes.effect(plain, mine, 1.0)])[:, :, 0]
        except NotIdentifiableError:  # its own motion goes with it
            done = None
        point = point.with_effect(plain)
        known = {e.name for e in nominal.point.description.effect}
        if effect.name not in known and not any(u.name.startswith(f"{effect.name}.") for u in unknowns):
            others = tuple(e for e in point.description.effect if e.name != effect.name)
            point = replace(point, description=point.description.model_copy(update={"effect": others}))
        if done is None:
            return evaluate(point, unknowns, found.problem)
        run = replace(run, innovations=run.innovations + done)
    flat, prior = whitened.reshape(-1, len(unknowns)), prior_of(point, unknowns, found.problem)
    gram = flat.T @ flat + prior.rows.T @ prior.rows
    slope = flat.T @ run.innovations.ravel() - prior.rows.T @ prior.off
    less = MapFit(point, unknowns, found.problem, run, whitened, gram, slope, 0.0, found.changes, prior)
    more = float(less.residual @ less.residual - found.residual @ found.residual)
    return replace(less, objective=found.objective + 0.5 * more)


def fit_without_cause(last: MapFit, cause: Cause, nominal: MapFit) -> MapFit | None:
    """Return a fit less a cause to first order; refitted, where how it moves itself is not of first order."""
    try:
        less = without_cause(last, cause.score.candidate, nominal)
        if less.point.model().nv != last.changes.model.nv:
            less = fit(less.point, less.unknowns, less.problem, iterations=8)
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("%s is not taken out: %s", cause.score.candidate.key, error)
        return None
    return less


def score_of_cause(last: MapFit, less: MapFit, cause: Cause) -> Score:
    """Return the score of a cause beside the others: what the fit loses without it."""
    index = [i for i, u in enumerate(last.unknowns) if u.name in cause.score.candidate.free]
    columns = last.whitened[:, :, index].reshape(-1, len(index))
    (beside,) = less.projected([columns])
    return replace(
        cause.score,
        ratio=residual_squares(less) - residual_squares(last),
        columns=beside.left,
        taken=beside.taken,
    )


def residual_squares(found: MapFit) -> float:
    """Return the sum of squares that no step of the fitted parameters takes away."""
    q, _ = found.factors
    within = q.T @ found.residual
    return float(found.residual @ found.residual - within @ within)


def columns_by_key(found: MapFit, candidates: Sequence[Candidate]) -> dict[tuple[str, str, str], np.ndarray]:
    """Return the whitened columns (N rows, d) of every candidate that has any."""
    return {candidates[i].key: c for i, c in signatures(found, candidates).items()}


def rivals_beside(candidates: Iterable[Candidate], others: Sequence[Cause]) -> list[Candidate]:
    """Return the candidates that may take a place beside other causes: none that frees a parameter of theirs,
    or whose own they free. A law that another contains has nothing to explain, and cannot be taken out again.
    """
    taken = [c.score.candidate for c in others]
    free = {n for c in taken for n in c.free}
    every = {n for c in taken for n in c.parameters}
    return [c for c in candidates if not (every & set(c.free) or free & c.parameters)]
