"""Effects far from where they were described: whether a likelier maximum lies nearer.

A likelihood of hidden masses has many maxima, and a search on its way from a first guess may be caught in
one: a spring run off to nothing, a mode that rings and moves nobody. From there, what is far off is set back
to its description, all else left, and searched for anew: what is right comes to the same maximum once more.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence

import numpy as np

from smsid._statistics import NORMAL95
from smsid.errors import SmsidError
from smsid.estimation._maximum import maximise
from smsid.estimation._normal_equations import NormalEquations
from smsid.estimation.flight import Flight
from smsid.estimation.likelihood_profile import BETTER_GAIN
from smsid.estimation.parameter_vector import Unknown

LOGGER = logging.getLogger(__name__)
GUESS_ERROR = 0.3  # share by which a described effect is off, as is believed until recordings tell otherwise
FAR = 2.0  # such errors, from which on a parameter is set back
MOST_RESTARTS = 3  # times that setting back has led to a likelier maximum, and it is asked anew

Tell = Callable[[str], None]


def guess_sigma(unknown: Unknown) -> float:
    """Return the standard deviation of an effect's parameter as first guessed, the prior's of others."""
    if unknown.kind != "effect" or not unknown.nominal:
        return unknown.sigma
    return min(unknown.sigma, GUESS_ERROR * abs(unknown.nominal))


def likeliest_of_restarts(
    found: NormalEquations, flights: Sequence[Flight], tell: Tell | None = None
) -> tuple[NormalEquations, list[NormalEquations]]:
    """Return the likeliest point that searches come to with effects set back, and the points on the way."""
    visited: list[NormalEquations] = []
    for _ in range(MOST_RESTARTS):
        back = _way_back(found)
        if back @ found.gram @ back < NORMAL95**2:
            break
        far = [u.name for u, x in zip(found.unknowns, back, strict=True) if x]
        if tell is not None:
            tell(f"again with {', '.join(far)} as described")
        try:
            start = found.point.moved(found.unknowns, back * found.scales)
            there, more = maximise(start, found.unknowns, flights, tell=tell)
        except (SmsidError, np.linalg.LinAlgError) as error:
            LOGGER.info("not with %s as described: %s", ", ".join(far), error)
            break
        LOGGER.info("with %s as described: %+.2f", ", ".join(far), found.objective - there.objective)
        if found.objective - there.objective < BETTER_GAIN:
            break
        found, visited = there, [*visited, *more]
    return found, visited


def _way_back(found: NormalEquations) -> np.ndarray:
    """Return the step (m,), in scales, to the description of every effect's parameter that is far from it."""
    out = np.zeros(len(found.unknowns))
    for i, u in enumerate(found.unknowns):
        away = found.point.value(u) - u.nominal
        if u.kind == "effect" and abs(away) > FAR * guess_sigma(u) > 0.0:
            out[i] = -away / u.scale
    return out
