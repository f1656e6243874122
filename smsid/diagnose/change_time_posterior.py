"""How well it is known when an effect began, and what that adds to the uncertainty of everything fitted."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import cast

import numpy as np

from smsid.diagnose.change_point import step_from
from smsid.diagnose.change_point_scores import Starts
from smsid.diagnose.model_comparison import Cause
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.effects.base import Starting
from smsid.estimation.map_estimate import Fit

FAR = THRESHOLDS.beginning_apart
COARSE = 16  # times over the whole recording, as there may be other maxima
APART = 32  # times between the earliest and the latest possible
BETWEEN = 40  # times between two of these, where changes are interpolated


@dataclass(frozen=True)
class Began:
    """Standard deviation of an effect's start [s], no less than that of a time within a sample, and the
    covariance (m, m) of a fit's parameters, in their units, that comes from not knowing it.
    """

    sigma: float
    covariance: np.ndarray


def onset_posteriors(
    found: Fit, causes: Sequence[Cause], described: Collection[str] = ()
) -> dict[str, Began]:
    """Return how well the start of every effect is known that a search found to begin midway, by its name.

    Those ``described`` begin when they are said to. Each is looked at with the starts of the others as they
    are.
    """
    names = dict.fromkeys(c.score.candidate.effect.name for c in causes if c.score.candidate.effect)
    own = [found.point.description.get_effect(name) for name in names if name not in described]
    late = [cast(Starting, e) for e in own if getattr(e, "start", None) is not None]
    return {e.name: start_of(found, e) for e in late}


def start_of(found: Fit, mine: Starting) -> Began:
    """Return how well the start of an effect in a fit is known, by the likelihood of all it may have been.

    It is taken as it is: a torque that changes sign or rests leaves it several maxima, and no curvature.
    Moments are about the start of the fit, and the covariance is that of what all parameters would be, had it
    begun then.
    """
    starts, times = Starts(found, mine), found.run.states.time
    first, last, start = float(times[0]), float(times[-1]), starts.start
    sample = float(np.median(np.diff(times)))

    def steps(some: np.ndarray) -> list[float]:
        return sorted({start, *(step_from(found, float(t)) for t in some if first <= t <= last)})

    off = sample * 2.0 ** np.arange(np.ceil(np.log2((last - first) / sample)))
    tried = steps(np.concatenate([start - off, start + off, np.linspace(first, last, COARSE)]))
    ratios = starts.ratios(tried)
    possible = np.flatnonzero(ratios > ratios.max() - FAR)
    earliest, latest = tried[max(possible[0] - 1, 0)], tried[min(possible[-1] + 1, len(tried) - 1)]
    # whole samples apart: many effects act from one on
    stride = sample * max(1.0, np.round((latest - earliest) / (APART * sample)))
    finer = [np.arange(start, earliest, -stride), np.arange(start, latest, stride)]
    near = [t for t in tried if earliest <= t <= latest]
    likely = _over(starts, steps(np.concatenate([*finer, near])), found.scales)
    return replace(likely, sigma=float(np.hypot(likely.sigma, sample / np.sqrt(12.0))))


def _over(starts: Starts, knots: Sequence[float], scales: np.ndarray) -> Began:
    """Return the moments over all times, what it does interpolated between those given."""
    gram, along, taken = starts.explained(knots)
    fine = np.unique(np.concatenate([np.linspace(*ends, BETWEEN) for ends in pairwise(knots)]))
    weight = np.array([np.interp(fine, knots, one) for one in np.eye(len(knots))])
    own = np.einsum("it,ij,jt->t", weight, gram, weight)
    explained = along @ weight
    amount = explained / np.where(own > 0.0, own, np.inf)
    ratio = explained * amount
    # by the trapezoidal rule: each time stands for half of what is beside it
    chance = np.exp(0.5 * (ratio - ratio.max())) * np.gradient(fine)
    chance /= chance.sum()
    here = int(np.searchsorted(fine, starts.start))  # a fit is where it is best but for rounding
    moved = np.outer(starts.size, amount - amount[here])
    others = -(taken @ weight) * amount
    moved[starts.beside] = others - others[:, [here]]
    moved *= scales[:, None]
    return Began(float(np.sqrt(chance @ (fine - starts.start) ** 2)), (moved * chance) @ moved.T)
