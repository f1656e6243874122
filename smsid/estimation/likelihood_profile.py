"""Intervals along what is poorly known: by the profile of the likelihood, where that is bent.

Masses and springs of an effect enter the motion as products with hidden states, inertias as divisors. Where
one of them is known to a tenth of its size or worse, a standard deviation from the curvature at the maximum
may say little, and not of it alone: the total mass of a craft goes with the mass in its tank, and is as
uncertain.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy.interpolate import PchipInterpolator

from smsid._statistics import NORMAL95
from smsid.errors import SmsidError
from smsid.estimation._maximum import maximise
from smsid.estimation._normal_equations import NormalEquations, normal_equations, objective_of
from smsid.estimation._retraction import retract
from smsid.estimation._trust_region import Quadratic, bounded_step, predicted_gain
from smsid.estimation.flight import Flight
from smsid.estimation.parameter_vector import Point, Unknown

LOGGER = logging.getLogger(__name__)
POORLY_KNOWN = 0.1  # standard deviation over value from which a parameter is put to the test
MOST_ASKED = 4  # of those that are no parameter of an effect, worst first
BENT = 0.1  # relative difference of the root of the likelihood's fall from a Gaussian's that counts
MAIN_SHARE = 0.5  # share of a variance that comes through a parameter
LOOKS_PER_SIDE = 8  # values at which the likelihood is looked at, to each side
FURTHEST_LOOK = 1.2  # times the root of the fall within which the last of them is
BETTER_GAIN = 1.0  # of the log-posterior by which a point is more likely than the maximum
INNER_STEPS = 6  # of the search for the others at one value
REST_GAIN = 0.2  # predicted gain of the log-posterior below which the others are at rest
GRID_VALUES = 401  # values along a profile at which an interval is sought


@dataclass(frozen=True)
class Profile:
    """The likelihood along one parameter, all others at their most likely.

    ``name`` and ``index`` are the parameter's; ``changes`` (k, m) are those of all unknowns from the maximum,
    in scales, by rising values of it, and ``falls`` (k,) those of the log-posterior. ``open``: to which sides
    (below, above) the likelihood does not fall off as far as it was followed, and there is no bound.
    """

    name: str
    index: int
    changes: np.ndarray
    falls: np.ndarray
    open: tuple[bool, bool]

    @property
    def followed(self) -> bool:
        """Whether the likelihood is known anywhere but at the maximum."""
        return len(self.falls) > 1

    def interval(self, row: np.ndarray, rest: float, fall: float) -> tuple[float, float]:
        """Return how far a quantity goes down and up within a ``fall`` of its profile likelihood.

        ``row`` (m,) is its derivative by the unknowns in scales, ``rest`` its variance with the parameter
        held. An open side has no end, and none has where nothing was followed.
        """
        if not self.followed:
            return -np.inf, np.inf
        signed = np.sign(self.changes[:, self.index]) * np.sqrt(np.maximum(self.falls, 0.0))
        along = self.changes @ row
        fine = np.linspace(max(signed[0], -np.sqrt(fall)), min(signed[-1], np.sqrt(fall)), GRID_VALUES)
        centre = PchipInterpolator(signed, along)(fine)
        width = np.sqrt(2.0 * max(rest, 0.0) * np.maximum(fall - fine**2, 0.0))
        down, up = float(np.min(centre - width)), float(np.max(centre + width))
        grows = along[-1] > along[0]
        below, above = self.open if grows else self.open[::-1]
        return -np.inf if below else down, np.inf if above else up


@dataclass(frozen=True)
class BentInterval:
    """How far a quantity may go down and up from its value (95 %); what it goes with.

    ``followed``: whether the likelihood along that was; where it could not be, nothing is known of the ends.
    """

    goes_with: str
    ends: tuple[float, float]
    followed: bool = True


class Posterior(Protocol):
    """A log-posterior whose maximum is known, as `bent_intervals` asks for it."""

    def objective(self, point: Point) -> float:
        """Return minus the log-posterior of all parameters at a point."""
        ...

    def at_best(self, start: Point, others: Sequence[Unknown]) -> tuple[Point, float]:
        """Return the most likely point near a start with ``others`` free, and the objective of these there.

        Raises `SmsidError` where they do not come to rest.
        """
        ...


@dataclass(frozen=True)
class PosteriorOfFlights:
    """That of several recordings."""

    found: NormalEquations
    flights: Sequence[Flight]

    def objective(self, point: Point) -> float:
        """Return minus the log-posterior of all parameters at a point."""
        return objective_of(point, self.found.unknowns, self.flights)

    def at_best(self, start: Point, others: Sequence[Unknown]) -> tuple[Point, float]:
        """Return the most likely point near a start with ``others`` free, and their objective.

        Raises `SmsidError` where they do not come to rest, or slopes along the filter's states mislead.
        """
        index = [i for i, u in enumerate(self.found.unknowns) if u.name in {x.name for x in others}]
        off = self.misleading[index]
        if 0.5 * float(off @ np.linalg.solve(self.found.gram[np.ix_(index, index)], off)) > REST_GAIN:
            raise SmsidError("Slopes of the others mislead a search.", advice="Give priors, or fly longer.")
        best, _ = maximise(start, others, self.flights, enough=REST_GAIN, iterations=INNER_STEPS)
        at_rest(best)
        return best.point, best.objective

    @cached_property
    def misleading(self) -> np.ndarray:
        """What slopes along the filter's states have too little of at the maximum (m,)."""
        if not self.found.exact:
            return np.zeros(len(self.found.unknowns))
        along = normal_equations(self.found.point, self.found.unknowns, self.flights)
        return self.found.slope - along.slope


