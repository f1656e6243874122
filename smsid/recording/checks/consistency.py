"""Kinematically related channels of a recording check each other, component by component.

A hypothesis is told only where its correlation is above 0.9 over at least 20 independent spans: by chance
this has a probability below 1e-7 for each, and a recording has some hundred hypotheses. A component without
motion above its noise does not correlate, and is not judged.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from smsid.recording.checks import sample_faults
from smsid.recording.checks.finding import Finding
from smsid.recording.checks.increments import KinematicPair, SpanPair, integral

if TYPE_CHECKING:
    from smsid.recording.recording import Recording

FloatArray = NDArray[np.float64]

CORRELATED = 0.9
"""Least correlation for a sign or an exchange of axes."""
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
CONSTANT_SHARE = 0.1
"""Share of a recording that a component must be constant to count as stuck."""

PAIRS = (
    ("position", "velocity"),
    ("velocity", "acceleration"),
    ("attitude", "angular_rate"),
    ("angular_rate", "angular_acceleration"),
    ("joint_position", "joint_velocity"),
    ("joint_velocity", "joint_acceleration"),
    ("wheel_rate", "wheel_torque"),
)
DEGREE, RPM, GRAVITY = 180.0 / math.pi, 30.0 / math.pi, 9.80665
UNITS = (
    (DEGREE, "degrees"),
    (RPM, "rpm"),
    (1000.0, "milli-units"),
    (GRAVITY, "units of standard gravity"),
    (GRAVITY / 1000.0, "thousandths of standard gravity"),
)


def channel_findings(recording: Recording) -> tuple[Finding, ...]:
    """Find components of channels that contradict themselves or a kinematically related channel.

    Raises nothing for a recording whose clocks increase and whose samples are finite; see `Recording.check`.
    """
    found: list[Finding] = []
    with_error: set[tuple[str, str]] = set()
    for name in recording.channels:
        if name.startswith(("command.", "extra.", "truth.")) or recording[name].ndim != 2:
            continue
        t, values = recording.time(name), recording[name]
        held = sample_faults.held_finding(name, t, values)
        found += [held] if held else []
        for k, label in enumerate(_labels(recording, name)):
            own = [sample_faults.outlier_finding(name, label, t, values[:, k])]
            if name.endswith(".joint_position"):
                own.append(sample_faults.full_turn_finding(name, label, t, values[:, k]))
            for finding in own:
                if finding is not None:
                    found.append(finding)
                    with_error.add((name, label))
    pairs = []
    for first, second in PAIRS:
        for x, v in _pairs(recording, first, second):
            pair = _kinematic_pair(recording, x, v)
            if pair is not None:
                pairs.append((x, v, pair))
    for x, v, pair in pairs:
        check = _PairCheck(recording, x, v, pair, with_error)
        resting = [f for f in check.resting() if (f.channel, f.components[0]) not in with_error]
        if any(f.kind == "saturated" for f in resting) and check.delayed():
            # where one turns round, the other, late, still moves
            resting = [f for f in resting if f.kind != "saturated"]
        found += resting
        with_error |= {(f.channel, f.components[0]) for f in resting}
    for x, v, pair in pairs:
        found += _PairCheck(recording, x, v, pair, with_error).findings()
    return tuple(found)


def _pairs(recording: Recording, first: str, second: str) -> Iterator[tuple[str, str]]:
    def named(quantity: str) -> list[str]:
        return [
            name
            for name in recording.channels
            if name.partition(".")[2] == quantity and not name.startswith(("extra.", "truth."))
        ]

    for x in named(first):
        for v in named(second):
            commanded = x.startswith("command.") or (v.startswith("command.") and second != "wheel_torque")
            same = first == "attitude" or recording[x].shape[1:] == recording[v].shape[1:]
            if not commanded and same and recording[v].ndim == 2:
                yield x, v


def _kinematic_pair(recording: Recording, x: str, v: str) -> KinematicPair | None:
    values = recording[x]
    arrays = (recording.time(x), values, recording.time(v), recording[v])
    if max(float(np.abs(values).max()), float(np.abs(recording[v]).max())) > 1e100:
        arrays = (arrays[0], np.clip(values, -1e30, 1e30), arrays[2], np.clip(arrays[3], -1e30, 1e30))
    if x.endswith(".attitude"):
        norms = np.linalg.norm(values, axis=1, keepdims=True)
        if not 0.5 < float(norms.min()) <= float(norms.max()) < 2.0:
            return None
        return KinematicPair(arrays[0], values / norms, arrays[2], arrays[3], "attitude")
    if v.endswith(".acceleration"):
        attitudes = [name for name in recording.channels if name.endswith(".attitude")]
        if not attitudes:
            return None
        own = x.partition(".")[0] + ".attitude"
        q = own if own in attitudes else attitudes[0]
        return KinematicPair(*arrays, "inertial", (recording.time(q), recording[q]))
    return KinematicPair(*arrays)


def _labels(recording: Recording, name: str) -> tuple[str, ...]:
    channel = recording.channel(name)
    dim = channel.dims[1]
    if dim in channel.coords:
        return tuple(str(label) for label in channel.coords[dim].values)
    return tuple(str(k) for k in range(channel.shape[1]))


@dataclass(frozen=True)
class _Best:
    """The span over which a component correlates best: with component ``j``, at ``ratio`` of the two."""

    pair: SpanPair
    j: int
    correlation: float
    straight: float
    ratio: float


class _PairCheck:
    """The hypotheses about a channel and its rate."""

    def __init__(
        self, recording: Recording, x: str, v: str, pair: KinematicPair, with_error: set[tuple[str, str]]
    ) -> None:
        self.recording, self.x, self.v, self.pair = recording, x, v, pair
        self.labels = _labels(recording, v)
        self.attitude = pair.kind == "attitude"
        # Sensors at two places of a turning body, or at two ends of a gear, differ by sign and scale.
        same = x.partition(".")[0] == v.partition(".")[0]
        self.rigid = same or self.attitude or x.endswith((".angular_rate", ".wheel_rate"))
        self.free_gain = v.endswith(".wheel_torque")
        xs = () if self.attitude else _labels(recording, x)
        self.usable = [
            (v, label) not in with_error
            and not (self.attitude and any(name == x for name, _ in with_error))
            and not (xs and pair.kind == "plain" and (x, xs[k]) in with_error)
            and not (pair.kind == "inertial" and any(name == x for name, _ in with_error))
            for k, label in enumerate(self.labels)
        ]

    def findings(self) -> list[Finding]:
        """Name exchanged, turned, scaled or delayed components and quaternions of another convention."""
        if not any(self.usable):
            return []
        best = self._best(self.pair)
        swaps, told = self._swaps(best)
        plain_swap = bool(swaps) and "turned round" not in swaps[0].sentence
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

    def _best(self, pair: KinematicPair) -> list[_Best | None]:
        best: list[_Best | None] = [None] * len(self.labels)
        for span in pair.spans():
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
                    best[i] = _Best(span, j, float(c[i, j]), float(c[i, i]), ratio)
        return best

    def _quaternion(self) -> Finding | None:
        straight = _explained(self.pair, self.usable)
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
                share = _explained(other, self.usable)
                if share is not None:
                    readings.append((share, " and ".join(w for w in (order, direction) if w)))
        if not readings:
            return None
        share, what = max(readings)
        if share < 0.97:
            return None
        return Finding(
            self.x,
            (),
            "quaternion",
            self.v,
            (share, straight),
            True,
            f"'{self.x}' is {what}: its rate then explains {100 * share:.1f} % of '{self.v}', as it is "
            f"{100 * max(straight, 0.0):.1f} %.",
            "Correct quaternion and direction of the channel in the mapping.",
        )

    def _swaps(self, best: list[_Best | None]) -> tuple[list[Finding], set[int]]:
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
                Finding(
                    self.v, tuple(names), "swapped", self.x, (crossed, straight), self.rigid, sentence, mend
                )
            )
            told = set(group)
        return found, told

    def _scales(self, best: list[_Best | None], told: set[int]) -> list[Finding]:
        # A common scale of all components may be meant; one that differs from its neighbours is not.
        agree = any(
            b is not None and b.correlation > PROPORTIONAL and abs(b.ratio - 1.0) < 0.05 for b in best
        )
        found = []
        for i, b in enumerate(best):
            if b is None or b.j != i or i in told or abs(b.correlation) < CORRELATED:
                continue
            label, ratio = self.labels[i], b.ratio
            near = f"the derivative of '{self.x}' {label}"
            evidence = (b.ratio, b.correlation)
            if b.correlation < 0.0:
                also = "" if self.free_gain or abs(ratio - 1.0) < SCALE else f", at a ratio of {ratio:.4g}"
                found.append(
                    Finding(
                        self.v, (label,), "sign", self.x, evidence, self.rigid,
                        f"'{self.v}' {label} has the sign opposite to {near}: correlation "
                        f"{b.correlation:.3f}{also}.",
                        f"Give the component of '{self.v}' or of '{self.x}' a sign of -1 in the mapping.",
                    )
                )  # fmt: skip
                continue
            if self.free_gain or b.correlation < PROPORTIONAL or abs(ratio - 1.0) < SCALE:
                continue
            # Noise of the ratio, from what is unexplained over the independent spans.
            spans = max(1.0, float(self.pair.t[-1] - self.pair.t[0]) / b.pair.span)
            sigma = math.sqrt(max(0.0, 1.0 - b.correlation**2) / spans)
            if abs(math.log(ratio)) < math.log(1.0 + SCALE) + 4.0 * sigma:
                continue
            unit = next(
                (
                    (name, power)
                    for factor, name in UNITS
                    for power in (1, -1)
                    if abs(math.log(ratio) - power * math.log(factor)) < 0.03
                ),
                None,
            )
            told_ratio = f"{near} is {ratio:.4g} times '{self.v}' {label} (correlation {b.correlation:.3f})"
            told_ratio = told_ratio[0].upper() + told_ratio[1:]
            if unit is not None:
                who = self.x if (unit[1] > 0) != unit[0].endswith("gravity") else self.v
                sentence = f"{told_ratio}: '{who}' {label} is probably in {unit[0]}."
                kind, mend = "unit", "State the unit of the component in the mapping."
            else:
                sentence = f"{told_ratio}: one of them is wrongly scaled."
                kind, mend = "scale", "Correct the scale of the component in the mapping or the log."
            clear = kind == "unit" or (
                self.rigid and agree and abs(math.log(ratio)) > math.log(1.0 + CLEAR_SCALE)
            )
            found.append(Finding(self.v, (label,), kind, self.x, evidence, clear, sentence, mend))
        return found

    def _delay(self, best: list[_Best | None]) -> Finding | None:
        good = [(i, b) for i, b in enumerate(best) if b is not None and b.j == i and b.correlation > 0.9]
        if not good:
            return None
        step = max(float(np.median(np.diff(self.pair.t))), float(np.median(np.diff(self.pair.times))))
        # The component that correlates best dates best.
        i, b = max(good, key=lambda item: item[1].correlation)
        grid = np.arange(-MAX_LAG, MAX_LAG + 1e-9, max(0.02, 0.5 * step))
        scores = np.array([self._correlation(i, lag, b.pair.span) for lag in grid])
        k = int(np.argmax(scores))
        without, at = self._correlation(i, 0.0, b.pair.span), float(scores[k])
        lag = float(grid[k])
        if k in (0, grid.size - 1) or abs(lag) < max(LAG, 2.5 * step):
            return None
        if 1.0 - at > LAG_GAIN * (1.0 - without):
            return None
        who, other = (self.v, self.x) if lag > 0.0 else (self.x, self.v)
        return Finding(
            who, (), "delay", other, (abs(lag), at, without), abs(lag) > max(CLEAR_LAG, 4.0 * step),
            f"'{who}' is {abs(lag):.2f} s later than '{other}': the correlation of {self.labels[i]} is "
            f"{at:.5f} with this delay, {without:.5f} without.",
            _mend_of_delay(who, other),
        )  # fmt: skip

    def _correlation(self, i: int, lag: float, span: float) -> float:
        for s in self.pair.spans(lag, span):
            a, b = s.increments[:, i], s.integrals[:, i]
            scale = math.sqrt(float(a @ a) * float(b @ b))
            return float(a @ b) / scale if scale > 0.0 else 0.0
        return 0.0

    def resting(self) -> list[Finding]:
        """Name components that rest at one value while the related channel moves."""
        found: list[Finding] = []
        if self.pair.kind != "plain":
            sides = ((self.v, self.pair.times, self.pair.v, None, self.pair.t, self.pair.x),)
        else:
            sides = (
                (self.v, self.pair.times, self.pair.v, None, self.pair.t, self.pair.x),
                (self.x, self.pair.t, self.pair.x, self.pair.v, self.pair.times, self.pair.v),
            )
        for name, t, values, rate, others_t, others in sides:
            if name.startswith("command."):
                continue
            for k, label in enumerate(self.labels):
                if not self.usable[k]:
                    continue
                component = values[:, k]
                begin, end = sample_faults.longest_constant_run(component)
                kind = "stuck"
                marked = np.zeros(component.size, dtype=bool)
                if end - begin >= max(20, CONSTANT_SHARE * component.size):
                    marked[begin:end] = True
                else:
                    marked = sample_faults.clipped_samples(component)
                    kind = "saturated"
                    if rate is not None:
                        driven = np.interp(t, others_t, integral(others_t, others)[:, k])
                        marked = sample_faults.beyond_the_end(marked, component, driven)
                if np.count_nonzero(marked) < 20:
                    continue
                contradiction = self._motion(k, t, marked, component, rate is not None, others_t, others)
                if contradiction is None:
                    continue
                share = float(np.mean(marked))
                other = self.x if name == self.v else self.v
                value = float(component[np.flatnonzero(marked)[0]])
                verb = "is stuck" if kind == "stuck" else "is saturated"
                at = float(t[np.flatnonzero(marked)[0]])
                found.append(
                    Finding(
                        name, (label,), kind, other, (value, share, contradiction), True,
                        f"'{name}' {label} {verb} at {value:.4g} for {100 * share:.1f} % of the samples, "
                        f"from t = {at:.6g} s, while '{other}' moves by {contradiction:.2g} times its noise.",
                        "Leave the channel out, or cut the log with window(t0, t1).",
                    )
                )  # fmt: skip
        return found

    def _motion(
        self,
        k: int,
        t: FloatArray,
        marked: NDArray[np.bool_],
        component: FloatArray,
        integrates: bool,
        others_t: FloatArray,
        others: FloatArray,
    ) -> float | None:
        """Say how far the other channel moves, in units of its noise, where this one rests, or None.

        The rate of a resting angle must be zero; the change of what a resting rate drives must be uniform.
        """
        if self.free_gain:
            return None
        clock = np.interp(others_t, t, marked.astype(float)) >= 1.0
        if np.count_nonzero(clock) < 20:
            return None
        if integrates:
            y = others[clock, k]
            noise = 1.4826 * float(np.median(np.abs(np.diff(others[:, k], n=2))))
            rest = float(np.median(np.abs(y)))
            usual = float(np.sqrt(np.mean(others[:, k] ** 2)))
            if rest * float(others_t[-1] - others_t[0]) < self._floor():
                return None
            return rest / max(noise, 1e-12) if rest > 10.0 * noise and rest > 0.1 * usual else None
        # While a rate rests, what it drives must grow by the rate times the span.
        fine = None
        mask_sum = np.concatenate([[0.0], np.cumsum(~marked)])
        for s in self.pair.spans():
            a, residual = s.increments[:, k], s.increments[:, k] - s.integrals[:, k]
            if fine is None:
                fine = float(np.median(np.abs(np.diff(a)))) + self._floor()
            first, last = np.searchsorted(t, s.begins), np.searchsorted(t, s.begins + s.span, side="right")
            inside = (mask_sum[last] - mask_sum[first] == 0.0) & (last > first)
            if np.count_nonzero(inside) < 8:
                continue
            spread, whole = float(np.std(residual[inside])), float(np.std(a))
            if spread > max(0.1 * whole, 5.0 * fine):
                return spread / fine
        return None

    def _floor(self) -> float:
        """Give the size below which increments are the last digits of the numbers and times."""
        last = float(np.spacing(np.abs(self.pair.times).max()))  # [s] 2e-7 of seconds since 1970
        turned = 4.0 * last * float(np.nanmax(np.abs(self.pair.v), initial=0.0))
        return 1e-10 * (1.0 + float(np.abs(self.pair.x).max())) + turned


def _mend_of_delay(who: str, other: str) -> str:
    source = who.partition(".")[0]
    if source != other.partition(".")[0]:
        return f"Subtract the delay from the clock of '{source}'."
    return f"Import '{who}' under a source of its own, with a clock from which the delay is subtracted."


def _explained(pair: KinematicPair, usable: list[bool]) -> float | None:
    """Give the largest share of the integrals' variance that the increments explain, over all spans."""
    shares = []
    for s in pair.spans():
        a, b = s.increments[:, usable], s.integrals[:, usable]
        total = float(np.sum(b * b))
        if total > 0.0:
            shares.append(1.0 - float(np.sum((a - b) ** 2)) / total)
    return max(shares) if shares else None
