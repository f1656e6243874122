"""Sequential detection of changes: which parameter jumped, when, and by how much.

A jump of parameters at some time leaves a signature in the innovations of a filter that does not know of it.
For starts on a grid, as far back as is looked, the generalised likelihood ratio of every group of parameters
(those of a body, of an effect, of a channel's bias) is kept up; each start is judged at ages that double.
Alarms come at the rate asked for at most, by Bonferroni's inequality over all that is tested. The filter is
then run again from before the jump, with its parameters open, about better and better values of them, and
goes on from there: a jump that is large is no small step of a linear filter.

Source: Willsky and Jones, IEEE Trans. Automatic Control 21 (1976) 108; Basseville and Nikiforov, Detection of
Abrupt Changes (1993), section 7.2.4.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import chi2

from smsid._short_repr import short_repr
from smsid.errors import SmsidError
from smsid.estimation.parameter_vector import Unknown
from smsid.tracking.linearisation import can_exist
from smsid.tracking.parameter_filter import ParameterFilter
from smsid.tracking.tracker import PASS, Tracker
from smsid.tracking.update import Update

HOUR = 3600.0  # [s]
CLIPPED = 5.0  # standard deviations beyond which an innovation counts no more: an outlier is no change
LOOKS = 3.0  # tests of a group in the time between two starts: 1 + 1 + 1/2 + 1/4 + ...
SEEN = 1e-9  # share of the largest eigenvalue below which a direction of a jump is not seen
MEMORY = 60.0  # [s] over which the size of innovations is averaged
SETTLING = 2.0  # [s] after an alarm, when the filter takes the jump in and it is told
AGAIN = 16.0  # [s] after that, when it is measured again
MOST = 4  # groups that are tried
ROUNDS = 3  # of times and sizes, in turn
ITERATIONS = 6  # of the point about which a run is linear
WIDER = 3.0  # times a jump, the standard deviation it is given beforehand
BACK = 4.0  # [s] by which a jump may have begun before it is seen best: what grows since, as a phase does
WORTH = 2.0  # of the log-likelihood that another time must gain
FINEST = 0.02  # of the time between two starts, to which the time of a jump is sought
EXPLAINED, UNEXPLAINED = 1.1, 1.5  # mean square of the innovations after a jump: other times, larger jumps
CONVERGED = 0.3  # standard deviations by which a jump may still move
CLOCK = 1e-6  # [s] by which times may differ that are the same
WARM = 10.0  # [s] after the motion begins in which no change is sought


@short_repr
@dataclass(frozen=True, eq=False)
class Change:
    """A jump of the parameters of one group.

    ``alarm`` and ``began`` are times [s], ``began`` known to plus or minus ``grid`` [s]. ``names``,
    ``jumps`` and ``sigmas`` (k,) are in the parameters' units; ``log_p`` is the natural logarithm of the
    chance of as much without a change. ``others`` are further groups that would explain it, with how much
    less likely: differences of the log-likelihood.
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
        return f"{self.group} changed at {self.began:.4g} s, give or take {self.grid:.4g} s: {what} (95 %)"


@dataclass(eq=False)
class _Start:
    """A time a change may have begun: signature in the state (x, m), scores (m,), information (m, m).

    ``score`` is of clipped innovations, which raises alarms; ``whole`` of all there was, which says what it
    was: of a large change, clipped ones keep little but the signs. ``before`` is the filter as it was then.
    """

    number: int
    time: float
    delta: np.ndarray
    score: np.ndarray
    whole: np.ndarray
    information: np.ndarray
    before: ParameterFilter
    looked: int = 0


@dataclass(eq=False)
class _Rerun:
    """A filter that was run again with a jump at ``onset``, known to ``grid`` [s]: how likely it is, and the
    mean square of the innovations that it left.
    """

    filter: ParameterFilter
    onset: float
    likely: float
    left: float
    grid: float = np.inf


