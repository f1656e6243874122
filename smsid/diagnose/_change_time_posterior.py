"""How well it is known when an effect began, and what that adds to the uncertainty of everything fitted."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import cast

import numpy as np
from scipy.linalg import solve_triangular

from smsid.diagnose.model_comparison import Cause
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.effects.base import Effect, Starting
from smsid.estimation.filter_run import FilterRun
from smsid.estimation.map_estimate import MapFit
from smsid.estimation.sensitivities import Sensitivity, propagate

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
    found: MapFit, causes: Sequence[Cause], described: Collection[str] = ()
) -> dict[str, Began]:
    """Return how well the start of every effect is known that a search found to begin midway, by its name.

    Those ``described`` begin when they are said to. Each is looked at with the starts of the others as they
    are.
    """
    names = dict.fromkeys(c.score.candidate.effect.name for c in causes if c.score.candidate.effect)
    own = [found.point.description.get_effect(name) for name in names if name not in described]
    late = [cast(Starting, e) for e in own if getattr(e, "start", None) is not None]
    return {e.name: start_of(found, e) for e in late}


def start_of(found: MapFit, mine: Starting) -> Began:
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
    possible = np.flatnonzero(ratios > ratios.max() - THRESHOLDS.beginning_apart)
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


def cut_sensitivity(change: Sensitivity, run: FilterRun, begin: float, end: float = np.inf) -> Sensitivity:
    """Return a change as it is from one time on and before another, and nothing else."""
    between, at = (run.middle.time[:, None], run.states.time[:, None])
    return change.weighted(*((t >= begin) & (t < end) for t in (between, at)))


class Starts:
    """An effect taken out of a fit and put back from other times on, as large as it then explains most.

    What it does from another time on is of first order; that its size goes with the time is not. ``size``
    (m,) are its strengths among the fit's parameters, in units of their scales, which stay in proportion;
    ``beside`` (m,) marks the parameters that make up for the rest.
    """

    def __init__(self, current: MapFit, mine: Starting) -> None:
        assert mine.start is not None
        self.start = mine.start
        own = [
            u.name.startswith(f"{mine.name}.") and u.name.split(".")[1] in mine.strength
            for u in current.unknowns
        ]
        self.beside = ~np.array(own)
        self.size = np.array([current.point.value(u) / u.scale for u in current.unknowns]) * ~self.beside
        whole = np.vstack([current.whitened.reshape(-1, len(self.size)), current.prior.rows])
        self._q, self._r = np.linalg.qr(whole[:, self.beside])
        now = whole @ self.size
        self._there = current.residual + now
        self._mine, self._current, self._columns = mine, current, {mine.start: now}

    def columns(self, times: Sequence[float]) -> np.ndarray:
        """Return what it does, as large as it is in the fit, from these times on: (N rows + priors, k)."""
        new = [t for t in dict.fromkeys(times) if t not in self._columns]
        if new:
            changed = propagate(self._current.run, self._changes(new)).reshape(-1, len(new))
            for t, one in zip(new, changed.T, strict=True):
                self._columns[t] = self._columns[self.start].copy()
                self._columns[t][: len(one)] += one
        return np.column_stack([self._columns[t] for t in times])

    def _changes(self, times: Sequence[float]) -> list[Sensitivity]:
        """Return what beginning at other times changes.

        Forces and readings of an effect that does not grow are the same whenever it began, and are cut; what
        goes through commands acts within a sample, too.
        """
        if self._mine.grows or type(self._mine).drive is not Effect.drive:
            return [self._begun(t) for t in times]
        run = self._current.run
        first, never = float(run.states.time[0]), float(run.states.time[-1]) + 1.0
        earlier = self._begun(first) if min(times) < self.start else Sensitivity()
        later = self._begun(never) if max(times) > self.start else Sensitivity()
        return [
            cut_sensitivity(earlier, run, t) if t < self.start else cut_sensitivity(later, run, first, t)
            for t in times
        ]

    def _begun(self, time: float) -> Sensitivity:
        other = self._mine.model_copy(update={"start": time})
        return self._current.changes.effect(self._mine, other, 1.0)

    def explained(self, times: Sequence[float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return of these times how they go together, beside the other parameters: products of what it does
        (k, k) and with what is there (k,), and how much of the others (m', k) stands in for it.
        """
        columns = self.columns(times)
        within = self._q.T @ columns
        left = columns - self._q @ within
        return left.T @ left, left.T @ self._there, solve_triangular(self._r, within)

    def ratios(self, times: Sequence[float]) -> np.ndarray:
        """Return the likelihood ratios (k,) that it gains beside the other parameters from each time on."""
        gram, along, _ = self.explained(times)
        return along**2 / np.where(gram.diagonal() > 0.0, gram.diagonal(), np.inf)


def step_from(current: MapFit, time: float) -> float:
    """Return the beginning [s] of the next step of the integration: what begins within one acts from then on.

    Where steps become shorter, it still does.
    """
    times = current.run.states.time
    k = min(max(int(np.searchsorted(times, time)), 1), len(times) - 1)
    before = float(times[k - 1])
    step = (float(times[k]) - before) / current.changes.applied.means.shape[1]
    return before + step * float(np.ceil((time - before) / step - 1e-6))
