"""Intervals along poorly known parameters of effects: by the profile of the likelihood, where that is bent.

Masses and springs of an effect enter the motion as products with hidden states. Where one of them is known
to a tenth of its size or worse, a standard deviation from the curvature at the maximum may say little, and
not of it alone: the total mass of a craft goes with the mass in its tank, and is as uncertain.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from smsid._statistics import NORMAL95
from smsid.errors import SmsidError
from smsid.estimation.flight import Flight
from smsid.estimation.maximum import maximise
from smsid.estimation.normal_equations import NormalEquations, objective_of
from smsid.estimation.parameter_vector import Point
from smsid.estimation.retraction import retract
from smsid.estimation.trust_region import bounded_step, predicted_gain

LOGGER = logging.getLogger(__name__)
POORLY = 0.1  # standard deviation over value from which an effect's parameter is put to the test
BENT = 0.1  # relative difference of the root of the likelihood's fall from a Gaussian's that counts
MOST = 0.5  # share of a variance that comes through a parameter
LOOKS = 8  # values at which the likelihood is looked at, to each side
BEYOND = 1.2  # times the root of the fall within which the last of them is
MORE = 1.0  # of the log-posterior by which a point is more likely than the maximum
STEPS = 6  # of the search for the others at one value
REST = 0.2  # predicted gain of the log-posterior below which the others are at rest
FINE = 401  # values along a profile at which an interval is sought


@dataclass(frozen=True)
class Profile:
    """The likelihood along one parameter, all others at their most likely.

    ``name`` and ``index`` are the parameter's; ``changes`` (k, m) are those of all unknowns from the maximum,
    in scales, by rising values of it, and ``falls`` (k,) those of the log-posterior. ``open``: to which sides
    (below, above) the likelihood does not fall off as far as it was followed.
    """

    name: str
    index: int
    changes: np.ndarray
    falls: np.ndarray
    open: tuple[bool, bool]

    def interval(self, row: np.ndarray, rest: float, fall: float) -> tuple[float, float]:
        """Return how far a quantity goes down and up within a ``fall`` of its profile likelihood.

        ``row`` (m,) is its derivative by the unknowns in scales, ``rest`` its variance with the parameter
        held. An open side has no end.
        """
        if len(self.falls) < 2:
            return -np.inf, np.inf
        signed = np.sign(self.changes[:, self.index]) * np.sqrt(np.maximum(self.falls, 0.0))
        along = self.changes @ row
        fine = np.linspace(max(signed[0], -np.sqrt(fall)), min(signed[-1], np.sqrt(fall)), FINE)
        centre = PchipInterpolator(signed, along)(fine)
        width = np.sqrt(2.0 * max(rest, 0.0) * np.maximum(fall - fine**2, 0.0))
        down, up = float(np.min(centre - width)), float(np.max(centre + width))
        grows = along[-1] > along[0]
        below, above = self.open if grows else self.open[::-1]
        return -np.inf if below else down, np.inf if above else up


@dataclass(frozen=True)
class BentInterval:
    """How far a quantity may go down and up from its value (95 %), if that is known; what it goes with."""

    goes_with: str
    ends: tuple[float, float] | None


class BetterMaximum(Exception):
    """A ``point`` that is more likely than what was taken for the maximum: a search goes on from there."""

    def __init__(self, point: Point) -> None:
        super().__init__("a more likely point was met")
        self.point = point


def bent_intervals(
    found: NormalEquations,
    flights: Sequence[Flight],
    gradient: np.ndarray,
    covariance: np.ndarray,
    widening: float,
) -> dict[int, BentInterval]:
    """Return profile intervals of rows (rows, m) of ``gradient`` whose Gaussian ones do not hold, by row.

    ``covariance`` (m, m) is that of the unknowns, both in units of their scales, ``widening`` the factor on
    standard deviations. Parameters of effects that are poorly known are followed until the likelihood has
    fallen by 1.92, all others re-estimated; quantities that have most of their variance through one of them
    take their interval from there. Where searches along the filter's states do not come to the maximum
    (`NormalEquations.exact`), parameters are not followed, and intervals have no ends.

    Raises `BetterMaximum` when a more likely point is met on the way.
    """
    fall = 0.5 * (NORMAL95 * widening) ** 2
    profiles = _profiles(found, flights, covariance, fall)
    out: dict[int, BentInterval] = {}
    if not profiles:
        return out
    variance = np.einsum("ij,jk,ik->i", gradient, covariance, gradient)
    for k, (row, v) in enumerate(zip(gradient, variance, strict=True)):
        shares = [float(row @ covariance[:, p.index]) ** 2 / covariance[p.index, p.index] for p in profiles]
        most = int(np.argmax(shares))
        if v > 0.0 and shares[most] > MOST * v:
            best = profiles[most]
            ends = None if found.exact else best.interval(row, v - shares[most], fall)
            out[k] = BentInterval(best.name, ends)
    return out


def poorly_known(found: NormalEquations, covariance: np.ndarray) -> list[int]:
    """Return the parameters of effects, zero at least, that are known to `POORLY` or worse; worst first.

    ``covariance`` (m, m) is that of the unknowns, in their scales.
    """
    share: Mapping[int, float] = {
        i: np.sqrt(covariance[i, i]) * u.scale / abs(found.point.value(u))
        for i, u in enumerate(found.unknowns)
        if u.kind == "effect" and 0.0 <= u.lower < u.nominal and found.point.value(u) > u.lower
    }
    return sorted((i for i, s in share.items() if s > POORLY), key=lambda i: -share[i])


def _profiles(
    found: NormalEquations, flights: Sequence[Flight], covariance: np.ndarray, fall: float
) -> list[Profile]:
    left, out = poorly_known(found, covariance), []
    while left:
        i = left.pop(0)
        if not _is_bent(found, flights, covariance, i, fall):
            continue
        out.append(_profile(found, flights, covariance, i, fall))
        size = np.sqrt(np.diag(covariance))
        # what goes with it is followed with it
        left = [j for j in left if (covariance[i, j] / (size[i] * size[j])) ** 2 < MOST]
    return out


def _is_bent(
    found: NormalEquations, flights: Sequence[Flight], covariance: np.ndarray, i: int, fall: float
) -> bool:
    """Whether the likelihood falls otherwise than a Gaussian at the ends of a parameter's interval."""
    column = covariance[:, i] / np.sqrt(covariance[i, i])
    for side in (1.0, -1.0):
        try:
            point = retract(found.point, found.unknowns, side * np.sqrt(2.0 * fall) * column * found.scales)
            if not point.physical():
                return True
            there = objective_of(point, found.unknowns, flights) - found.objective
        except (SmsidError, np.linalg.LinAlgError):
            return True
        if not (1.0 - BENT) ** 2 * fall < there < (1.0 + BENT) ** 2 * fall:
            return True
    return False