@dataclass(eq=False)
class _Found:
    """A change that is in the filter, from where it is run, and when it is due to be measured again [s]."""

    change: Change
    start: _Start
    index: np.ndarray
    run: _Rerun
    due: float


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
        self.tracker.longest_pass = PASS[0]  # a start lies between passes
        self._starts: list[_Start] = []
        self._last, self._number, self._next = -np.inf, 0, -np.inf
        self._size = 1.0
        self._alarm: float | None = None
        self._found: _Found | None = None
        self._passes: deque[tuple] = deque()
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
            self._passes.clear()
            self._next = update.time + WARM
        self._last = update.time
        f = self.tracker.filter
        ends = update.time >= f.time - CLOCK  # of a pass: the filter is where this update is
        if ends:
            self._passes.append((*f.last, self.tracker.commanded))
        while (
            self._passes
            and self._passes[0][0][-1] < update.time - self.horizon - SETTLING - AGAIN - self.every
        ):
            self._passes.popleft()
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
                self._found = self._taken_in(update.time, self._alarm, scale)
                self.changes.append(self._with_size(self._found))
                return self.changes[-1]
            return None
        self._judge(update.time, scale)
        if ends and self._alarm is None and update.time >= self._next:
            self._begin(update.time)
        return None

    def _begin(self, time: float) -> None:
        f = self.tracker.filter
        m = len(f.values)
        delta = np.zeros((len(f.covariance), m))
        delta[f.parameters] = np.eye(m)
        score, whole, information = np.zeros(m), np.zeros(m), np.zeros((m, m))
        self._starts.append(_Start(self._number, time, delta, score, whole, information, f.snapshot()))
        self._number += 1
        self._next = max(self._next + self.every, time)

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
            for index in self._groups.values():
                if self._chance(start, start.score, index, scale)[0] < np.log(self.level):
                    self._alarm = now
            # judged at an age of 2^j, a start goes on to the next age where it is on that age's coarser grid
            if start.number % max(1, 2 ** (start.looked - 1)) == 0 and now - start.time < self.horizon:
                kept.append(start)
        if self._alarm is None:
            self._starts = kept

    def _chance(
        self, start: _Start, scores: np.ndarray, index: np.ndarray, scale: float
    ) -> tuple[float, float, int]:
        """Return the log of the chance of a group's ratio, the ratio, and how many directions are seen."""
        score, information = scores[index], start.information[np.ix_(index, index)]
        size, basis = np.linalg.eigh(information)
        seen = size > SEEN * max(float(size[-1]), 1e-300)
        if not size[-1] > 0.0:
            return 0.0, 0.0, 0
        ratio = float(np.sum((basis.T @ score)[seen] ** 2 / size[seen])) / scale
        return float(chi2.logsf(ratio, int(seen.sum()))), ratio, int(seen.sum())

    def _taken_in(self, now: float, alarm: float, scale: float) -> _Found:
        """Take the likeliest jump into the filter and return it.

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
            tried.append(self._tried(group, start, alarm, scale, log_p, now + AGAIN))
            if tried[-1].run.left <= UNEXPLAINED:
                break
        best = min(tried, key=lambda x: x.run.left)  # runs may begin at different times
        best.run = self._refined(best.start, best.index, best.run, max(best.change.grid, BACK))
        worth = found[best.change.group][0]
        others = tuple((g, 0.5 * (worth - found[g][0])) for g in order if g != best.change.group)
        best.change = replace(best.change, others=others[:3])
        self._take(best.run)
        return best

    def _tried(
        self, group: str, start: _Start, alarm: float, scale: float, log_p: float, due: float
    ) -> _Found:
        """Return a jump of a group, measured from where the linear filter sees it."""
        index = self._groups[group]
        followed = [self.tracker.start.followed[i] for i in index]
        scales = self.tracker.filter.scales[index]
        prior = np.diag([(u.unknown.scale / _reach(u.unknown)) ** 2 for u in followed])
        covariance = np.linalg.inv(start.information[np.ix_(index, index)] / scale + prior)
        jump = covariance @ start.whole[index] / scale * scales
        grid = self.every * 2 ** max(0, start.looked - 1)
        names, units = zip(*((u.name, u.unknown.unit) for u in followed), strict=True)
        sigmas = np.sqrt(np.diag(covariance)) * scales
        change = Change(alarm, start.time, grid, group, names, units, jump, sigmas, log_p, ())
        begun = self._passes[0][0][0]  # from before the change, as far as that is remembered
        earlier = [s for s in self._starts if begun - CLOCK <= s.time <= start.time - max(grid, BACK)]
        base = max(earlier, key=lambda s: s.time, default=start)
        best = self._iterated(base, index, jump, start.time)
        if best is None or best.left > UNEXPLAINED:  # too large, or at another time
            best = _likelier(best, self._found_anew(base, index, jump, start.time - grid, alarm))
        if best is None:  # lost in all of them: the filter goes on as it is, and knows the jump no better
            best = _Rerun(self.tracker.filter, start.time, -np.inf, np.inf)
        return _Found(change, base, index, best, due)

    def _found_anew(
        self, base: _Start, index: np.ndarray, jump: np.ndarray, first: float, alarm: float
    ) -> _Rerun | None:
        """Return the likeliest run of a jump at any time from ``first`` to the alarm [s].

        Its size is measured first by what is read after the alarm, when it was there in any case.
        """
        after = self._iterated(base, index, jump, first, 2 * ITERATIONS, alarm)
        if after is None:
            return None
        guess = after.filter.values[index] - base.before.values[index]
        times = np.arange(max(first, base.time), alarm, 0.25 * self.every)
        best = _likelier(*(self._iterated(base, index, guess, float(t), 1) for t in times))
        return None if best is None else self._refined(base, index, best, 0.25 * self.every)

    def _measure_again(self, now: float, found: _Found) -> None:
        """Measure a change once more by all there is since it began, when it is time; then watch again."""
        if now < found.due:
            return
        guess = found.run.filter.values[found.index] - found.start.before.values[found.index]
        run = self._iterated(found.start, found.index, guess, found.run.onset)
        if run is not None:
            found.run = self._refined(found.start, found.index, run, 2.0 * self.every)
            self._take(found.run)
        self.changes[-1] = self._with_size(found)
        self._starts, self._next, self._alarm, self._found = [], now + self.every, None, None

    def _with_size(self, found: _Found) -> Change:
        """Return a change as the filter measures it now."""
        f, before, index = self.tracker.filter, found.start.before, found.index
        sigmas = np.hypot(f.sigmas()[index], before.sigmas()[index])
        jumps, run = f.values[index] - before.values[index], found.run
        return replace(found.change, began=run.onset, grid=run.grid, jumps=jumps, sigmas=sigmas)

    def _take(self, run: _Rerun) -> None:
        """Let the tracker's filter go on from a run; what that leaves unexplained may be in any of it."""
        f, g = self.tracker.filter, run.filter
        f.q, f.v, f.unknown, f.values, f.at = g.q, g.v, g.unknown, g.values, g.at
        f.covariance = max(1.0, run.left) * g.covariance if np.isfinite(run.left) else g.covariance
        f.known_at = f.sigmas()
        f.forget_beginning()

    def _refined(self, start: _Start, index: np.ndarray, best: _Rerun, grid: float) -> _Rerun:
        """Return the likeliest run within ``grid`` [s] of a run's onset: times and sizes in turn, till they
        explain what is read.
        """
        for _ in range(ROUNDS):
            before, best = best, self._at_onset(start, index, best, grid)
            if best.onset != before.onset:
                guess = best.filter.values[index] - start.before.values[index]
                settled = self._iterated(start, index, guess, best.onset) or best
                best = replace(settled, grid=best.grid)
            if best.left <= EXPLAINED or not best.likely > before.likely + WORTH:
                break
        return best

    def _at_onset(self, start: _Start, index: np.ndarray, best: _Rerun, grid: float) -> _Rerun:
        """Return the likeliest run with a jump within ``grid`` [s] of a run's, and how well it is known.

        Where that explains what is read, the search ends when it has found nothing better twice.
        """
        step, missed, known = 0.5 * grid, 0, grid
        while np.isfinite(best.likely) and step > FINEST * self.every:
            if missed >= 2 and best.left <= EXPLAINED:
                break
            guess, middle = best.filter.values[index] - start.before.values[index], best
            sides = [self._iterated(start, index, guess, middle.onset + x, 1) for x in (-step, step)]
            best = _likelier(middle, *sides) or middle
            others = [x.likely for x in (middle, *sides) if x is not None and x is not best]
            if best.likely > max(others, default=-np.inf) + WORTH:
                known = step
            missed = 0 if best.likely > middle.likely + WORTH else missed + 1
            step *= 0.5
        return replace(best, grid=known)

    def _iterated(
        self,
        start: _Start,
        index: np.ndarray,
        jump: np.ndarray,
        onset: float,
        times: int = ITERATIONS,
        opening: float = -np.inf,
    ) -> _Rerun | None:
        """Return the likeliest of runs, each about the parameters at which the one before ended, or about
        half of the way to them where that was no better: Gauss and Newton's steps, damped.
        """
        best, last = None, np.zeros(len(index))
        for _ in range(times):
            found = self._run(start, index, jump, onset, opening)
            # where they are as likely, the later one is linear about better values
            if found is None or (best is not None and not found.likely > best.likely - WORTH):
                jump = 0.5 * (last + jump)
                continue
            best, last = found, jump
            g = found.filter
            jump = g.values[index] - start.before.values[index]
            if (np.abs(jump - last) <= CONVERGED * g.sigmas()[index]).all():
                break
        return best

    def _run(
        self, start: _Start, index: np.ndarray, jump: np.ndarray, onset: float, opening: float
    ) -> _Rerun | None:
        """Run the filter again from a start: parameters open at ``onset`` [s], it linear about a jump (k,).

        They are open anew in every pass until ``opening`` [s], where nobody knows yet when they jumped.
        ``None`` where no such spacecraft can be, or the motion is lost.
        """
        g, opened, likely, squares, count = start.before.snapshot(), False, 0.0, 0.0, 0
        try:
            for edges, drive, values, attitudes, commanded in self._passes:
                if edges[-1] <= g.time + CLOCK:
                    continue
                if edges[-1] > onset + CLOCK and (not opened or edges[0] < opening - CLOCK):
                    at, p, mean = g.parameters.start + index, g.covariance.copy(), g.values.copy()
                    if opened:  # what was learnt of them since is forgotten
                        p[at], p[:, at], mean[index] = 0.0, 0.0, start.before.values[index]
                    reach = np.array([_reach(g.followed[i].unknown) for i in index])
                    reach = np.hypot(
                        reach, WIDER * jump
                    )  # so that what is known before pulls at no large one
                    p[at, at] += (reach / g.scales[index]) ** 2
                    g.covariance, g.values = p, mean
                    if not opened:
                        opened, point = True, mean.copy()
                        point[index] += jump
                        g.linearise_at(point, np.sqrt(p.diagonal())[g.parameters] * g.scales)
                        if not can_exist(g.at):
                            return None
                if g.at.drives and opened and commanded is not None:  # commands act otherwise after the jump
                    substep = self.tracker.setting.substep
                    drive = g.drive(commanded, edges, substep, drive.before[0])
                if opened and not count:  # at any time in this pass: the motion is uncertain by that
                    moved = np.zeros(len(g.covariance))
                    moved[g.parameters.start + index] = jump / g.scales[index]
                    for change in g.snapshot().go_on(edges, drive, values, attitudes).transition:
                        moved = change @ moved
                    moved[2 * g.nv :] = 0.0
                    g.covariance = g.covariance + np.outer(moved, moved)
                record = g.go_on(edges, drive, values, attitudes)
                likely += float(record.log_likelihood.sum())
                if opened:
                    squares += float((record.innovations**2).sum())
                    count += int(np.isfinite(values).sum())
        except SmsidError:
            return None
        return _Rerun(g, onset, likely, squares / max(count, 1)) if np.isfinite(likely) else None


def _likelier(*runs: _Rerun | None) -> _Rerun | None:
    """Return the likeliest of runs that there are."""
    there = [r for r in runs if r is not None]
    return max(there, key=lambda r: r.likely) if there else None


def groups_of(unknowns: Sequence[Unknown]) -> Mapping[str, np.ndarray]:
    """Return where the parameters of each body, effect and channel's bias stand, (k,) indices by name."""
    places: dict[str, list[int]] = {}
    for i, u in enumerate(unknowns):
        name = u.name.rsplit(".", 1)[0] if u.kind == "bias" else u.name.partition(".")[0]
        places.setdefault(name, []).append(i)
    return {name: np.array(index) for name, index in places.items()}


def _reach(unknown: Unknown) -> float:
    """Return how far a parameter may jump: ten times its prior, or its scale where it has none."""
    return 10.0 * (unknown.sigma if np.isfinite(unknown.sigma) else unknown.scale)
