"""What speaks against a cause though it explains: a value that cannot be, or its own channel left wrong."""

from __future__ import annotations

import math

from smsid.diagnose.result import FoundCause
from smsid.diagnose.stepwise import Search
from smsid.diagnose.thresholds import THRESHOLDS

LEFT = THRESHOLDS.own_channel
READS = THRESHOLDS.sensor_reads
LEAST = THRESHOLDS.body_left
DRAGS = ("viscous", "quadratic", "cubic")
OF_JOINTS = ("joint_position", "joint_velocity")


def doubts(found: Search, cause: FoundCause) -> str:
    """Return in words why a cause cannot stand as an explanation; empty where nothing speaks against it."""
    return impossible(cause) or (_own_channel_left(found, cause) if found.misfit else "")


def impossible(cause: FoundCause) -> str:
    """Return in words which value of a cause cannot be; empty where all can.

    A reversed sign (-2) can be, also of a sensor, and so can a motor that does not turn (-1).
    """
    for p in cause.parameters:
        own = p.name.partition(".")[2]
        if not math.isfinite(p.value):
            return f"{p.name} has no finite value"
        if cause.effect == "sensor_scale" and own.startswith("error") and abs(1.0 + p.value) < READS:
            return f"with {p.name} = {p.value:.4g} the sensor would read nothing"
        if own == "density" and 1.0 + p.value < LEAST:
            return f"with {p.name} = {p.value:.4g} {cause.location} would have no mass"
        if cause.effect == "joint_friction" and own in DRAGS and p.value < 0.0:
            return f"with {p.name} = {p.value:.4g} {p.unit} the drag would push"
        if own in ("mass", "m") and p.value < 0.0 and (cause.effect == "payload" or p.nominal is not None):
            return f"{p.name} = {p.value:.4g} {p.unit} is below zero"
    return ""


def _own_channel_left(found: Search, cause: FoundCause) -> str:
    """Return which channel a cause shows in directly is still far from explained, if one is."""
    for channel, left in found.noise.items():
        if left > LEFT and _shows_in(found, cause, channel):
            return f"{channel} is left at {left:.3g} times its noise"
    return ""


def _shows_in(found: Search, cause: FoundCause, channel: str) -> bool:
    place = cause.location.partition("[")[0]
    if cause.family == "sensor":
        return channel == place or channel.partition(".")[0] == place
    quantity = channel.partition(".")[2]
    if quantity in OF_JOINTS:
        return place in found.last.point.base.arm_joints.names
    return quantity == "wheel_rate" and place in found.last.point.base.wheels.names