def _profile(
    found: NormalEquations, flights: Sequence[Flight], covariance: np.ndarray, i: int, fall: float
) -> Profile:
    """Return the profile along unknown ``i``, a little beyond a ``fall`` of the log-posterior."""
    m, name = len(found.unknowns), found.unknowns[i].name
    if found.exact:
        return Profile(name, i, np.zeros((1, m)), np.zeros(1), (True, True))
    known: list[tuple[np.ndarray, float]] = [(np.zeros(m), 0.0)]
    open_ = []
    for side in (-1.0, 1.0):
        points, closed = _side(found, flights, covariance, i, side, fall)
        known += points
        open_.append(not closed)
    known.sort(key=lambda x: x[0][i])
    changes, falls = np.array([c for c, _ in known]), np.array([f for _, f in known])
    # falls that grow no more on the way out are no profile: kept are those that do
    zero = int(np.flatnonzero((changes == 0.0).all(axis=1))[0])
    keep = [k for k in range(len(known)) if k == zero or falls[k] > _inner(falls, zero, k)]
    LOGGER.info("profile along %s: falls %s", name, np.round(falls, 2).tolist())
    return Profile(name, i, changes[keep], falls[keep], (open_[0], open_[1]))


def _inner(falls: np.ndarray, zero: int, k: int) -> float:
    """Return the largest fall between the maximum and the k-th value."""
    between = falls[k + 1 : zero + 1] if k < zero else falls[zero:k]
    return float(between.max())


def _side(
    found: NormalEquations,
    flights: Sequence[Flight],
    covariance: np.ndarray,
    i: int,
    side: float,
    fall: float,
) -> tuple[list[tuple[np.ndarray, float]], bool]:
    """Return changes (m,) and falls to one side, and whether the log-posterior falls by ``fall`` there."""
    unknown, root = found.unknowns[i], float(np.sqrt(fall))
    sigma = float(np.sqrt(covariance[i, i])) * unknown.scale
    here, value = found.point, found.point.value(unknown)
    known = [(value, 0.0)]
    out: list[tuple[np.ndarray, float]] = []
    wanted = value + side * np.sqrt(2.0) * root * sigma
    for _ in range(LOOKS):
        try:
            at, fell = _at_best(found, flights, covariance, i, here, wanted)
        except (SmsidError, np.linalg.LinAlgError) as error:
            LOGGER.info("%s = %.4g: %s", unknown.name, wanted, error)
            wanted = 0.5 * (wanted + known[-1][0])
            continue
        here, value = at, at.value(unknown)
        if fell < -MORE:
            raise BetterMaximum(at)
        known.append((value, float(np.sqrt(max(fell, 0.0)))))
        out.append((_change(found, at), fell))
        if root <= known[-1][1] < BEYOND * root or value == known[-2][0]:
            break  # far enough, or at its bound
        aim = 0.5 * (1.0 + BEYOND) * root
        (x0, y0), (x1, y1) = sorted(known, key=lambda p: abs(p[1] - aim))[:2]
        slope = side * (y1 - y0) / (x1 - x0) if x1 != x0 else 0.0
        most = 2.0 * abs(x0 - known[0][0]) + sigma
        wanted = x0 + side * (min((aim - y0) / slope, most) if slope > 0.0 else most)
    return out, max(y for _, y in known) >= root


def _at_best(
    found: NormalEquations,
    flights: Sequence[Flight],
    covariance: np.ndarray,
    i: int,
    near: Point,
    value: float,
) -> tuple[Point, float]:
    """Return the most likely point with unknown ``i`` near a value, and by how much less likely it is.

    Raises `SmsidError` where no such spacecraft can be, or the others do not come to rest.
    """
    unknowns = found.unknowns
    step = (value - near.value(unknowns[i])) / unknowns[i].scale
    start = retract(near, unknowns, step * covariance[:, i] / covariance[i, i] * found.scales)
    if not start.physical():
        raise SmsidError("No such spacecraft can be.", advice="Take a shorter step.")
    others = [u for k, u in enumerate(unknowns) if k != i]
    best, _ = maximise(start, others, flights, enough=REST, iterations=STEPS)
    if predicted_gain(best, bounded_step(best)) > 5.0 * REST:
        raise SmsidError("The other parameters do not come to rest.", advice="Take a shorter step.")
    own = 0.5 * ((best.point.value(unknowns[i]) - unknowns[i].nominal) / unknowns[i].sigma) ** 2
    return best.point, best.objective + own - found.objective


def _change(found: NormalEquations, point: Point) -> np.ndarray:
    return np.array([(point.value(u) - found.point.value(u)) / u.scale for u in found.unknowns])
