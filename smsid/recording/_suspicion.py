"""Channels that contradict each other as if a unit, a sign or a convention were wrong.

A channel ``x`` and its rate ``v`` are compared as increments of ``x`` against integrals of ``v`` over the
same spans. The span is the one that correlates best: long enough for noise to fade, short enough for bias not
to matter.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from smsid.recording import _checks
from smsid.recording._attitude import conjugate, multiply, rotate, rotation_vector, slerp
from smsid.recording._resampling import linear
from smsid.recording.channels import quantity_of
from smsid.recording.checks.increments import crosses_a_gap, integral

if TYPE_CHECKING:
    from smsid.recording.recording import Recording

FloatArray = NDArray[np.float64]

MIN_CORRELATION = 0.9
TOLERANCE = 0.05
MIN_SPANS = 20
"""Fewer independent spans than this correlate by chance."""

LARGEST = 1e30
"""Beyond what any sensor reads, in any unit."""

DEGREE, RPM, GRAVITY = 180.0 / math.pi, 30.0 / math.pi, 9.80665


@dataclass(frozen=True)
class Suspicion:
    """Two channels that contradict each other.

    ``ratio`` is the derivative of ``channel`` over ``other``, ``correlation`` theirs over the best span;
    ``clear`` says that the ratio is that of a known unit, or of a sign or quaternion convention.
    """

    channel: str
    other: str
    ratio: float
    correlation: float
    clear: bool
    sentence: str


@dataclass(frozen=True)
class _Match:
    ratio: float
    correlation: float


_Increments = Callable[[FloatArray, FloatArray], "FloatArray | None"]
_Causes = tuple[tuple[float, str], ...]

_ANGLE: _Causes = (
    (DEGREE, "'{x}' is probably in degrees, not in {xu}"),
    (1.0 / DEGREE, "'{v}' is probably in degrees, not in {vu}"),
)
_RATE_FIRST: _Causes = ((RPM, "'{x}' is probably in rpm, not in {xu}"),)
_RATE_SECOND: _Causes = ((1.0 / RPM, "'{v}' is probably in rpm, not in {vu}"),)
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
_PAIRS: tuple[tuple[str, str, _Causes], ...] = (
    ("position", "velocity", _THOUSAND),
    ("velocity", "acceleration", _GRAVITY + _THOUSAND),
    ("attitude", "angular_rate", _ANGLE[1:] + _RATE_SECOND + _THOUSAND[1:]),
    ("angular_rate", "angular_acceleration", _ANGLE + _RATE_FIRST + _THOUSAND),
    ("joint_position", "joint_velocity", _ANGLE + _RATE_SECOND + _THOUSAND),
    ("joint_velocity", "joint_acceleration", _ANGLE + _RATE_FIRST + _THOUSAND),
    ("slosh_position", "slosh_velocity", _THOUSAND),
    ("modal_position", "modal_velocity", _THOUSAND),
)


def suspicions(recording: Recording) -> list[Suspicion]:
    """List the contradictions between channels of a recording.

    Raises:
        RecordingError: a clock that does not increase, samples that are not finite, or bad quaternions.
    """
    _checks.check_clocks(recording)
    _checks.check_finite(recording)
    _checks.check_quaternions(recording)
    found: list[Suspicion] = []
    for first, second, units in _PAIRS:
        causes = units + _CLOCK
        for x, v in _channels(recording, first, second):
            if first == "attitude":
                found += _judge_attitude(recording, x, v, causes)
            elif second == "acceleration":
                driven = _inertial_integral(recording, x, v)
                found += [] if driven is None else _judge(recording, x, v, *driven, causes)
            else:
                found += _judge(
                    recording,
                    x,
                    v,
                    recording.time(v),
                    integral(recording.time(v), _samples(recording, v)),
                    causes,
                )
    return found


def _samples(recording: Recording, name: str) -> FloatArray:
    """Return the samples of a channel with what no sensor reads cut down: squares of it overflow."""
    return np.clip(recording[name], -LARGEST, LARGEST)


def _channels(recording: Recording, first: str, second: str) -> Iterator[tuple[str, str]]:
    """Pair the channels of two quantities; what was commanded is no measurement of the rest."""

    def named(quantity: str) -> list[str]:
        names = [name for name in recording.channels if name.partition(".")[2] == quantity]
        return [name for name in names if not name.startswith(("command.", "extra."))]

    for x in named(first):
        for v in named(second):
            same = first == "attitude" or recording[x].shape[1:] == recording[v].shape[1:]
            if same and recording[v].ndim == 2:
                yield x, v


def _judge(
    recording: Recording, x: str, v: str, times: FloatArray, driven: FloatArray, causes: _Causes
) -> list[Suspicion]:
    found = []
    values = _samples(recording, x)
    groups = [slice(None)]
    dim = "whole"
    # Joints can be logged in different units; the axes of one vector hardly.
    if not quantity_of(x).is_vector:
        groups = [slice(k, k + 1) for k in range(values.shape[1])]
        dim = str(recording.channel(x).dims[1])
    names = recording.labels.get(dim)
    for k, group in enumerate(groups):
        match = _compare(recording.time(x), values[:, group], times, driven[:, group], _difference)
        where = "" if dim == "whole" else f" ({dim} {names[k] if names else k})"
        found += _verdict(x, v, match, causes, where)
    return found


def _judge_attitude(recording: Recording, x: str, v: str, causes: _Causes) -> list[Suspicion]:
    times, driven = recording.time(v), integral(recording.time(v), _samples(recording, v))

    def match_of(q: FloatArray) -> _Match | None:
        return _compare(recording.time(x), q, times, driven, _turn)

    q = recording[x]
    match = match_of(q)
    if match is None or match.correlation > MIN_CORRELATION:
        return _verdict(x, v, match, causes, "")
    rolled = np.roll(q, -1, axis=1)
    readings = (
        (conjugate(q), "the quaternion is inertial to body, or the rate has the wrong sign"),
        (rolled, "the quaternion is in the order w x y z, not x y z w"),
        (conjugate(rolled), "the quaternion is in the order w x y z and inertial to body"),
    )
    for reading, what in readings:
        other = match_of(reading)
        if other is not None and other.correlation > 0.98 and abs(other.ratio - 1.0) < TOLERANCE:
            sentence = (
                f"The derivative of '{x}' agrees with '{v}' (correlation {other.correlation:.3f}) only if "
                f"{what}."
            )
            return [Suspicion(x, v, other.ratio, other.correlation, True, sentence)]
    return _verdict(x, v, match, causes, "")


def _verdict(x: str, v: str, match: _Match | None, causes: _Causes, where: str) -> list[Suspicion]:
    if match is None or abs(match.correlation) < MIN_CORRELATION:
        return []
    sign = "-" if match.correlation < 0.0 else ""
    told = (
        f"The derivative of '{x}'{where} is {sign}{match.ratio:.4g} times '{v}' "
        f"(correlation {match.correlation:.3f})"
    )
    known = [(abs(math.log(match.ratio / factor)), cause) for factor, cause in causes]
    distance, cause = min(known)
    clear = distance < math.log(1.0 + TOLERANCE)
    near_one = abs(match.ratio - 1.0) < TOLERANCE
    if clear:
        reason = cause.format(x=x, v=v, xu=quantity_of(x).unit, vu=quantity_of(v).unit) + (
            ", and one of them has the wrong sign" if sign else ""
        )
    elif sign:
        clear, reason = near_one, "one of them has the wrong sign or direction"
    elif not 2.0 / 3.0 < match.ratio < 1.5:
        reason = "no usual unit explains it, but a scale factor is wrong in one of them"
    else:
        return []
    signed = math.copysign(match.ratio, match.correlation)
    return [Suspicion(x, v, signed, match.correlation, clear, f"{told}: {reason}.")]


def _compare(
    t: FloatArray, x: FloatArray, times: FloatArray, driven: FloatArray, increments: _Increments
) -> _Match | None:
    """Correlate increments of ``x`` (N, k) with those of ``driven`` (M, k); None without enough motion."""
    inside = (t >= times[0]) & (t <= times[-1])
    t, x = t[inside], x[inside]
    if t.size <= MIN_SPANS:
        return None
    s = linear(times, driven, t)
    best: _Match | None = None
    span = 1
    while span <= t.size // MIN_SPANS:
        stride = max(1, span // 4)
        a = increments(x[:-span:stride], x[span::stride])
        if a is None:
            break
        b = s[span::stride] - s[:-span:stride]
        begins, ends = t[:-span:stride], t[span::stride]
        whole = ~(crosses_a_gap(t, begins, ends) | crosses_a_gap(times, begins, ends))
        if np.count_nonzero(whole) < MIN_SPANS:
            break
        a, b = a[whole], b[whole]
        a, b = a - a.mean(axis=0), b - b.mean(axis=0)
        aa, bb, ab = float(np.sum(a * a)), float(np.sum(b * b)), float(np.sum(a * b))
        # Below this, increments are the last digits of the numbers and no motion.
        floor = a.size * (1e-12 * (1.0 + float(np.abs(x).max()))) ** 2
        if aa > floor and bb > 0.0:
            correlation = ab / math.sqrt(aa * bb)
            if best is None or abs(correlation) > abs(best.correlation):
                best = _Match(math.sqrt(aa / bb), correlation)
        span *= 2
    return best


def _difference(before: FloatArray, after: FloatArray) -> FloatArray:
    return after - before


def _turn(before: FloatArray, after: FloatArray) -> FloatArray | None:
    """Give the rotation vectors in body axes, or None where too large to compare with integrals."""
    norms = np.linalg.norm(before, axis=1, keepdims=True) * np.linalg.norm(after, axis=1, keepdims=True)
    turned = rotation_vector(multiply(conjugate(before), after) / norms)
    return None if np.linalg.norm(turned, axis=1).max() > 1.0 else turned


def _inertial_integral(
    recording: Recording, velocity: str, acceleration: str
) -> tuple[FloatArray, FloatArray] | None:
    """Integrate a body acceleration in inertial axes; None without an attitude that covers its clock."""
    attitudes = [name for name in recording.channels if name.endswith(".attitude")]
    own = velocity.partition(".")[0] + ".attitude"
    attitude = own if own in attitudes else next(iter(attitudes), None)
    if attitude is None:
        return None
    clock, times = recording.time(attitude), recording.time(acceleration)
    inside = (times >= clock[0]) & (times <= clock[-1])
    if np.count_nonzero(inside) <= MIN_SPANS:
        return None
    times = times[inside]
    turned = rotate(slerp(clock, recording[attitude], times), _samples(recording, acceleration)[inside])
    return times, integral(times, turned)
