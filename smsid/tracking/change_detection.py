"""Sequential detection of changes: which parameter jumped, when, and by how much.

A jump of parameters at some time leaves a signature in the innovations of a filter that does not know of it.
For starts on a grid, as far back as is looked, the generalised likelihood ratio of every group of parameters
(those of a body, of an effect, of a channel's bias) is kept up; each start is judged at ages that double.
Alarms come at the rate asked for at most, by Bonferroni's inequality over all that is tested. The filter then
takes the jump into its state, with what is not known of it.

Source: Willsky and Jones, IEEE Trans. Automatic Control 21 (1976) 108; Basseville and Nikiforov, Detection of
Abrupt Changes (1993), section 7.2.4.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import chi2

from smsid._short_repr import short_repr
from smsid.estimation.parameter_vector import Unknown
from smsid.tracking.tracker import Tracker
from smsid.tracking.update import Update

HOUR = 3600.0  # [s]
CLIPPED = 5.0  # standard deviations beyond which an innovation counts no more: an outlier is no change
LOOKS = 3.0  # tests of a group in the time between two starts: 1 + 1 + 1/2 + 1/4 + ...
SEEN = 1e-9  # share of the largest eigenvalue below which a direction of a jump is not seen
MEMORY = 60.0  # [s] over which the size of innovations is averaged
AGAIN = (0.5, 0.2, 0.1, 0.0)  # shares of a jump by which parameters may still be off, each time
SETTLING = 4.0  # [s] after an alarm, and between looks, in which a jump is measured
CLOCK = 1e-6  # [s] by which times may differ that are the same
WARM = 10.0  # [s] after the motion begins in which no change is sought


@short_repr
@dataclass(frozen=True, eq=False)
class Change:
    """A jump of the parameters of one group.

    ``alarm`` and ``began`` are times [s], ``began`` known to plus or minus ``grid`` [s]. ``names``,
    ``jumps`` and ``sigmas`` (k,) are in the parameters' units; ``log_p`` is the natural logarithm of the
    chance of as much without a change. ``others`` are further groups that would explain it, with how much
    less likely:
    differences of the log-likelihood.
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
    was: of a large change, clipped ones keep little but the signs. ``values`` and ``sigmas`` (m,) are what
    was believed of the parameters then.
    """

    number: int
    time: float
    delta: np.ndarray
    score: np.ndarray
    whole: np.ndarray
    information: np.ndarray
    values: np.ndarray
    sigmas: np.ndarray
    looked: int = 0


@dataclass(eq=False)
class _Measured:
    """A change whose size is being measured: parameters at ``index`` were ``before``, known to ``spread``.

    ``size`` (k,) is the first guess of the jump, in scales; ``shares`` are the times at which parameters are
    opened again by that share of it, at the last of which the change is told.
    """

    change: Change
    index: np.ndarray
    before: np.ndarray
    spread: np.ndarray
    size: np.ndarray
    shares: list[tuple[float, float]]


@dataclass(eq=False)
class ChangeDetector:
    """Listens to a tracker and tells what changed; set as its ``listener`` by `watch`.

    ``every`` [s] lies between possible starts, ``horizon`` [s] is how far back is looked, ``false_alarms``
    how many are allowed per hour. ``changes`` are those found.
    """

    tracker: Tracker
    false_alarms: float = 0.1
    every: float = 1.0
    horizon: float = 32.0
    changes: list[Change] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._starts: list[_Start] = []
        self._last, self._number, self._next = -np.inf, 0, -np.inf
        self._size = 1.0
        self._alarm: float | None = None
        self._measured: _Measured | None = None
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
        if abs(update.time - self._last - passed) > CLOCK:
            self._starts, self._alarm, self._measured = [], None, None
            self._next = update.time + WARM
        self._last = update.time
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
        if self._measured is not None:
            return self._measure(update.time, self._measured)
        if self._alarm is not None:
            if update.time >= self._alarm + SETTLING:
                self._measured = self._taken_in(update.time, self._alarm, scale)
            return None
        self._judge(update.time, scale)
        if self._alarm is None and update.time >= self._next:
            self._begin(update.time)
        return None

    def _begin(self, time: float) -> None:
        f = self.tracker.filter
        m = len(f.values)
        delta = np.zeros((len(f.covariance), m))
        delta[f.parameters] = np.eye(m)
        self._starts.append(
            _Start(
                self._number,
                time,
                delta,
                np.zeros(m),
                np.zeros(m),
                np.zeros((m, m)),
                f.values.copy(),
                f.sigmas(),
            )
        )
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

    def _taken_in(self, now: float, alarm: float, scale: float) -> _Measured:
        """Take the likeliest jump into the filter's state and return what is to be measured from here on."""
        found = {}
        for group, index in self._groups.items():
            looks = [(self._chance(start, start.whole, index, scale), start) for start in self._starts]
            (log_p, ratio, k), start = max(looks, key=lambda x: x[0][1] - 2.0 * x[0][2])
            found[group] = ratio - 2.0 * k, start, log_p
        order = sorted(found, key=lambda g: -found[g][0])
        worth, start, log_p = found[order[0]]
        index = self._groups[order[0]]
        followed = [self.tracker.start.followed[i] for i in index]
        f = self.tracker.filter
        prior = np.diag([(u.unknown.scale / _reach(u.unknown)) ** 2 for u in followed])
        covariance = np.linalg.inv(start.information[np.ix_(index, index)] / scale + prior)
        jump, moved = covariance @ start.whole[index] / scale, start.delta[:, index]
        # as wide as the jump is large: the filter, linear about the old values, has drawn from data since
        opened = moved @ (covariance + np.diag(jump**2)) @ moved.T
        f.covariance = f.covariance + 0.5 * (opened + opened.T)
        f.move(moved @ jump)
        f.linearise_at(f.values, f.sigmas())
        change = Change(
            alarm,
            start.time,
            self.every * 2 ** max(0, start.looked - 1),
            order[0],
            tuple(u.name for u in followed),
            tuple(u.unknown.unit for u in followed),
            jump * f.scales[index],
            np.sqrt(np.diag(covariance)) * f.scales[index],
            log_p,
            tuple((g, 0.5 * (worth - found[g][0])) for g in order[1:4]),
        )
        shares = [(now + (k + 1) * SETTLING, share) for k, share in enumerate(AGAIN)]
        return _Measured(change, index, start.values[index], start.sigmas[index], np.abs(jump), shares)

    def _measure(self, now: float, measured: _Measured) -> Change | None:
        """Open the parameters again, less each time, where the filter is linear about better values."""
        if not (measured.shares and now >= measured.shares[0][0]):
            return None
        _, share = measured.shares.pop(0)
        f, index = self.tracker.filter, measured.index
        if share > 0.0:
            at = f.parameters.start + index
            f.covariance[at, at] += (share * measured.size) ** 2
            return None
        jumps = f.values[index] - measured.before
        change = replace(measured.change, jumps=jumps, sigmas=np.hypot(f.sigmas()[index], measured.spread))
        self.changes.append(change)
        self._starts, self._next, self._alarm, self._measured = [], now + self.every, None, None
        return change


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