def at_rest(found: Quadratic) -> None:
    """Raise `SmsidError` where a step is left that would gain something."""
    if predicted_gain(found, bounded_step(found)) > 5.0 * REST_GAIN:
        raise SmsidError("The other parameters do not come to rest.", advice="Take a shorter step.")


class BetterMaximum(Exception):
    """A ``point`` that is more likely than what was taken for the maximum: a search goes on from there."""

    def __init__(self, point: Point) -> None:
        super().__init__("a more likely point was met")
        self.point = point


def bent_intervals(
    found: Quadratic,
    posterior: Posterior,
    doubtful: Sequence[int],
    gradient: np.ndarray,
    covariance: np.ndarray,
    *,
    widening: float = 1.0,
    more: float = BETTER_GAIN,
) -> dict[int, BentInterval]:
    """Return profile intervals of rows (rows, m) of ``gradient`` whose Gaussian ones do not hold, by row.

    ``covariance`` (m, m) is that of the unknowns, both in units of their scales, ``widening`` the factor on
    standard deviations. Parameters that are ``doubtful`` (`poorly_known`, `loosely_told`) are followed until
    the likelihood has fallen by 1.92, all others re-estimated; quantities that have most of their variance
    through one of them take their interval from there.

    Raises `BetterMaximum` when a point is met on the way that is more likely by ``more``.
    """
    fall = 0.5 * (NORMAL95 * widening) ** 2
    profiles = _Follower(found, posterior, covariance, fall, more).profiles(doubtful)
    out: dict[int, BentInterval] = {}
    if not profiles:
        return out
    variance = np.einsum("ij,jk,ik->i", gradient, covariance, gradient)
    for k, (row, v) in enumerate(zip(gradient, variance, strict=True)):
        shares = [float(row @ covariance[:, p.index]) ** 2 / covariance[p.index, p.index] for p in profiles]
        most = int(np.argmax(shares))
        if v > 0.0 and shares[most] > MAIN_SHARE * v:
            best = profiles[most]
            out[k] = BentInterval(best.name, best.interval(row, v - shares[most], fall), best.followed)
    return out


