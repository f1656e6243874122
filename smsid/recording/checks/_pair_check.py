"""The hypotheses about a channel and its rate: what explains that they contradict each other.

A hypothesis is told only where its correlation is above 0.9 over at least 20 independent spans: by chance
this has a probability below 1e-7 for each, and a recording has some hundred hypotheses. A component without
motion above its noise does not correlate, and is not judged.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from smsid.recording.channels import quantity_of
from smsid.recording.checks.increments import KinematicPair, SpanPair
from smsid.recording.checks.sample_faults import SampleFault

if TYPE_CHECKING:
    from smsid.recording.recording import Recording


DEGREE, RPM, GRAVITY = 180.0 / math.pi, 30.0 / math.pi, 9.80665
TOLERANCE = math.log(1.05)

_Causes = tuple[tuple[float, str], ...]
_ANGLE: _Causes = (
    (DEGREE, "'{x}' is probably in degrees, not in {xu}"),
    (1.0 / DEGREE, "'{v}' is probably in degrees, not in {vu}"),
)
_DEGREES_TAKEN: _Causes = ((DEGREE, "'{v}' is probably in {vu} already, but was taken for degrees"),)
_RATE_FIRST: _Causes = (
    (RPM, "'{x}' is probably in rpm, not in {xu}"),
    (1.0 / RPM, "'{x}' is probably in {xu} already, but was taken for rpm"),
)
_RATE_SECOND: _Causes = (
    (1.0 / RPM, "'{v}' is probably in rpm, not in {vu}"),
    (RPM, "'{v}' is probably in {vu} already, but was taken for rpm"),
)
_THOUSAND: _Causes = (
    (1000.0, "'{x}' is probably too large by 1000 (milli-units), or '{v}' too small"),
    (1e-3, "'{v}' is probably too large by 1000 (milli-units), or the clock is in ms"),
)
_CLOCK: _Causes = (
    (1e-6, "the clock is probably in microseconds, not in s"),
    (1e-9, "the clock is probably in nanoseconds, not in s"),
)
_GRAVITY: _Causes = (
    (GRAVITY, "'{v}' is probably in units of standard gravity, not in {vu}"),
    (1.0 / GRAVITY, "'{v}' is probably multiplied by standard gravity once too often"),
    (GRAVITY / 1000.0, "'{v}' is probably in thousandths of standard gravity, not in {vu}"),
)
PAIRS: tuple[tuple[str, str, _Causes], ...] = (
    ("position", "velocity", _THOUSAND),
    ("velocity", "acceleration", _GRAVITY + _THOUSAND),
    ("attitude", "angular_rate", _ANGLE[1:] + _DEGREES_TAKEN + _RATE_SECOND + _THOUSAND[1:]),
    ("angular_rate", "angular_acceleration", _ANGLE + _RATE_FIRST + _THOUSAND),
    ("joint_position", "joint_velocity", _ANGLE + _RATE_SECOND + _THOUSAND),
    ("joint_velocity", "joint_acceleration", _ANGLE + _RATE_FIRST + _THOUSAND),
    ("slosh_position", "slosh_velocity", _THOUSAND),
    ("modal_position", "modal_velocity", _THOUSAND),
    ("wheel_rate", "wheel_torque", ()),
)
"""Quantities, the derivative of each, and what factors between them mean."""


def unit_cause(x: str, v: str, ratio: float) -> str:
    """Return what explains the ratio of the derivative of channel ``x`` to ``v``; empty: no usual unit."""
    first, second = x.partition(".")[2], v.partition(".")[2]
    causes = next(c for one, other, c in PAIRS if (one, other) == (first, second)) + _CLOCK
    distance, cause = min((abs(math.log(ratio / factor)), cause) for factor, cause in causes)
    if distance > TOLERANCE:
        return ""
    return cause.format(x=x, v=v, xu=quantity_of(x).unit, vu=quantity_of(v).unit)


CORRELATED = 0.9
"""Least correlation for a sign, a unit or an exchange of axes."""
PROPORTIONAL = 0.97
"""Least correlation for a scale: below, noise biases the ratio."""
SCALE = 0.15
"""Relative deviation of a scale from 1 that is told; beyond doubt from `CLEAR_SCALE`."""
CLEAR_SCALE = 0.2
LAG, CLEAR_LAG = 0.06, 0.1
"""Delay that is told [s], and that is beyond doubt."""
LAG_GAIN = 0.25
"""The lag must leave less than this share of what is unexplained without it."""
MAX_LAG = 1.0


def component_labels(recording: Recording, name: str) -> tuple[str, ...]:
    """Return the labels of a channel's components; where it has none, the dimension and a number."""
    dim, labels = next(iter(recording.columns(name).items()))
    return labels or tuple(f"{dim} {k}" for k in range(recording[name].shape[1]))


