"""Fixed-interval smoothing of a track: what is known of each time from all that was read, before and after.

The filter runs once more along the `Course` that the first run found, changes taken in when they happened,
and what each stretch between two rows of the history told is kept: how the state (x,) moves through it, and
score and information of its readings by the state where it began. Going back over these is the modified
Bryson-Frazier smoother (Bierman, *Factorization Methods for Discrete Sequential Estimation* (1977), chapter
10; `smsid.estimation._smoother`), by stretches instead of samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from smsid.errors import SimulationError
from smsid.kernel.filter_arrays import Record
from smsid.tracking._course import Course, Jump, Leg
from smsid.tracking._jump_runs import CLOCK, reach_of_jump
from smsid.tracking._parameter_filter import ParameterFilter
from smsid.tracking._update import Update

FOLLOWED = 0.5  # standard deviations that models may be from what is known, one for the beginning


@dataclass(eq=False)
class Stretch:
    """What readings after some time told of the state (x,) then, and where it went.

    ``change`` (y, x) is how the state now changes with that one, ``score`` (x,) and ``information`` (x, x)
    are of the readings by it. ``shift`` (y,) is how far the run is from what was believed, where it began
    elsewhere.
    """

    change: np.ndarray
    score: np.ndarray
    information: np.ndarray
    shift: np.ndarray

    @classmethod
    def of(cls, size: int, shift: np.ndarray) -> Stretch:
        """Return one of a state (size,) that begins now, the run ``shift`` (size,) from what was believed."""
        return cls(np.eye(size), np.zeros(size), np.zeros((size, size)), shift)

    def through(self, record: Record, first: int, last: int) -> None:
        """Go on to sample ``last`` of a record, from ``first`` on; the way to ``first`` is part of it."""
        for k in range(first, last + 1):
            if k:
                self.change = record.transition[k - 1] @ self.change
                self.shift = record.transition[k - 1] @ self.shift
            there = np.flatnonzero(record.whitening[k].any(axis=1))
            if not len(there):
                continue
            h, gain = record.sensitivity[k, there], record.gain[k][:, there]
            white = record.whitening[k][np.ix_(there, there)]
            seen, off = h @ self.change, h @ self.shift
            signature = white @ seen
            self.score += signature.T @ (record.innovations[k, there] + white @ off)
            self.information += signature.T @ signature
            self.change = self.change - gain @ seen
            self.shift = self.shift - gain @ off


@dataclass(frozen=True, eq=False)
class SmoothedRow:
    """What is known at a time: q (nq,), v (nv,), values (m,), and the covariance (x, x) as a filter's."""

    q: np.ndarray
    v: np.ndarray
    values: np.ndarray
    scales: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True, eq=False)
class _Row(SmoothedRow):
    """The filter at a time [s] of a leg; tangent offsets are from q (nq,), v (nv,) and values (m,)."""

    leg: int
    time: float
    wanted: bool
    pin: pin.Model
    shift: np.ndarray