def poorly_known(
    found: Quadratic, covariance: np.ndarray, among: Sequence[int] | None = None, poorly: float = POORLY_KNOWN
) -> list[int]:
    """Return the parameters of effects, zero at least, that are known ``poorly`` or worse; worst first.

    ``covariance`` (m, m) is that of the unknowns, in their scales; asked are all of them, or some ``among``.
    """
    share: dict[int, float] = {}
    for i in range(len(found.unknowns)) if among is None else among:
        unknown = found.unknowns[i]
        value = found.point.value(unknown)
        if unknown.kind == "effect" and 0.0 <= unknown.lower < value:
            share[i] = float(np.sqrt(covariance[i, i])) * unknown.scale / value
    return sorted((i for i, s in share.items() if s > poorly), key=lambda i: -share[i])


def loosely_told(covariance: np.ndarray, gradient: np.ndarray, relative: np.ndarray) -> list[int]:
    """Return the parameters through which quantities vary known to `POORLY_KNOWN` or worse, worst first.

    ``covariance`` (m, m) is that of the unknowns in scales, ``gradient`` (k, m) the quantities' derivatives
    by these, ``relative`` (k,) their standard deviations over their sizes.
    """
    along = gradient @ covariance
    shares = (
        along**2 / np.diag(covariance) / np.maximum(np.einsum("ki,ki->k", along, gradient), 1e-300)[:, None]
    )
    out: list[int] = []
    for k in np.argsort(-relative):
        # what goes with one that is asked about already is told by that
        if (
            relative[k] > POORLY_KNOWN
            and shares[k].max() > MAIN_SHARE
            and not (shares[k, out] > MAIN_SHARE).any()
        ):
            out.append(int(np.argmax(shares[k])))
    return out[:MOST_ASKED]


