"""Effects of one kind that may have been taken for each other: the other maximum, and how likely it is.

Two panels that ring at nearly the same frequency have two maxima, the one with what rings exchanged. Which of
them a search comes to is its first guess's doing, and a standard deviation there knows nothing of the other.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.special import expit

from smsid._statistics import NORMAL95
from smsid.errors import SmsidError
from smsid.estimation.flight import Flight
from smsid.estimation.flight_search import settled_maximum
from smsid.estimation.likelihood_profile import BETTER_GAIN
from smsid.estimation.maximum import has_converged, maximise
from smsid.estimation.normal_equations import NormalEquations
from smsid.estimation.parameter_vector import Point, Unknown

LOGGER = logging.getLogger(__name__)
APART = NORMAL95  # standard deviations by which an exchange has to move what it exchanges
UNDECIDED = 0.025  # probability of the other maximum from which 95 % do without it no more
GUESS_RATIO = 1.7  # of two masses or springs, within which first guesses may have them the wrong way round

Tell = Callable[[str], None]


@dataclass(frozen=True)
class Exchange:
    """The maximum ``found`` with two effects ``names`` exchanged, and the ``probability`` that it is so."""

    names: tuple[str, str]
    found: NormalEquations
    probability: float

    @property
    def note(self) -> str:
        """What a user should know of it."""
        one, other = self.names
        return (
            f"'{one}' and '{other}' may be the other way round, with a probability of "
            f"{100 * self.probability:.2g} %: intervals include both"
        )

    def change(self, at: NormalEquations) -> np.ndarray:
        """Return by how much the unknowns differ there (m,), in scales."""
        moved = [self.found.point.value(u) - at.point.value(u) for u in at.unknowns]
        return np.array(moved) / at.scales

    def covariance(self, at: NormalEquations) -> np.ndarray:
        """Return what the other maximum adds to the covariance (m, m) about this one, in scales."""
        change = self.change(at)
        return self.probability * np.outer(change, change)


def with_likely_exchanges(
    found: NormalEquations, flights: Sequence[Flight], tell: Tell | None = None
) -> tuple[NormalEquations, list[Exchange]]:
    """Return the likeliest maximum, and those with effects exchanged that are about as likely.

    Of a pair, sizes of parameters are exchanged and signs left: what lies at opposite sides of a craft moves
    it with opposite signs. Asked are pairs that guesses as far off as first ones may be could have exchanged.
    """
    out: list[Exchange] = []
    for names in _pairs(found.unknowns):
        other = _other_way_round(found, flights, names, tell)
        if other is None:
            continue
        more = found.objective - other.objective
        if more > BETTER_GAIN:
            LOGGER.info("%s and %s are the other way round", *names)
            found, other, more = settled_maximum(other, [], list(flights), tell)[0], found, -more
        if expit(more) > UNDECIDED:
            out.append(Exchange(names, other, float(expit(more))))
    return found, out


def _pairs(unknowns: Sequence[Unknown]) -> list[tuple[str, str]]:
    """Return the pairs of effects with the same unknowns."""
    own: dict[str, set[str]] = {}
    for u in unknowns:
        if u.kind == "effect":
            name, _, rest = u.name.partition(".")
            own.setdefault(name, set()).add(rest)
    return [(a, b) for a, b in combinations(own, 2) if own[a] == own[b]]


def _other_way_round(
    found: NormalEquations, flights: Sequence[Flight], names: tuple[str, str], tell: Tell | None
) -> NormalEquations | None:
    """Return the maximum near an exchange, ``None`` where none is about as likely, or it is the same."""
    step = _exchanged(found.point, found.unknowns, names)
    one, other = (type(found.point.description.get_effect(n)) for n in names)
    if one is not other or not _near(found, step) or not _apart(found, step / found.scales):
        return None
    try:
        start = found.point.moved(found.unknowns, step)
        if not start.physical():
            return None
        if tell is not None:
            tell(f"with '{names[0]}' and '{names[1]}' exchanged")
        there, _ = maximise(start, found.unknowns, flights, tell=tell)
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("%s and %s exchanged: %s", *names, error)
        return None
    moved = np.array([there.point.value(u) - found.point.value(u) for u in found.unknowns])
    if not has_converged(there) or not _apart(found, moved / found.scales):
        return None
    return there


def _exchanged(point: Point, unknowns: Sequence[Unknown], names: tuple[str, str]) -> np.ndarray:
    """Return the step (m,), in the parameters' units, that exchanges sizes and leaves signs."""
    value = {u.name: point.value(u) for u in unknowns}
    out = np.zeros(len(unknowns))
    for i, u in enumerate(unknowns):
        own, _, rest = u.name.partition(".")
        if own in names and u.kind == "effect":
            other = abs(value[f"{names[1 - names.index(own)]}.{rest}"])
            out[i] = np.copysign(other, value[u.name]) - value[u.name]
    return out


def _near(found: NormalEquations, step: np.ndarray) -> bool:
    """Whether masses and springs stay within `GUESS_RATIO` on a step (m,), in the parameters' units."""
    positive = np.array([u.positive for u in found.unknowns])
    here = np.array([found.point.value(u) for u in found.unknowns])
    ratio = (here + step)[positive] / here[positive]
    return bool(np.all(np.maximum(ratio, 1.0 / ratio) < GUESS_RATIO))


def _apart(found: NormalEquations, change: np.ndarray) -> bool:
    """Whether a change (m,), in scales, is more than what is not told anyway."""
    return bool(change @ found.gram @ change > APART**2)
