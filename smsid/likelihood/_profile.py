"""Profile-likelihood intervals, for parameters whose Gaussian interval reaches where they cannot be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import chdtri

from smsid._statistics import NORMAL95
from smsid.errors import NotIdentifiableError, SimulationError
from smsid.likelihood.fit import Fit, minimise
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.point import Evaluation, SearchPoint, step_point
from smsid.likelihood.prior import Prior

if TYPE_CHECKING:
    from smsid.likelihood.refine import Refinement

TIGHT = 0.01  # of the threshold to which the ends are found
LOOKS = 12
LEAST = 1e-3  # of its value, as near to zero as a parameter known by its logarithm is taken
BENT = 0.1  # relative difference of an interval's half from the Gaussian one


@dataclass(frozen=True)
class ProfileInterval:
    """The values of a parameter that the data do not speak against at ``level``.

    ``at_bound``: the likelihood does not exclude the smallest value there can be, so that end is the bound.
    """

    name: str
    lower: float
    upper: float
    level: float
    at_bound: bool


def profile_interval(
    refinement: Refinement, name: str, *, level: float = 0.95, bound: float = 0.0
) -> ProfileInterval:
    """Return the interval in which twice the log likelihood, all else re-estimated, falls by less than chi2.

    ``name`` of a parameter of slosh or appendages (``tank.damping.x``). Where the data do not exclude
    ``bound``, the smallest value there can be, the interval ends there. Noise levels stay those of the
    refinement. Source: Wilks (1938); Murphy and van der Vaart (2000), *On profile likelihood*.

    Raises `NotIdentifiableError` for a parameter it cannot hold, or when the likelihood does not fall.
    """
    return profile_of(refinement.fit, refinement.prior, name, level=level, bound=bound)


def profile_of(
    fit: Fit, prior: Prior, name: str, *, level: float = 0.95, bound: float = 0.0
) -> ProfileInterval:
    """Return the interval of a fit; arguments and `NotIdentifiableError` as in `profile_interval`."""
    scalars = {s.name: s for s in fit.point.parameters.scalars}
    if name not in scalars:
        raise NotIdentifiableError(
            f"'{name}' has no profile.", advice=f"Profiles: {', '.join(sorted(scalars))}.", name=name
        )
    index = fit.point.parameters.index(name)
    # at the maximum itself: the search stops within a hundredth of sigma of it
    best = minimise(fit.pieces, fit.point, prior, None)
    sigma = float(np.sqrt(np.linalg.inv(best.normal.information)[index, index])) * scalars[name].slope
    centre = best.point.parameters.scalar(name)
    rise = float(chdtri(1, 1.0 - level))

    def excess(value: float, near: SearchPoint) -> tuple[float, SearchPoint]:
        held = _at(near, name, value)
        found = minimise(fit.pieces, held, prior, np.array([index]))
        return found.cost - best.cost - rise, found.point

    upper = _end(excess, best.point, centre, sigma, rise, np.inf)
    if centre > bound:
        # a logarithm cannot reach zero
        nearest = max(bound, LEAST * centre) if scalars[name].log else bound
        below, _ = excess(nearest, best.point) if centre - 4 * sigma < bound else (1.0, best.point)
        lower = bound if below < 0.0 else _end(excess, best.point, centre, -sigma, rise, nearest)
    else:
        lower = bound
    return ProfileInterval(name, float(lower), float(upper), level, bool(lower == bound))


def not_gaussian(fit: Fit, prior: Prior, name: str, covariance: np.ndarray) -> bool:
    """Return whether the likelihood falls otherwise than a Gaussian at the ends of a parameter's interval.

    At 1.96 sigma to both sides, all else moved along as the covariance (n, n) of the step has it, the sum of
    squares rises by 3.84 if the likelihood is Gaussian; a tenth more or less in sigma counts as not. So does
    an interval that reaches below zero, where none of these parameters can be.
    """
    at = fit.point.parameters
    index = at.index(name)
    sigma = float(np.sqrt(covariance[index, index]))
    scalar = next(s for s in at.scalars if s.name == name)
    if scalar.value - NORMAL95 * sigma * scalar.slope < 0.0:
        return True
    rise = float(chdtri(1, 0.05))
    here = fit.seen.cost(fit.pieces, prior)
    for side in (1.0, -1.0):
        step = side * np.sqrt(rise) * covariance[index] / sigma
        try:
            motions = fit.normal.motion_steps(step, newton=False)
            point = step_point(fit.pieces, fit.point, step, motions)
            there = Evaluation.at(fit.pieces, point).cost(fit.pieces, prior)
        except SimulationError:
            return True
        if not (1.0 - BENT) ** 2 * rise < there - here < (1.0 + BENT) ** 2 * rise:
            return True
    return False


def _end(excess, near: SearchPoint, centre: float, sigma: float, rise: float, bound: float) -> float:
    """Where the excess crosses zero on one side, by the secant method on its square root."""
    known = [(centre, 0.0)]
    value = centre + sigma * np.sqrt(rise)
    for _ in range(LOOKS):
        if np.isfinite(bound):
            value = max(value, bound)
        over, near = excess(value, near)
        known.append((value, float(np.sqrt(max(over + rise, 0.0)))))
        if abs(over) < TIGHT * rise:
            return value
        (x0, y0), (x1, y1) = sorted(known, key=lambda p: abs(p[1] - np.sqrt(rise)))[:2]
        if y0 == y1:
            break
        value = x0 + (np.sqrt(rise) - y0) * (x1 - x0) / (y1 - y0)
    raise NotIdentifiableError(
        "The likelihood does not fall off: the interval has no end.",
        advice="Fly a longer or richer experiment.",
        looked_at=known,
    )


def _at(point: SearchPoint, name: str, value: float) -> SearchPoint:
    parameters: Parameters = point.parameters.with_scalars({name: value})
    return SearchPoint(parameters, point.locals)
