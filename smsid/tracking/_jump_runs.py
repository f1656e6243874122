"""Measure a jump: the filter run again from before it, with a group of parameters open, about better values.

A jump that is large is no small step of a linear filter, and one sample on its wrong side moves parameters by
many standard deviations: its time is sought to a sample, its size by Gauss and Newton's steps.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from smsid.errors import SmsidError
from smsid.estimation.parameter_vector import Unknown
from smsid.tracking._fit_watch import FitWatch
from smsid.tracking._linearisation import can_exist
from smsid.tracking._parameter_filter import ParameterFilter

ROUNDS = 3  # of times and sizes, in turn
ITERATIONS = 12  # of the point about which a run is linear
WIDER = 3.0  # times a jump, the standard deviation it is given beforehand
WORTH = 2.0  # of the log-likelihood that another time must gain
CONVERGED = 0.3  # standard deviations by which a jump may still move
CLOCK = 1e-6  # [s] by which times may differ that are the same


@dataclass(eq=False)
class JumpStart:
    """A time a change may have begun: signature in the state (x, m), scores (m,), information (m, m).

    ``score`` is of clipped innovations, which raises alarms; ``whole`` of all there was, which says what it
    was: of a large change, clipped ones keep little but the signs. ``before`` is the filter as it was then,
    ``watch`` how well it had followed. ``between``: it is where readings begin again after a pause.
    """

    number: int
    time: float
    delta: np.ndarray
    score: np.ndarray
    whole: np.ndarray
    information: np.ndarray
    before: ParameterFilter
    watch: FitWatch
    looked: int = 0
    between: bool = False


@dataclass(eq=False)
class Rerun:
    """A filter that was run again with a jump at ``onset``, known to ``grid`` [s]: how likely it is, and the
    mean square of the innovations that it left.
    """

    filter: ParameterFilter
    onset: float
    likely: float
    left: float
    grid: float = np.inf


@dataclass(eq=False)
class JumpRuns:
    """Runs of a filter over what it was given lately, ``passes``, each with a jump of a group of parameters.

    ``every`` [s] lies between times that are tried for a jump of which no time is known.
    """

    every: float
    passes: deque[tuple] = field(default_factory=deque)

    def found_anew(
        self, base: JumpStart, index: np.ndarray, point: np.ndarray, first: float, alarm: float
    ) -> Rerun | None:
        """Return the likeliest run of a jump of parameters ``index`` (k,), from a first ``point`` (k,) on, at
        any time from ``first`` to the alarm [s].

        Its size is measured first by what is read after the alarm, when it was there in any case, and before
        that by models that follow what is believed: in a short while it shows almost linearly.
        """
        rough = self._run(base, index, point, first, alarm, follows=True)
        if rough is not None:
            point = rough.filter.values[index]
        after = self.iterated(base, index, point, first, alarm)
        if after is None:
            return None
        times = np.arange(max(first, base.time), alarm, 0.25 * self.every)
        size = after.filter.at.values[index]  # that can exist: where the best run was linear
        best = likeliest_run(*(self._run(base, index, size, float(t)) for t in times))
        return None if best is None else self.refined(base, index, best, 0.25 * self.every)

    def refined(self, start: JumpStart, index: np.ndarray, best: Rerun, grid: float) -> Rerun:
        """Return the likeliest run of a group (k,) within ``grid`` [s] of its onset: times, then sizes."""
        for _ in range(ROUNDS):
            before, best = best, self._at_onset(start, index, best, grid)
            if best.onset == before.onset:
                break
            settled = self.iterated(start, index, best.filter.values[index], best.onset) or best
            best, grid = replace(settled, grid=best.grid), best.grid
        return best

    def _at_onset(self, start: JumpStart, index: np.ndarray, best: Rerun, grid: float) -> Rerun:
        """Return the likeliest run with a jump within ``grid`` [s] of a run's, and how well it is known.

        To a sample: one on the wrong side of a large jump moves parameters by many standard deviations.
        """
        times = np.unique(np.concatenate([p[0] for p in self.passes]))
        times = times[times >= start.time - CLOCK]
        at = int(np.argmin(np.abs(times - best.onset)))
        known = grid
        step = max(1, int(np.searchsorted(times, times[at] + 0.5 * grid)) - at)
        while np.isfinite(best.likely):
            sides = [k for k in (at - step, at + step) if 0 <= k < len(times) - 1]
            runs = [(self._run(start, index, best.filter.values[index], float(times[k])), k) for k in sides]
            there = [(run, k) for run, k in runs if run is not None]
            if all(run.likely < best.likely - WORTH for run, _ in there):
                known = min(known, float(times[min(at + step, len(times) - 1)] - times[at]))
            middle, (best, at) = at, max([(best, at), *there], key=lambda x: x[0].likely)
            if step == 1 and at == middle:
                break
            step = max(1, step // 2)
        return replace(best, grid=known)

    def iterated(
        self, start: JumpStart, index: np.ndarray, point: np.ndarray, onset: float, opening: float = -np.inf
    ) -> Rerun | None:
        """Return the likeliest of runs of parameters ``index`` (k,), each about the point (k,) where the one
        before ended, or half of the way to it where that was no better: Gauss and Newton's steps, damped.
        """
        best, last = None, start.before.values[index]
        for _ in range(ITERATIONS):
            found = self._run(start, index, point, onset, opening)
            # where they are as likely, the later one is linear about better values
            if found is None or (best is not None and not found.likely > best.likely - WORTH):
                point = 0.5 * (last + point)
                continue
            best, last, point = found, point, found.filter.values[index]
            if (np.abs(point - last) <= CONVERGED * found.filter.sigmas()[index]).all():
                break
        return best

    def _run(
        self,
        start: JumpStart,
        index: np.ndarray,
        point: np.ndarray,
        onset: float,
        opening: float = -np.inf,
        follows: bool = False,
    ) -> Rerun | None:
        """Run the filter again from a start: from ``onset`` [s] on a group is open, models at a point (k,).

        It is open anew in every pass until ``opening`` [s], where nobody knows yet when it jumped; models
        that follow go from what was known to what is believed. ``None`` where no such spacecraft can be, or
        the motion is lost.
        """
        g, opened, fresh, likely, squares, count = start.before.snapshot(), False, True, 0.0, 0.0, 0
        jump = point - g.values[index]
        reach = reach_of_jump([g.followed[i].unknown for i in index], jump)
        try:
            for edges, drive, values, attitudes, commanded in self._split(g.time, onset):
                if edges[0] >= onset - CLOCK and (not opened or edges[0] < opening - CLOCK):
                    at, p, mean = g.parameters.start + index, g.covariance.copy(), g.values.copy()
                    if opened:  # what was learnt of them since is forgotten
                        p[at], p[:, at], mean[index] = 0.0, 0.0, start.before.values[index]
                    p[at, at] += (reach / g.scales[index]) ** 2
                    g.covariance, g.values = p, mean
                    if not opened:
                        opened, mean = True, mean.copy()
                        if not follows:
                            mean[index] = point
                        g.linearise_at(mean, np.sqrt(p.diagonal())[g.parameters] * g.scales)
                        if not can_exist(g.at):
                            return None
                if g.at.drives and opened:  # commands act otherwise after the jump
                    drive = g.drive(commanded[0], commanded[1], edges, drive.before[0])
                if opened and fresh:  # at any time in this step: the motion is uncertain by that
                    fresh, whole = False, np.zeros(len(g.values))
                    whole[index] = jump
                    g.uncertain_within(whole, (edges, drive, values, attitudes))
                if follows and edges[0] >= opening - CLOCK and g.begun is None:
                    g.begun = copy(g)
                record = g.go_on(edges, drive, values, attitudes)
                if g.begun is not None:
                    g.relinearise()
                likely += float(record.log_likelihood.sum())
                if opened:
                    squares += float((record.innovations**2).sum())
                    count += int(np.isfinite(values).sum())
        except SmsidError:
            return None
        return Rerun(g, onset, likely, squares / max(count, 1)) if np.isfinite(likely) else None

    def _split(self, time: float, onset: float) -> Iterator[tuple]:
        """Yield the passes after a time [s]; one with ``onset`` [s] in it ends there, and a step follows."""
        for edges, drive, values, attitudes, commanded in self.passes:
            if edges[-1] <= time + CLOCK:
                continue
            cut = int(np.searchsorted(edges, onset - CLOCK))
            cuts = [0, *sorted({cut, cut + 1} & set(range(1, len(edges) - 1))), len(edges) - 1]
            for first, last in pairwise(cuts):
                here, read = slice(first, last + 1), values[first : last + 1].copy()
                read[: 1 if first else 0] = np.nan  # by the part before
                yield edges[here], drive.part(first, last), read, attitudes[here], commanded


def likeliest_run(*runs: Rerun | None) -> Rerun | None:
    """Return the likeliest of runs that there are."""
    there = [r for r in runs if r is not None]
    return max(there, key=lambda r: r.likely) if there else None


def reach_of_jump(unknowns: Sequence[Unknown], jump: np.ndarray) -> np.ndarray:
    """Return standard deviations (k,) for a jump (k,): what is known before pulls at no large one."""
    return np.hypot([reach_of(u) for u in unknowns], WIDER * jump)


def reach_of(unknown: Unknown) -> float:
    """Return how far a parameter may jump: ten times its prior, or its scale where it has none."""
    return 10.0 * (unknown.sigma if np.isfinite(unknown.sigma) else unknown.scale)
