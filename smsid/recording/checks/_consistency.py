"""Kinematically related channels of a recording check each other, component by component."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from smsid._time_text import time_text
from smsid.recording.attitude import continuous
from smsid.recording.channels import quantity_of
from smsid.recording.checks import sample_faults
from smsid.recording.checks._pair_check import PAIRS, PairCheck, component_labels
from smsid.recording.checks.increments import KinematicPair, integral
from smsid.recording.checks.sample_faults import SampleFault

if TYPE_CHECKING:
    from smsid.recording.recording import Recording


def channel_findings(recording: Recording) -> tuple[SampleFault, ...]:
    """Find components of channels that contradict themselves or a kinematically related channel.

    Raises nothing for a recording whose clocks increase and whose samples are finite; see `Recording.check`.
    """
    found: list[SampleFault] = []
    with_error: set[tuple[str, str]] = set()
    for name in recording.channels:
        if name.startswith(("command.", "extra.", "truth.")) or recording[name].ndim != 2:
            continue
        t, values = recording.time(name), recording[name]
        attitude = quantity_of(name, unit=recording.unit(name)).is_quaternion
        values = continuous(values) if attitude else values
        held = sample_faults.held_finding(name, t, values)
        found += [held] if held else []
        for k, label in enumerate(component_labels(recording, name)):
            own = [sample_faults.outlier_finding(name, label, t, values[:, k])]
            if name.endswith(".joint_position"):
                own.append(sample_faults.full_turn_finding(name, label, t, values[:, k]))
            for finding in own:
                if finding is not None:
                    found.append(finding)
                    if not attitude:  # of one, wild samples are left out instead: `_kinematic_pair`
                        with_error.add((name, label))
    pairs = []
    for first, second, _ in PAIRS:
        for x, v in _pairs(recording, first, second):
            pair = _kinematic_pair(recording, x, v)
            if pair is not None:
                pairs.append((x, v, pair))
    for x, v, pair in pairs:
        check = PairCheck(recording, x, v, pair, with_error)
        resting = [f for f in resting_findings(check) if (f.channel, f.components[0]) not in with_error]
        found += resting
        with_error |= {(f.channel, f.components[0]) for f in resting}
    for x, v, pair in sorted(pairs, key=lambda one: one[2].kind == "inertial"):
        if pair.kind == "inertial" and any(f.kind == "quaternion" for f in found):
            continue  # turned by an attitude of another convention
        found += PairCheck(recording, x, v, pair, with_error).findings()
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
        good = ~np.any([sample_faults.outliers(c, 1e-9) for c in continuous(values).T], axis=0)
        return KinematicPair(arrays[0][good], (values / norms)[good], arrays[2], arrays[3], "attitude")
    if v.endswith(".acceleration"):
        attitudes = [name for name in recording.channels if name.endswith(".attitude")]
        if not attitudes:
            return None
        own = x.partition(".")[0] + ".attitude"
        q = own if own in attitudes else attitudes[0]
        return KinematicPair(*arrays, "inertial", (recording.time(q), recording[q]))
    return KinematicPair(*arrays)


FloatArray = NDArray[np.float64]
CONSTANT_SHARE = 0.1
"""Share of a recording that a component must be constant to count as stuck."""


def resting_findings(check: PairCheck) -> list[SampleFault]:
    """Name components that rest at one value while the related channel moves."""
    found: list[SampleFault] = []
    if check.pair.kind != "plain":
        sides = ((check.v, check.pair.times, check.pair.v, None, check.pair.t, check.pair.x),)
    else:
        sides = (
            (check.v, check.pair.times, check.pair.v, None, check.pair.t, check.pair.x),
            (check.x, check.pair.t, check.pair.x, check.pair.v, check.pair.times, check.pair.v),
        )
    for name, t, values, rate, others_t, others in sides:
        if name.startswith("command."):
            continue
        for k, label in enumerate(check.labels):
            if not check.usable[k]:
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
            contradiction = _motion(check, k, t, marked, component, rate is not None, others_t, others)
            if contradiction is None:
                continue
            if kind == "saturated" and check.delayed():
                continue  # where one turns round, the other, late, still moves
            if marked[-1] and np.count_nonzero(np.diff(marked, prepend=False) & marked) == 1:
                kind = "stuck"  # at one value, once and for good: the end of a range is left again
            share = float(np.mean(marked))
            other = check.x if name == check.v else check.v
            value = float(component[np.flatnonzero(marked)[0]])
            verb = "is stuck" if kind == "stuck" else "is saturated"
            at = float(t[np.flatnonzero(marked)[0]])
            found.append(
                SampleFault(
                    name, (label,), kind, other, (value, share, contradiction), True,
                    f"'{name}' {label} {verb} at {value:.4g} for {100 * share:.1f} % of the samples, "
                    f"from t = {time_text(at, t[0])}, while '{other}' moves by {contradiction:.2g} times its "
                    "noise.",
                    "Leave the channel out, or cut the log with window(t0, t1).",
                )
            )  # fmt: skip
    return found


def _motion(
    check: PairCheck,
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
    if check.free_gain:
        return None
    clock = np.interp(others_t, t, marked.astype(float)) >= 1.0
    if np.count_nonzero(clock) < 20:
        return None
    if integrates:
        y = others[clock, k]
        noise = 1.4826 * float(np.median(np.abs(np.diff(others[:, k], n=2))))
        rest = float(np.median(np.abs(y)))
        usual = float(np.sqrt(np.mean(others[:, k] ** 2)))
        if rest * float(others_t[-1] - others_t[0]) < _floor(check):
            return None
        return rest / max(noise, 1e-12) if rest > 10.0 * noise and rest > 0.1 * usual else None
    # While a rate rests, what it drives must grow by the rate times the span.
    fine = None
    mask_sum = np.concatenate([[0.0], np.cumsum(~marked)])
    for s in check.pair.spans:
        a, residual = s.increments[:, k], s.increments[:, k] - s.integrals[:, k]
        if fine is None:
            fine = float(np.median(np.abs(np.diff(a)))) + _floor(check)
        first, last = np.searchsorted(t, s.begins), np.searchsorted(t, s.begins + s.span, side="right")
        inside = (mask_sum[last] - mask_sum[first] == 0.0) & (last > first)
        if np.count_nonzero(inside) < 8:
            continue
        spread, whole = float(np.std(residual[inside])), float(np.std(a))
        if spread > max(0.1 * whole, 5.0 * fine):
            return spread / fine
    return None


def _floor(check: PairCheck) -> float:
    """Give the size below which increments are the last digits of the numbers and times."""
    last = float(np.spacing(np.abs(check.pair.times).max()))  # [s] 2e-7 of seconds since 1970
    turned = 4.0 * last * float(np.nanmax(np.abs(check.pair.v), initial=0.0))
    return 1e-10 * (1.0 + float(np.abs(check.pair.x).max())) + turned
