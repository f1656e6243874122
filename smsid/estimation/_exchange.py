"""Effects of one kind that may have been taken for each other: the other maxima, and how likely they are.

Two panels that ring at nearly the same frequency have two maxima, the one with what rings exchanged. Which of
them a search comes to is its first guess's doing, and a standard deviation there knows nothing of the other.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from smsid._statistics import NORMAL95
from smsid.errors import SmsidError
from smsid.estimation._maximum import has_converged, maximise
from smsid.estimation._normal_equations import NormalEquations
from smsid.estimation.flight import Flight
from smsid.estimation.flight_search import settled_maximum
from smsid.estimation.likelihood_profile import BETTER_GAIN
from smsid.estimation.parameter_vector import Point, Unknown

LOGGER = logging.getLogger(__name__)
APART = NORMAL95  # standard deviations by which an exchange has to move what it exchanges
UNDECIDED = 0.025  # probability of the other maximum from which 95 % do without it no more
GUESS_RATIO = 1.7  # of two masses or springs, within which first guesses may have them the wrong way round
WORTH_SETTLING = 20.0  # of the log-posterior, within which another maximum is compared where it is at rest
MOST_BETTER = 3  # times that an exchange is likelier than all before, and others are asked for anew

Tell = Callable[[str], None]
Pair = tuple[str, str]


@dataclass(frozen=True)
class Exchange:
    """The maximum ``found`` with two effects ``names`` exchanged, and the ``probability`` that it is so."""

    names: Pair
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

    def covariance(self, at: NormalEquations) -> np.ndarray:
        """Return what this maximum adds to the covariance (m, m) about another one, in scales."""
        change = _moved(at, self.found.point) / at.scales
        return self.probability * np.outer(change, change)


def with_exchanges(
    found: NormalEquations, flights: Sequence[Flight], tell: Tell | None = None
) -> tuple[NormalEquations, list[tuple[Pair, NormalEquations]]]:
    """Return the likeliest maximum, and those with two effects exchanged, by these.

    Of a pair, sizes of parameters are exchanged and signs left: what lies at opposite sides of a craft moves
    it with opposite signs. Asked are pairs that ring on the same body, and that guesses as far off as first
    ones may be could have exchanged.
    """
    for _ in range(MOST_BETTER):
        others: list[tuple[Pair, NormalEquations]] = []
        for names in _pairs(found):
            other = _other_way_round(found, flights, names, tell)
            if other is not None and all(_apart(x, other.point) for _, x in others):
                others.append((names, other))
        best = min(others, key=lambda x: x[1].objective, default=None)
        if best is None or found.objective - best[1].objective < BETTER_GAIN:
            break
        LOGGER.info("%s and %s are the other way round", *best[0])
        found = best[1]
    return found, distinct(found, others)


def distinct(
    found: NormalEquations, others: Sequence[tuple[Pair, NormalEquations]]
) -> list[tuple[Pair, NormalEquations]]:
    """Return those of other maxima that are not the one found, which a search may have moved to meanwhile."""
    return [(names, x) for names, x in others if _apart(found, x.point)]


def likely_exchanges(
    found: NormalEquations, others: Sequence[tuple[Pair, NormalEquations]], widening: float
) -> list[Exchange]:
    """Return those of other maxima that are about as likely as the one found, each with its probability.

    ``widening`` is the factor on standard deviations by which errors are larger than their stated noise.
    """
    less = np.array([0.0, *(x.objective - found.objective for _, x in others)]) / widening**2
    share = np.exp(-(less - less.min()))
    share /= share.sum()
    pairs = zip(others, share[1:], strict=True)
    return [Exchange(names, x, float(p)) for (names, x), p in pairs if p > UNDECIDED]


def _pairs(found: NormalEquations) -> list[Pair]:
    """Return the pairs of effects of one class with the same unknowns that ring on the same body."""
    own: dict[str, set[str]] = {}
    for u in found.unknowns:
        if u.kind == "effect":
            name, _, rest = u.name.partition(".")
            own.setdefault(name, set()).add(rest)
    carriers = _carriers(found.point)
    kinds = {e.name: type(e) for e in found.point.description.effect}

    def alike(a: str, b: str) -> bool:
        rings = a in carriers and carriers[a] == carriers.get(b)
        return rings and own[a] == own[b] and kinds[a] is kinds[b]

    return [(a, b) for a, b in combinations(own, 2) if alike(a, b)]


def _carriers(point: Point) -> dict[str, int]:
    """Return the joint that carries each tank and each panel, by name."""
    model = point.base
    tanks = {s.name: int(model.pin.parents[s.joint]) for s in model.slosh}
    return tanks | {a.appendage.name: a.parent for a in model.appendages if a.joints}


def _other_way_round(
    found: NormalEquations, flights: Sequence[Flight], names: Pair, tell: Tell | None
) -> NormalEquations | None:
    """Return the maximum near an exchange, ``None`` where there is none at rest, or it is the same."""
    step = _exchanged(found.point, found.unknowns, names)
    if not _near(found, step):
        return None
    try:
        start = found.point.moved(found.unknowns, step)
        if not _apart(found, start) or not start.physical():
            return None
        if tell is not None:
            tell(f"with '{names[0]}' and '{names[1]}' exchanged")
        there, _ = maximise(start, found.unknowns, flights, tell=tell)
        if there.objective - found.objective < WORTH_SETTLING:
            there, _ = settled_maximum(there, [], list(flights), tell)
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("%s and %s exchanged: %s", *names, error)
        return None
    return there if has_converged(there) and _apart(found, there.point) else None


def _exchanged(point: Point, unknowns: Sequence[Unknown], names: Pair) -> np.ndarray:
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


def _apart(found: NormalEquations, point: Point) -> bool:
    """Whether a point is further away than what is not told anyway."""
    change = _moved(found, point) / found.scales
    return bool(change @ found.gram @ change > APART**2)


def _moved(found: NormalEquations, point: Point) -> np.ndarray:
    return np.array([point.value(u) - found.point.value(u) for u in found.unknowns])
