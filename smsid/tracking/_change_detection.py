"""Sequential detection of changes: which parameter jumped, when, and by how much.

A jump of parameters at some time leaves a signature in the innovations of a filter that does not know of it.
For starts on a grid, as far back as is looked, the generalised likelihood ratio of every group of parameters
(those of a body, of an effect, of a channel's bias) is kept up; each start is judged at ages that double.
Alarms come at the rate asked for at most, by Bonferroni's inequality over all that is tested, and are told
where they still hold a little later: the evidence of a change grows, that of chance fades. The filter is then
run again from before the jump, with its parameters open, about better and better values of them, and
goes on from there: a jump that is large is no small step of a linear filter.

Source: Willsky and Jones, IEEE Trans. Automatic Control 21 (1976) 108; Basseville and Nikiforov, Detection of
Abrupt Changes (1993), section 7.2.4.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import chi2

from smsid._short_repr import short_repr
from smsid._time_text import time_text
from smsid.estimation.parameter_vector import Unknown
from smsid.tracking._course import PASS
from smsid.tracking._jump_runs import CLOCK, JumpRuns, JumpStart, Rerun, likeliest_run, reach_of
from smsid.tracking._tracker import Tracker
from smsid.tracking._update import Update

HOUR = 3600.0  # [s]
CLIPPED = 5.0  # standard deviations beyond which an innovation counts no more: an outlier is no change
LOOKS = 3.0  # tests of a group in the time between two starts: 1 + 1 + 1/2 + 1/4 + ...
SEEN = 1e-9  # share of the largest eigenvalue below which a direction of a jump is not seen
MEMORY = 60.0  # [s] over which the size of innovations is averaged
SETTLING = 2.0  # [s] after an alarm, when the filter takes the jump in and it is told; till it is explained
AGAIN = 16.0  # [s] after that, when it is measured again
MOST = 4  # groups that are tried
BACK = 4.0  # [s] by which a jump may have begun before it is seen best: what grows since, as a phase does
UNEXPLAINED = 1.5  # mean square of innovations after a jump over that before, from which it is sought anew
WARM = 10.0  # [s] after the motion begins in which no change is sought


@short_repr
@dataclass(frozen=True, eq=False)
class Change:
    """A jump of the parameters of one group.

    ``alarm`` and ``began`` are times [s], ``began`` known to plus or minus ``grid`` [s]. ``names``,
    ``jumps`` and ``sigmas`` (k,) are in the parameters' units; ``log_p`` is the natural logarithm of the
    chance of as much without a change. ``others`` are further groups that would explain it, with how much
    less likely: differences of the log-likelihood. ``between``: it began before the first sample after a
    pause. ``explained``: whether the filter follows what is read since; else the size is not to be believed.
    """

    alarm: float
    began: float
    grid: float
    group: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    jumps: np.ndarray
    sigmas: np.ndarray
    log_p: float
    others: tuple[tuple[str, float], ...]
    between: bool = False
    explained: bool = True

    @property
    def sentence(self) -> str:
        """The change in words."""
        size = [
            f"{n} by {j:+.4g} +- {1.96 * s:.2g} {u}"
            for n, u, j, s in sorted(
                zip(self.names, self.units, self.jumps, self.sigmas, strict=True),
                key=lambda x: -abs(x[2]) / x[3] if x[3] > 0.0 else 0.0,
            )
            if abs(j) > 1.96 * s
        ]
        what = "; ".join(size[:3]) or "nothing single stands out"
        when = f"at {time_text(self.began)}, give or take {self.grid:.4g} s"
        if self.between:
            when = f"before {time_text(self.began)}, while nothing was read"
        doubt = "" if self.explained else "; what is read since is not explained so: the size is doubtful"
        return f"{self.group} changed {when}: {what} (95 %){doubt}"


@dataclass(eq=False)
class _Found:
    """A change that is in the filter, and from where it is run."""

    change: Change
    start: JumpStart
    index: np.ndarray
    run: Rerun


@dataclass(eq=False)
class ChangeDetector:
    """Listens to a tracker and tells what changed; set as its ``listener`` by `watch`.

    ``every`` [s] lies between possible starts, ``horizon`` [s] is how far back is looked, ``false_alarms``
    how many are allowed per hour. ``changes`` are those found; the last is measured once more later.
    """

    tracker: Tracker
    false_alarms: float = 0.1
    every: float = 1.0
    horizon: float = 32.0
    changes: list[Change] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.tracker.course.longest_pass = PASS[0]  # a start lies between passes
        self.tracker.rescue = self.rescue
        self._starts: list[JumpStart] = []
        self._last, self._number, self._next = -np.inf, 0, -np.inf
        self._size, self._between = 1.0, False
        self._held = self.tracker.time if self.tracker.moving else np.nan  # of one that was read from a file
        self._lost = self.tracker.log.counts.get("lost", 0)
        self._alarm: float | None = None
        self._found: _Found | None = None
        self._runs = JumpRuns(self.every)
        self._groups = groups_of([f.unknown for f in self.tracker.start.followed])
        self.level = self.false_alarms / HOUR * self.every / (LOOKS * len(self._groups))

    @classmethod
    def watch(cls, tracker: Tracker, *, false_alarms: float = 0.1) -> ChangeDetector:
        """Return a detector that hears every update of a tracker, beside what listened before."""
        detector, before = cls(tracker, false_alarms), tracker.listener

        def hear(update: Update) -> None:
            detector.hear(update)
            if before is not None:
                before(update)

        tracker.listener = hear
        return detector

    def hear(self, update: Update) -> Change | None:
        """Take in an update; return a change if there is enough to say so."""
        found, passed = update.record, update.passed
        if found is None:  # not of a filter
            return None
        if abs(update.time - self._last - passed) > CLOCK:
            self._starts, self._alarm, self._found = [], None, None
            self._runs.passes.clear()
            self._next = update.time + WARM
            before = self._last if np.isfinite(self._last) else self._held
            lost = self.tracker.log.counts.get("lost", 0)
            self._between = abs(update.time - before - passed) > CLOCK and lost == self._lost
            self._lost = lost
        self._last = update.time
        f = self.tracker.filter
        ends = update.time >= f.time - CLOCK  # of a pass: the filter is where this update is
        if ends:
            self._runs.passes.append(f.last)
        while (
            self._runs.passes
            and self._runs.passes[0][0][-1] < update.time - self.horizon - SETTLING - AGAIN - self.every
        ):
            self._runs.passes.popleft()
        if self._found is not None:
            return self._measure_again(update.time, self._found) if ends else None
        for transition in found.transition:
            for start in self._starts:
                start.delta = transition @ start.delta
        if not len(update.rows):
            return None
        if self._alarm is None:  # a change is no noise
            self._size += (float(np.mean(update.innovations**2)) - self._size) * min(1.0, passed / MEMORY)
        scale, innovations = max(1.0, self._size), found.innovations[-1]
        errors = np.clip(innovations, -CLIPPED * np.sqrt(scale), CLIPPED * np.sqrt(scale))
        for start in self._starts:
            seen = found.sensitivity[-1] @ start.delta
            signature = found.whitening[-1] @ seen
            start.score += signature.T @ errors
            start.whole += signature.T @ innovations
            start.information += signature.T @ signature
            start.delta = start.delta - found.gain[-1] @ seen
        if self._alarm is not None:
            if ends and update.time >= self._alarm + SETTLING:
                if any(self._tells(start, scale) for start in self._starts):
                    return self._tell(self._taken_in(self._alarm, scale))
                self._alarm = None  # what has passed was no change
            return None
        self._judge(update.time, scale)
        if ends and self._alarm is None and (self._between or update.time >= self._next):
            self._begin(update.time)
        return None

    def rescue(self) -> bool:
        """Take in what changed, as the motion is lost; return whether that explains what was read."""
        if self._found is not None or not (self._starts and self._runs.passes):
            return False
        found = self._taken_in(self._last if self._alarm is None else self._alarm, max(1.0, self._size))
        explains = self._explains(found.run)
        if explains:
            self._tell(found)
        return explains

    def _tell(self, found: _Found) -> Change:
        """Let the filter go on with a change, and remember it."""
        self._take(found, len(self.changes))
        if self._explains(found.run):
            self.tracker.watch.go_back(found.start.watch)
        self._found, self._due = found, self._due_again(found, self._last)
        self.changes.append(self._with_size(found))
        return self.changes[-1]

    def _begin(self, time: float) -> None:
        f = self.tracker.filter
        m = len(f.values)
        delta = np.zeros((len(f.covariance), m))
        delta[f.parameters] = np.eye(m)
        score, whole, information = np.zeros(m), np.zeros(m), np.zeros((m, m))
        before, watch = f.snapshot(), self.tracker.watch.copied()
        start = JumpStart(self._number, time, delta, score, whole, information, before, watch)
        if self._between:  # what changed while nobody looked did so before all that is read since
            self._between, start.between, start.number = False, True, 0
            start.looked = math.ceil(math.log2(WARM / self.every))
        else:
            self._number += 1
            self._next = max(self._next + self.every, time)
        self._starts.append(start)

    def _judge(self, now: float, scale: float) -> None:
        """Look at the starts whose age is due; remember an alarm, drop starts that are looked at no more."""
        kept = []
        for start in self._starts:
            age = (now - start.time) / self.every
            due = 2**start.looked
            if age < due:
                kept.append(start)
                continue
            start.looked += 1
            if self._tells(start, scale):
                self._alarm = now
            # judged at an age of 2^j, a start goes on to the next age where it is on that age's coarser grid
            if start.number % max(1, 2 ** (start.looked - 1)) == 0 and now - start.time < self.horizon:
                kept.append(start)
        if self._alarm is None:
            self._starts = kept

    def _tells(self, start: JumpStart, scale: float) -> bool:
        """Whether a jump of some group at a start is beyond chance."""
        level = np.log(self.level)
        return any(self._chance(start, start.score, i, scale)[0] < level for i in self._groups.values())

    def _chance(
        self, start: JumpStart, scores: np.ndarray, index: np.ndarray, scale: float
    ) -> tuple[float, float, int]:
        """Return the log of the chance of a group's ratio, the ratio, and how many directions are seen."""
        score, information = scores[index], start.information[np.ix_(index, index)]
        size, basis = np.linalg.eigh(information)
        seen = size > SEEN * max(float(size[-1]), 1e-300)
        if not size[-1] > 0.0:
            return 0.0, 0.0, 0
        ratio = float(np.sum((basis.T @ score)[seen] ** 2 / size[seen])) / scale
        return float(chi2.logsf(ratio, int(seen.sum()))), ratio, int(seen.sum())

    def _taken_in(self, alarm: float, scale: float) -> _Found:
        """Return the likeliest jump.

        Groups are tried in the order of their ratios until one explains what is read: of a large jump, which
        group it was of is no linear question.
        """
        found = {}
        for group, index in self._groups.items():
            looks = [(self._chance(start, start.whole, index, scale), start) for start in self._starts]
            (log_p, ratio, k), start = max(looks, key=lambda x: x[0][1] - 2.0 * x[0][2])
            found[group] = ratio - 2.0 * k, start, log_p
        order = sorted(found, key=lambda g: -found[g][0])
        tried: list[_Found] = []
        for group in order[:MOST]:
            worth, start, log_p = found[group]
            tried.append(self._try_jump(group, start, alarm, scale, log_p))
            if self._explains(tried[-1].run):
                break
        best = min(tried, key=lambda x: x.run.left)  # runs may begin at different times
        best.run = self._runs.refined(
            best.start, best.index, best.run, min(best.run.grid, max(best.change.grid, BACK))
        )
        worth = found[best.change.group][0]
        others = tuple((g, 0.5 * (worth - found[g][0])) for g in order if g != best.change.group)
        best.change = replace(best.change, others=others[:3])
        return best

    def _try_jump(self, group: str, start: JumpStart, alarm: float, scale: float, log_p: float) -> _Found:
        """Return a jump of a group, measured from where the linear filter sees it."""
        index = self._groups[group]
        followed = [self.tracker.start.followed[i] for i in index]
        scales = self.tracker.filter.scales[index]
        prior = np.diag([(u.unknown.scale / reach_of(u.unknown)) ** 2 for u in followed])
        covariance = np.linalg.inv(start.information[np.ix_(index, index)] / scale + prior)
        jump = covariance @ start.whole[index] / scale * scales
        grid = self.every * 2 ** max(0, start.looked - 1)
        names, units = zip(*((u.name, u.unknown.unit) for u in followed), strict=True)
        sigmas = np.sqrt(np.diag(covariance)) * scales
        change = Change(alarm, start.time, grid, group, names, units, jump, sigmas, log_p, ())
        begun = self._runs.passes[0][0][0]  # from before the change, as far as that is remembered
        earlier = [s for s in self._starts if begun - CLOCK <= s.time <= start.time - max(grid, BACK)]
        base = max(earlier, key=lambda s: s.time, default=start)
        point = base.before.values[index] + jump
        best = self._runs.iterated(base, index, point, start.time)
        if best is None or not self._explains(best):  # too large, or at another time
            best = likeliest_run(best, self._runs.found_anew(base, index, point, start.time - grid, alarm))
        if best is None:  # lost in all of them: the filter goes on as it is, and knows the jump no better
            best = Rerun(self.tracker.filter, start.time, -np.inf, np.inf)
        return _Found(change, base, index, best)

    def _measure_again(self, now: float, found: _Found) -> None:
        """Measure a change once more by all there is since it began, when it is time; then watch again."""
        if now < self._due:
            return
        start, index, point = found.start, found.index, found.run.filter.values[found.index]
        run = self._runs.iterated(start, index, point, found.run.onset)
        if not self._explains(found.run):  # by too little data: what was read since tells more
            alarm = found.change.alarm  # soon after what is as large
            run = likeliest_run(
                run, self._runs.found_anew(start, index, point, alarm - 2 * self.every, alarm)
            )
        if run is not None:
            found.run = self._runs.refined(start, index, run, min(found.run.grid, run.grid))
            self._take(found, len(self.changes) - 1)
        self.changes[-1] = self._with_size(found)
        self._due = self._due_again(found, now)
        if self._due <= now:
            self._starts, self._next, self._alarm, self._found = [], now + self.every, None, None

    def _explains(self, run: Rerun) -> bool:
        """Whether a run leaves little more than innovations were before the change."""
        return run.left <= UNEXPLAINED * max(1.0, self._size)

    def _due_again(self, found: _Found, told: float) -> float:
        """Return when a change is measured again [s], after a time [s]: soon, where so little data did not
        explain what is read.
        """
        last = found.change.alarm + SETTLING + AGAIN
        return last if self._explains(found.run) else min(told + SETTLING, last)

    def _with_size(self, found: _Found) -> Change:
        """Return a change as the filter measures it now."""
        f, before, index = self.tracker.filter, found.start.before, found.index
        sigmas = np.hypot(f.sigmas()[index], before.sigmas()[index])
        jumps, run = f.values[index] - before.values[index], found.run
        return replace(
            found.change,
            began=run.onset,
            grid=run.grid,
            jumps=jumps,
            sigmas=sigmas,
            between=found.start.between and run.onset <= found.start.time + CLOCK,
            explained=self._explains(run),
        )

    def _take(self, found: _Found, number: int) -> None:
        """Let the tracker's filter go on from a run; what that leaves unexplained may be in any of it."""
        run, index = found.run, found.index
        f, g = self.tracker.filter, run.filter
        f.q, f.v, f.unknown, f.values, f.at = g.q, g.v, g.unknown, g.values, g.at
        f.covariance = max(1.0, run.left) * g.covariance if np.isfinite(run.left) else g.covariance
        f.known_at = f.sigmas()
        f.forget_beginning()
        jump = f.values[index] - found.start.before.values[index]
        self.tracker.course.jumped(f, number, run.onset, index, jump)


def groups_of(unknowns: Sequence[Unknown]) -> Mapping[str, np.ndarray]:
    """Return where the parameters of each body, effect and channel's bias stand, (k,) by name; no trends."""
    places: dict[str, list[int]] = {}
    for i, u in enumerate(unknowns):
        if u.kind == "trend":
            continue
        name = ".".join(u.name.split(".")[:3]) if u.of_recording else u.name.partition(".")[0]
        places.setdefault(name, []).append(i)
    return {name: np.array(index) for name, index in places.items()}
