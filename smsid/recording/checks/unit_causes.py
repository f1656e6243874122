"""What the ratio of a channel's derivative to its rate says about their units."""

from __future__ import annotations

import math

from smsid.recording.channels import quantity_of

DEGREE, RPM, GRAVITY = 180.0 / math.pi, 30.0 / math.pi, 9.80665
TOLERANCE = math.log(1.05)

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
PAIRS: tuple[tuple[str, str, _Causes], ...] = (
    ("position", "velocity", _THOUSAND),
    ("velocity", "acceleration", _GRAVITY + _THOUSAND),
    ("attitude", "angular_rate", _ANGLE[1:] + _RATE_SECOND + _THOUSAND[1:]),
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
