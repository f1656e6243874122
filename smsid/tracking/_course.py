"""What a tracker's filter is linear about over time: sought as it goes, and kept to be gone through again."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from smsid.tracking._parameter_filter import ParameterFilter

PASS = 0.1, 0.25  # [s] of samples that are filtered before models may be built anew: at first, and later
SHARE = 0.05  # of the time since the motion began that a pass is in between


@dataclass(eq=False)
class Leg:
    """A motion without a silence in it: ``points`` are times [s] and values (m,) that models are at from then
    on; where it began it is taken ``offset`` (2 nv,) from what was believed, as all that follows says.
    """

    points: list[tuple[float, np.ndarray]]
    offset: np.ndarray


@dataclass(frozen=True, eq=False)
class Jump:
    """A change at ``onset`` [s]: parameters ``index`` (k,) jump by about ``size`` (k,)."""

    leg: int
    onset: float
    index: np.ndarray
    size: np.ndarray


@dataclass(eq=False)
class Course:
    """Models follow what is believed. What they were at is remembered only where it is ``kept``."""

    kept: bool = False
    longest_pass: float = PASS[1]
    legs: list[Leg] = field(default_factory=list)
    jumps: dict[int, Jump] = field(default_factory=dict)

    def begun(self, f: ParameterFilter) -> None:
        """Take note of a motion that begins."""
        if self.kept:
            self.legs.append(Leg([(-np.inf, f.at.values)], np.zeros(2 * f.nv)))

    def enter(self, f: ParameterFilter, passed: tuple) -> None:
        """Take note of what is filtered next, edges (n,) and the rest: see `ParameterFilter.go_on`."""

    def look(self, f: ParameterFilter, first: float) -> tuple[float, bool]:
        """Build models anew where parameters have moved; return when to look again, and whether they were.

        ``first`` [s] is when the first motion began.
        """
        ahead = float(np.clip(SHARE * (f.time - first), PASS[0], self.longest_pass))
        changed = f.relinearise()
        if self.kept:
            leg = self.legs[-1]
            if f.refiltered is not None:
                leg.points, leg.offset = [(-np.inf, f.refiltered[0])], f.refiltered[1]
                f.refiltered = None
            if not np.array_equal(leg.points[-1][1], f.at.values):
                leg.points.append((f.time, f.at.values))
        return f.time + ahead, changed

    def jumped(
        self, f: ParameterFilter, number: int, onset: float, index: np.ndarray, size: np.ndarray
    ) -> None:
        """Take note of a change by its number, the last time it is measured: parameters ``index`` (k,) jumped
        by ``size`` (k,), and models are where they are now from its onset [s] on.
        """
        if self.kept and self.legs:
            leg = self.legs[-1]
            leg.points = [p for p in leg.points if p[0] < onset] + [(onset, f.at.values)]
            self.jumps[number] = Jump(len(self.legs) - 1, onset, index, size)