@dataclass(frozen=True)
class _Follower:
    found: Quadratic
    posterior: Posterior
    covariance: np.ndarray
    fall: float
    more: float

    def profiles(self, doubtful: Sequence[int]) -> list[Profile]:
        left, out = list(doubtful), []
        while left:
            i = left.pop(0)
            if not self.is_bent(i):
                continue
            out.append(self.profile(i))
            size = np.sqrt(np.diag(self.covariance))
            # what goes with it is followed with it
            left = [j for j in left if (self.covariance[i, j] / (size[i] * size[j])) ** 2 < MAIN_SHARE]
        return out

    def is_bent(self, i: int) -> bool:
        """Whether the likelihood falls otherwise than a Gaussian at the ends of a parameter's interval.

        Of what is no parameter of an effect, whether it falls less: the line there may leave a ridge that
        bends, and a fall that is larger says nothing of the best beside it.
        """
        found, fall, effect = self.found, self.fall, self.found.unknowns[i].kind == "effect"
        column = self.covariance[:, i] / np.sqrt(self.covariance[i, i])
        for side in (1.0, -1.0):
            try:
                step = side * np.sqrt(2.0 * fall) * column * found.scales
                point = retract(found.point, found.unknowns, step)
                there = self.posterior.objective(point) - found.objective if point.physical() else np.inf
            except (SmsidError, np.linalg.LinAlgError):
                there = np.inf
            if there < (1.0 - BENT) ** 2 * fall or (effect and there > (1.0 + BENT) ** 2 * fall):
                return True
        return False

    def profile(self, i: int) -> Profile:
        """Return the profile along unknown ``i``, a little beyond the ``fall`` of the log-posterior."""
        m, name = len(self.found.unknowns), self.found.unknowns[i].name
        known: list[tuple[np.ndarray, float]] = [(np.zeros(m), 0.0)]
        open_ = []
        for side in (-1.0, 1.0):
            points, closed = self.side(i, side)
            known += points
            open_.append(not closed)
        known.sort(key=lambda x: x[0][i])
        changes, falls = np.array([c for c, _ in known]), np.array([f for _, f in known])
        # falls that grow no more on the way out are no profile: kept are those that do, but at a bound that
        # the maximum is at
        zero, moved = int(np.flatnonzero((changes == 0.0).all(axis=1))[0]), changes[:, i] != 0.0
        keep = [k for k in range(len(known)) if k == zero or (moved[k] and falls[k] > _inner(falls, zero, k))]
        LOGGER.info("profile along %s: falls %s", name, np.round(falls, 2).tolist())
        return Profile(name, i, changes[keep], falls[keep], (open_[0], open_[1]))

    def side(self, i: int, side: float) -> tuple[list[tuple[np.ndarray, float]], bool]:
        """Return changes (m,) and falls to one side, and whether it ends there: the log-posterior falls by
        `fall`, or the parameter is at its bound.
        """
        found, unknown, root = self.found, self.found.unknowns[i], float(np.sqrt(self.fall))
        sigma = float(np.sqrt(self.covariance[i, i])) * unknown.scale
        here, value = found.point, found.point.value(unknown)
        known = [(value, 0.0)]
        out: list[tuple[np.ndarray, float]] = []
        wanted = value + side * np.sqrt(2.0) * root * sigma
        for _ in range(LOOKS_PER_SIDE):
            try:
                at, fell = self.at_best(i, here, wanted)
            except (SmsidError, np.linalg.LinAlgError) as error:
                LOGGER.info("%s = %.4g: %s", unknown.name, wanted, error)
                wanted = 0.5 * (wanted + known[-1][0])
                continue
            here, value = at, at.value(unknown)
            if fell < -self.more:
                raise BetterMaximum(at)
            known.append((value, float(np.sqrt(max(fell, 0.0)))))
            out.append((_change(found, at), fell))
            if root <= known[-1][1] < FURTHEST_LOOK * root or value == known[-2][0]:
                break  # far enough, or at its bound
            aim = 0.5 * (1.0 + FURTHEST_LOOK) * root
            beyond = [p for p in known if p[1] >= FURTHEST_LOOK * root]
            if beyond:  # what is sought is between
                (x0, y0), (x1, y1) = max((p for p in known if p[1] < root), key=lambda p: p[1]), min(beyond)
                if side < 0.0:
                    x1, y1 = max(beyond)
                wanted = x0 + (x1 - x0) * float(np.clip((aim - y0) / (y1 - y0), 0.5, 0.9))
                continue
            (x0, y0), (x1, y1) = sorted(known, key=lambda p: abs(p[1] - aim))[:2]
            slope = side * (y1 - y0) / (x1 - x0) if x1 != x0 else 0.0
            most = 2.0 * abs(x0 - known[0][0]) + sigma
            wanted = x0 + side * (min((aim - y0) / slope, most) if slope > 0.0 else most)
        bound = unknown.lower if side < 0.0 else unknown.upper
        return out, value == bound or max(y for _, y in known) >= root

    def at_best(self, i: int, near: Point, value: float) -> tuple[Point, float]:
        """Return the most likely point with unknown ``i`` near a value, and by how much less likely it is.

        Raises `SmsidError` where no such spacecraft can be, or the others do not come to rest.
        """
        unknowns = self.found.unknowns
        step = (value - near.value(unknowns[i])) / unknowns[i].scale
        column = self.covariance[:, i] / self.covariance[i, i]
        start = retract(near, unknowns, step * column * self.found.scales)
        if not start.physical():
            raise SmsidError("No such spacecraft can be.", advice="Take a shorter step.")
        others = [u for k, u in enumerate(unknowns) if k != i]
        point, objective = self.posterior.at_best(start, others)
        own = 0.5 * ((point.value(unknowns[i]) - unknowns[i].nominal) / unknowns[i].sigma) ** 2
        return point, objective + own - self.found.objective


def _inner(falls: np.ndarray, zero: int, k: int) -> float:
    """Return the largest fall between the maximum and the k-th value."""
    between = falls[k + 1 : zero + 1] if k < zero else falls[zero:k]
    return float(between.max())


def _change(found: Quadratic, point: Point) -> np.ndarray:
    return np.array([(point.value(u) - found.point.value(u)) / u.scale for u in found.unknowns])