@dataclass(frozen=True)
class _BestSpan:
    """The span over which a component correlates best: with component ``j``, at ``ratio`` of the two."""

    pair: SpanPair
    j: int
    correlation: float
    straight: float
    ratio: float


class PairCheck:
    """The hypotheses about a channel and its rate."""

    def __init__(
        self, recording: Recording, x: str, v: str, pair: KinematicPair, with_error: set[tuple[str, str]]
    ) -> None:
        self.recording, self.x, self.v, self.pair = recording, x, v, pair
        self.labels = component_labels(recording, v)
        self.attitude = pair.kind == "attitude"
        # Sensors at two places of a turning body, or at two ends of a gear, differ by sign and scale.
        same = x.partition(".")[0] == v.partition(".")[0]
        self.rigid = same or self.attitude or x.endswith((".angular_rate", ".wheel_rate"))
        self.vector = quantity_of(v).is_vector
        self.free_gain = v.endswith(".wheel_torque")
        xs = () if self.attitude else component_labels(recording, x)
        self.usable = [
            (v, label) not in with_error
            and not (xs and pair.kind == "plain" and (x, xs[k]) in with_error)
            and not (pair.kind == "inertial" and any(name == x for name, _ in with_error))
            for k, label in enumerate(self.labels)
        ]

    def findings(self) -> list[SampleFault]:
        """Name exchanged, turned, scaled or delayed components and quaternions of another convention."""
        if not any(self.usable):
            return []
        best = self._best(self.pair)
        swaps, told = self._swaps(best)
        plain_swap = bool(swaps) and swaps[0].kind != "turned" and "turned round" not in swaps[0].sentence
        if self.attitude and not plain_swap:
            turned = self._quaternion()
            if turned is not None:
                return [turned]
        found = [*swaps, *self._scales(best, told)]
        if not found:
            delay = self._delay(best)
            found += [delay] if delay else []
        return found

    def delayed(self) -> bool:
        """Whether one of the two channels is late, beyond doubt."""
        delay = self._delay(self._best(self.pair)) if any(self.usable) else None
        return delay is not None and delay.clear

    def _best(self, pair: KinematicPair) -> list[_BestSpan | None]:
        best: list[_BestSpan | None] = [None] * len(self.labels)
        for span in pair.spans:
            a, b = span.increments, span.integrals
            aa, bb = np.sum(a * a, axis=0), np.sum(b * b, axis=0)
            floor = a.shape[0] * (1e-12 * (1.0 + float(np.abs(self.pair.x).max()))) ** 2
            scale = np.sqrt(np.outer(aa, bb))
            c = np.divide(a.T @ b, scale, out=np.zeros_like(scale), where=scale > 0.0)
            for i, usable in enumerate(self.usable):
                if not usable or aa[i] <= floor:
                    continue
                row = np.where(self.usable, np.abs(c[i]), 0.0)
                j = int(np.argmax(row))
                if row[i] > row[j] - 0.05:
                    j = i
                known = best[i]
                if bb[j] > 0.0 and (known is None or row[j] > abs(known.correlation)):
                    ratio = math.sqrt(aa[i] / bb[j])
                    best[i] = _BestSpan(span, j, float(c[i, j]), float(c[i, i]), ratio)
        return best

    def _quaternion(self) -> SampleFault | None:
        straight = _explained_share(self.pair, self.usable)
        if straight is None or straight > 0.8:
            return None
        q = self.pair.x
        readings = []
        for shift, order in ((0, ""), (-1, "in the order w x y z"), (1, "read as w x y z but in x y z w")):
            for sign, direction in ((1.0, ""), (-1.0, "inertial to body")):
                if not order and not direction:
                    continue
                r = np.roll(q, shift, axis=1) * np.array([sign, sign, sign, 1.0])
                other = KinematicPair(self.pair.t, r, self.pair.times, self.pair.v, "attitude")
                share = _explained_share(other, self.usable)
                if share is not None:
                    what = " and ".join(w for w in (order, direction) if w)
                    readings.append((share, what if direction or shift > 0 else f"{what}, not x y z w"))
        if not readings:
            return None
        share, what = max(readings)
        if share < 0.97:
            return None
        sentence = (
            f"'{self.x}' is {what}: its rate then explains {100 * share:.1f} % of '{self.v}', as it is "
            f"{100 * max(straight, 0.0):.1f} %."
        )
        mend = "Correct quaternion and direction of the channel in the mapping."
        return SampleFault(self.x, (), "quaternion", self.v, (share, straight), True, sentence, mend)

    def _swaps(self, best: list[_BestSpan | None]) -> tuple[list[SampleFault], set[int]]:
        moved = {
            i: b
            for i, b in enumerate(best)
            if b is not None
            and b.j != i
            and abs(b.correlation) > CORRELATED
            and abs(b.straight) < abs(b.correlation) - 0.2
        }
        found, told = [], set()
        group = sorted(i for i, b in moved.items() if b.j in moved)
        if len(group) >= 2 and {moved[i].j for i in group} == set(group):
            turned = self._turned(moved)
            if turned is not None:
                return [turned], set(group)
            names = [self.labels[i] for i in group]
            crossed = min(abs(moved[i].correlation) for i in group)
            straight = max(abs(moved[i].straight) for i in group)
            flipped = [self.labels[i] for i in group if moved[i].correlation < 0.0]
            kind = "swapped" if len(group) == 2 else "permuted"
            signs = f" and {', '.join(flipped)} turned round" if flipped else ""
            listed = f"{', '.join(names[:-1])} and {names[-1]}"
            sentence = (
                f"'{self.v}' {listed} are {kind}{signs}: against the derivative of '{self.x}' the "
                f"correlation is {crossed:.2f} crossed, {straight:.2f} straight."
            )
            mend = f"Exchange the columns of '{self.v}' or of '{self.x}' in the mapping."
            found.append(
                SampleFault(
                    self.v, tuple(names), "swapped", self.x, (crossed, straight), self.rigid, sentence, mend
                )
            )
            told = set(group)
        return found, told

    def _turned(self, moved: dict[int, _BestSpan]) -> SampleFault | None:
        """Return that one of two vectors is turned, where that explains far more than axes exchanged do."""
        from scipy.spatial.transform import Rotation  # which takes its time, for what is rare

        if not self.vector or len(self.labels) != 3 or not all(self.usable):
            return None
        span = next(iter(moved.values())).pair
        a, b = span.increments, span.integrals
        exchanged = np.eye(3)
        for i, best in moved.items():
            exchanged[best.j] = math.copysign(1.0, best.correlation) * np.eye(3)[i]
        turn = Rotation.align_vectors(b, a)[0]
        total = float(np.sum(b * b))
        left, other = (float(np.sum((b - x) ** 2)) / total for x in (turn.apply(a), a @ exchanged.T))
        if left > LAG_GAIN * min(other, 1.0 - CORRELATED**2):
            return None
        angle = math.degrees(float(turn.magnitude()))
        sentence = (
            f"'{self.v}' and '{self.x}' are turned against each other by {angle:.0f} deg: so turned, the "
            f"derivative of the latter explains {100 * (1.0 - left):.1f} % of the former, with axes "
            f"exchanged {100 * max(0.0, 1.0 - other):.1f} %."
        )
        mend = "State the frame in which each is mounted, or correct the attitude that one of them is given."
        numbers = angle, left, other
        return SampleFault(self.v, self.labels, "turned", self.x, numbers, self.rigid, sentence, mend)

    def _scales(self, best: list[_BestSpan | None], told: set[int]) -> list[SampleFault]:
        # A common scale of all components may be meant; one that differs from its neighbours is not.
        agree = any(
            b is not None and b.correlation > PROPORTIONAL and abs(b.ratio - 1.0) < 0.05 for b in best
        )
        judged = {
            i: (b, self._scale_of(b, agree))
            for i, b in enumerate(best)
            if b is not None and b.j == i and i not in told and abs(b.correlation) > CORRELATED
        }
        found = []
        whole = len(judged) > 1 and self.vector and len({scale for _, scale in judged.values()}) == 1
        groups = [tuple(judged)] if whole else [(i,) for i in judged]
        for group in groups:
            b, scale = max((judged[i] for i in group), key=lambda x: abs(x[0].correlation))
            if scale is None:
                continue
            kind, reason, mend, clear = scale
            names = tuple(self.labels[i] for i in group)
            where = "" if len(group) == len(self.labels) > 1 else f" {', '.join(names)}"
            signed = math.copysign(b.ratio, b.correlation)
            sentence = (
                f"The derivative of '{self.x}'{where} is {signed:.4g} times '{self.v}'{where} "
                f"(correlation {b.correlation:.3f}): {reason}."
            )
            found.append(
                SampleFault(self.v, names, kind, self.x, (signed, b.correlation), clear, sentence, mend)
            )
        return found

    def _scale_of(self, b: _BestSpan, agree: bool) -> tuple[str, str, str, bool] | None:
        """Return kind, reason and mend of what a ratio and its sign say, and whether it is beyond doubt."""
        off, turned = abs(math.log(b.ratio)), b.correlation < 0.0
        cause = "" if self.free_gain else unit_cause(self.x, self.v, b.ratio)
        if cause:
            also = ", and one of them has the wrong sign" if turned else ""
            return "unit", cause + also, "State the right unit in the mapping.", True
        if turned:
            mend = f"Give '{self.v}' or '{self.x}' a sign of -1 in the mapping."
            clear = self.rigid or off < math.log(1.05)
            return "sign", "one of them has the wrong sign or direction", mend, clear
        # Noise of the ratio, from what is unexplained over the independent spans; it biases the ratio, too.
        spans = max(1.0, float(self.pair.t[-1] - self.pair.t[0]) / b.pair.span)
        sigma = math.sqrt(max(0.0, 1.0 - b.correlation**2) / spans)
        least = math.log(1.0 + SCALE) + 4.0 * sigma if b.correlation > PROPORTIONAL else math.log(1.5)
        if self.free_gain or off < least:
            return None
        clear = self.rigid and agree and b.correlation > PROPORTIONAL and off > math.log(1.0 + CLEAR_SCALE)
        reason = "no usual unit explains it, but a scale factor is wrong in one of them"
        return "scale", reason, "Correct the scale in the mapping or the log.", clear

    def _delay(self, best: list[_BestSpan | None]) -> SampleFault | None:
        good = [(i, b) for i, b in enumerate(best) if b is not None and b.j == i and b.correlation > 0.9]
        if not good:
            return None
        step = max(float(np.median(np.diff(self.pair.t))), float(np.median(np.diff(self.pair.times))))
        # The component that correlates best dates best.
        i, b = max(good, key=lambda item: item[1].correlation)
        grid = np.arange(-MAX_LAG, MAX_LAG + 1e-9, max(0.02, 0.5 * step))
        scores = np.array([self._correlation(i, lag, b.pair.count) for lag in grid])
        k = int(np.argmax(scores))
        without, at = self._correlation(i, 0.0, b.pair.count), float(scores[k])
        lag = float(grid[k])
        if k in (0, grid.size - 1) or abs(lag) < max(LAG, 2.5 * step):
            return None
        if 1.0 - at > LAG_GAIN * (1.0 - without):
            return None
        who, other = (self.v, self.x) if lag > 0.0 else (self.x, self.v)
        source = who.partition(".")[0]
        mend = f"Import '{who}' under a source of its own, with a clock from which the delay is subtracted."
        if source != other.partition(".")[0]:
            mend = f"Subtract the delay from the clock of '{source}'."
        sentence = (
            f"'{who}' is {abs(lag):.2f} s later than '{other}': the correlation of {self.labels[i]} is "
            f"{at:.5f} with this delay, {without:.5f} without."
        )
        clear = abs(lag) > max(CLEAR_LAG, 4.0 * step)
        return SampleFault(who, (), "delay", other, (abs(lag), at, without), clear, sentence, mend)

    def _correlation(self, i: int, lag: float, count: int) -> float:
        s = self.pair.shifted(count, lag, slice(i, i + 1))
        if s is None:
            return 0.0
        a, b = s.increments[:, 0], s.integrals[:, 0]
        scale = math.sqrt(float(a @ a) * float(b @ b))
        return float(a @ b) / scale if scale > 0.0 else 0.0


def _explained_share(pair: KinematicPair, usable: list[bool]) -> float | None:
    """Give the largest share of the integrals' variance that the increments explain, over all spans."""
    shares = []
    for s in pair.spans:
        a, b = s.increments[:, usable], s.integrals[:, usable]
        total = float(np.sum(b * b))
        if total > 0.0:
            shares.append(1.0 - float(np.sum((a - b) ** 2)) / total)
    return max(shares) if shares else None
