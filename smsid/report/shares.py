"""How much of what the named causes do each other explanation, each equation, could account for."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid.diagnose.model_comparison import Cause
from smsid.diagnose.score_test import Candidate, changes_of, scored, signatures
from smsid.diagnose.specification_tests import PAST, adequacy
from smsid.diagnose.stepwise import Search
from smsid.errors import SmsidError
from smsid.estimation.map_estimate import Fit, Prior, evaluate
from smsid.estimation.sensitivities import propagate

LOGGER = logging.getLogger(__name__)
TELLING = 0.05  # share above which the strongest place counts as one


@dataclass(frozen=True)
class Place:
    """An equation or channel, what it may depend on, and the share [0, 1] of the misfit that it explains."""

    where: str
    dependence: str
    share: float
    freedom: int


@dataclass(frozen=True)
class CandidateShare:
    """A candidate and the share [0, 1] of the misfit that it alone explains."""

    candidate: Candidate
    share: float
    cause: bool
    alias: bool


@dataclass(frozen=True)
class Shares:
    """Shares of the misfit explained, the largest first; ``of_causes``: the misfit is what the causes do."""

    places: tuple[Place, ...]
    candidates: tuple[CandidateShare, ...]
    of_causes: bool

    @property
    def telling(self) -> bool:
        """Whether a place explains enough of the misfit to be seen."""
        return any(p.share >= TELLING for p in self.places)


def shares_of(search: Search) -> Shares | None:
    """Return the shares of the misfit that every equation and every candidate explains by itself.

    With causes, the misfit is what they do to the innovations, linear at the fit that has them. Without
    a strong cause the simulation strays so far that no derivative there says anything. Without
    causes it is what the nominal fit leaves. Everything nominal is free to move within its prior.
    ``None`` where nothing was measured.
    """
    found = without_causes(search)
    of_causes = found is not None
    found = search.nominal if found is None else found
    total = float(found.residual @ found.residual)
    if not total > 0.0:
        return None
    places = [
        Place(b.where, b.dependence, min(1.0, b.ratio / total), b.freedom)
        for b in adequacy(found)
        if b.dependence != PAST and b.freedom  # correlation in time is a symptom, and no share of squares
    ]
    return Shares(
        tuple(sorted(places, key=lambda p: -p.share)),
        _candidates(search, found, total),
        of_causes,
    )


def without_causes(search: Search) -> Fit | None:
    """Return the last fit with only nominal parameters free and what the causes do as its residual.

    ``None`` without causes, and where their part cannot be told.
    """
    if not search.causes:
        return None
    try:
        base = evaluate(search.last.point, search.nominal.unknowns, search.last.problem)
        part = sum(_contribution(search, base, cause) for cause in search.causes)
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("what the causes do: %s", error)
        return None
    part = np.asarray(part)
    if not float(part @ part) > 0.0:
        return None
    shape = base.run.innovations.shape
    count = int(np.prod(shape))
    run = replace(base.run, innovations=part[:count].reshape(shape))
    return replace(base, run=run, prior=Prior(-part[count:], base.prior.rows))


def _contribution(search: Search, base: Fit, cause: Cause) -> np.ndarray:
    """What a cause does to the innovations and priors (N rows + priors,), nominal ones projected out."""
    candidate = cause.score.candidate
    columns = propagate(base.run, changes_of(base, candidate)).reshape(-1, len(candidate.free))
    at = {u.name: search.last.point.value(u) for u in search.last.unknowns}
    if candidate.effect is None:
        nominal = {u.name: u for u in search.nominal.unknowns}
        size = [(at[n] - nominal[n].nominal) / nominal[n].scale for n in candidate.free]
    else:
        plain = {p.name: p.value for p in candidate.effect.parameters()}
        steps = zip(candidate.free, candidate.steps, strict=True)
        size = [(at.get(n, plain[n]) - plain[n]) / step for n, step in steps]
    return base.left(columns @ np.array(size)[:, None])[:, 0]


def _candidates(search: Search, found: Fit, total: float) -> tuple[CandidateShare, ...]:
    known: dict[tuple[str, str, str], Candidate] = {}
    for s in (*(c.score for c in search.causes), *search.scores):
        known.setdefault(s.candidate.key, s.candidate)
    listed = list(known.values())
    # a searched candidate that was narrowed down still has the columns of all it could be: not comparable
    columns = {i: c for i, c in signatures(found, listed).items() if c.shape[1] == len(listed[i].free)}
    named = {c.score.candidate.key for c in search.causes}
    aliases = {a.candidate.key for c in search.causes for a, _ in c.aliases}
    out: Sequence[CandidateShare] = [
        CandidateShare(
            s.candidate, min(1.0, s.ratio / total), s.candidate.key in named, s.candidate.key in aliases
        )
        for s in scored(found, [listed[i] for i in columns], list(columns.values()))
        if s.freedom
    ]
    # of equal shares the cause first, then the simpler
    return tuple(sorted(out, key=lambda c: (-round(c.share, 6), not c.cause, len(c.candidate.free))))
