"""A fitted effect that begins midway, as it would be had it begun at other times."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import solve_triangular

from smsid.effects.base import Effect, Starting
from smsid.estimation.filter_run import FilterRun
from smsid.estimation.map_estimate import Fit
from smsid.estimation.sensitivities import Sensitivity, propagate


def cut_sensitivity(change: Sensitivity, run: FilterRun, begin: float, end: float = np.inf) -> Sensitivity:
    """Return a change as it is from one time on and before another, and nothing else."""

    def within(values: np.ndarray | None, times: np.ndarray) -> np.ndarray | None:
        return None if values is None else values * ((times >= begin) & (times < end))[:, None]

    at = run.states.time
    return Sensitivity(
        within(change.middle, run.middle.time), within(change.at, at), within(change.reading, at)
    )


class Starts:
    """An effect taken out of a fit and put back from other times on, as large as it then explains most.

    What it does from another time on is of first order; that its size goes with the time is not. ``size``
    (m,) are its strengths among the fit's parameters, in units of their scales, which stay in proportion;
    ``beside`` (m,) marks the parameters that make up for the rest.
    """

    def __init__(self, current: Fit, mine: Starting) -> None:
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