class Retraced(Course):
    """The course of another run, gone through again; rows are kept at ``wanted`` times [s], leg by leg."""

    def __init__(self, found: Course, wanted: list[np.ndarray]) -> None:
        super().__init__(legs=found.legs, jumps=found.jumps)
        self._wanted = wanted
        self._leg = -1
        self._jump: Jump | None = None  # that is taken in with the next step
        self._stretch: Stretch | None = None
        self._rows: list[_Row] = []
        self._stretches: list[Stretch] = []  # before each row
        self._beginnings: list[tuple[np.ndarray, np.ndarray]] = []  # what was believed where legs begin

    def begun(self, f: ParameterFilter) -> None:
        """Begin where the first run found that the motion began; raises `SimulationError` once too often."""
        self._leg += 1
        if self._leg >= len(self.legs):
            raise SimulationError("The motion begins more often than at first.", advice="Smooth parts of it.")
        leg = self.legs[self._leg]
        before, nv, x = self._stretch, f.nv, len(f.covariance)
        shift = np.zeros(x)
        shift[: 2 * nv] = leg.offset
        m = len(f.values)
        if before is None:
            self._stretch = Stretch.of(x, shift)
        else:  # of the state, parameters alone go on
            shift[x - m :] = before.shift[-m:]
            change = np.zeros((x, before.change.shape[1]))
            change[x - m :] = before.change[-m:]
            self._stretch = Stretch(change, before.score, before.information, shift)
        self._began = f.q, f.v
        f.q = pin.integrate(f.at.base.plant.pin, f.q, leg.offset[:nv])
        f.v = f.v + leg.offset[nv:]
        f.forget_beginning()
        self._points = list(leg.points)
        self._due = [j for j in self.jumps.values() if j.leg == self._leg]
        self._fresh = True
        self._times = self._wanted[self._leg]
        self._reach_points(f, f.time)

    def enter(self, f: ParameterFilter, passed: tuple) -> None:
        """Take a change in with the step in which it happened."""
        if self._jump is not None:
            whole = np.zeros(len(f.values))
            whole[self._jump.index], self._jump = self._jump.size, None
            f.uncertain_within(whole, passed)

    def hear(self, update: Update) -> None:
        """Take in what a moment told."""
        if update.within is not None and self._stretch is not None:
            self._stretch.through(*update.within)

    def look(self, f: ParameterFilter, first: float) -> tuple[float, bool]:
        """Take models to where they were at first; keep a row where one is wanted."""
        now = f.time
        wanted = len(self._times) > 0 and now >= self._times[0] - CLOCK
        if wanted or self._fresh:
            self._times = self._times[np.searchsorted(self._times, now + CLOCK) :]
            self._keep(f, wanted)
        at = f.at
        for jump in [j for j in self._due if j.onset <= now + CLOCK]:
            self._due.remove(jump)
            index = f.parameters.start + jump.index
            reach = reach_of_jump([f.followed[i].unknown for i in jump.index], jump.size)
            f.covariance = f.covariance.copy()
            f.covariance[index, index] += (reach / f.scales[jump.index]) ** 2
            self._jump = jump
        self._reach_points(f, now)
        ahead = [*self._times[:1], *(j.onset for j in self._due), *(t for t, _ in self._points[:1])]
        return (now if self._jump is not None else min(ahead, default=np.inf)), f.at is not at

    def _keep(self, f: ParameterFilter, wanted: bool) -> None:
        """Keep a row of the filter as it is now; the next stretch begins here."""
        stretch = self._stretch
        if stretch is None:
            raise SimulationError("No motion has begun.", advice="Begin one.")
        if self._fresh:
            self._fresh = False
            self._beginnings.append(self._began)
        known = f.q.copy(), f.v.copy(), f.values.copy(), f.scales, f.covariance.copy()
        self._rows.append(_Row(*known, self._leg, f.time, wanted, f.at.base.plant.pin, stretch.shift))
        self._stretches.append(stretch)
        self._stretch = Stretch.of(len(f.covariance), stretch.shift)

    def _reach_points(self, f: ParameterFilter, now: float) -> None:
        reached = [values for time, values in self._points if time <= now + CLOCK]
        if reached:
            self._points = self._points[len(reached) :]
            if not np.array_equal(reached[-1], f.at.values):
                f.linearise_at(reached[-1], f.sigmas())

    def smoothed(self) -> tuple[list[SmoothedRow], Course | None]:
        """Return what is known at the rows from all that was read; and a better course, where models were not
        at what is known now, or the motion began elsewhere.
        """
        after = self._stretch
        if after is None:
            return [], None
        out: list[SmoothedRow] = []
        score, information = after.score, after.information
        for row, before in zip(reversed(self._rows), reversed(self._stretches), strict=True):
            p = row.covariance
            step = p @ score - row.shift
            covariance = p - p @ information @ p
            nv, m = len(row.v), len(row.values)
            q = pin.integrate(row.pin, row.q, step[:nv])
            values = row.values + row.scales * step[-m:]
            v = row.v + step[nv : 2 * nv]
            out.append(SmoothedRow(q, v, values, row.scales, 0.5 * (covariance + covariance.T)))
            score = before.score + before.change.T @ score
            information = before.information + before.change.T @ information @ before.change
        out.reverse()
        found = [x for x, row in zip(out, self._rows, strict=True) if row.wanted]
        return found, self._better(out)

    def _better(self, found: list[SmoothedRow]) -> Course | None:
        """Return the course about what is known at all rows now, if it is another one."""
        better, moved = Course(jumps=self.jumps), 0.0
        for k, (leg, (q, v)) in enumerate(zip(self.legs, self._beginnings, strict=True)):
            own = [(row, x) for row, x in zip(self._rows, found, strict=True) if row.leg == k]
            row, first = own[0]
            nv = len(v)
            offset = np.concatenate([pin.difference(row.pin, q, first.q), first.v - v])
            sigma = np.sqrt(np.maximum(first.covariance.diagonal()[: 2 * nv], 0.0))
            moves = sigma > 0.0
            moved = max(moved, np.abs((offset - leg.offset)[moves] / sigma[moves]).max(initial=0.0))
            onsets = [j.onset for j in self.jumps.values() if j.leg == k]
            points, last = [(-np.inf, first.values)], row.time
            for now, x in own[1:]:
                known = x.scales * np.sqrt(np.maximum(x.covariance.diagonal()[-len(x.values) :], 1e-300))
                if now.wanted:
                    was = [values for time, values in leg.points if time <= now.time + CLOCK][-1]
                    moved = max(moved, np.abs((x.values - was) / known).max() / FOLLOWED)
                passed = [t for t in onsets if last < t <= now.time + CLOCK]
                if passed or (np.abs(x.values - points[-1][1]) > FOLLOWED * known).any():
                    points.append((passed[0] if passed else now.time, x.values))
                last = now.time
            better.legs.append(Leg(points, offset))
        return better if moved > 1.0 else None
