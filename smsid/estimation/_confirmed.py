"""Contradictions between recordings that the likelihood sees, too, and not the normal equations alone."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np
from scipy.special import chdtri

from smsid.errors import SmsidError
from smsid.estimation._contradictions import Contradiction, covariances_of, within_bounds
from smsid.estimation._normal_equations import NormalEquations, objective_of
from smsid.estimation._retraction import retract
from smsid.estimation.flight import Flight

LOGGER = logging.getLogger(__name__)
KEPT_SHARE = 0.4  # of what is promised by normal equations that has to be there
SHARES = (1.0, 0.5, 0.25, 0.1)  # of a step that are tried
BY_CHANCE = 1e-6  # probability of a gain by all parameters together above which it is none


def confirmed(
    claims: Sequence[Contradiction],
    found: NormalEquations,
    flights: Sequence[Flight],
    widening: float = 1.0,
) -> tuple[Contradiction, ...]:
    """Return the contradictions of which something is left where normal equations are not believed.

    Away from the joint optimum, where they say that a recording and the others would like to be, both have to
    be likelier by much of what is promised, or by more than chance (``widening`` times the stated noise) and
    all parameters could: what friction at rest or a mass below zero promises is none.
    """
    free = within_bounds(found)
    both, width = np.ix_(free, free), len(free)
    prior = np.diag((found.scales / np.array([u.sigma for u in found.unknowns])) ** 2)[both]
    out = []
    for claim in claims:
        promised = gained = 0.0
        for own in (True, False):
            terms = [t for t in found.recordings if (t.label == claim.recording) == own]
            side = [f for f in flights if (f.label == claim.recording) == own]
            gram = np.sum([t.gram for t in terms], axis=0)[both]
            slope = np.sum([t.slope for t in terms], axis=0)[free]
            move = covariances_of(gram, prior)[0] @ slope
            promised += float(slope @ move - 0.5 * move @ gram @ move)
            step = np.zeros(len(found.unknowns))
            step[free] = move
            gained += _largest_gain(found, side, step)
        LOGGER.info("'%s' against the others: %.4g promised, %.4g seen", claim.recording, promised, gained)
        if gained > min(KEPT_SHARE * max(promised, 0.0), 0.5 * widening**2 * float(chdtri(width, BY_CHANCE))):
            out.append(claim)
    return tuple(out)


def _largest_gain(found: NormalEquations, flights: Sequence[Flight], step: np.ndarray) -> float:
    """Return by how much some flights are likelier along a step (m,), in scales, at best."""
    here, best = objective_of(found.point, (), flights), 0.0
    for share in SHARES:
        try:
            there = retract(found.point, found.unknowns, share * step * found.scales)
            best = max(best, here - objective_of(there, (), flights))
        except (SmsidError, np.linalg.LinAlgError):
            continue
    return best
