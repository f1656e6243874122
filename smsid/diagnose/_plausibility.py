"""Which values cannot be: a sensor that would read nothing, a mass below zero, a drag that pushes."""

from __future__ import annotations

import math

from smsid.diagnose.result import FoundCause, Value
from smsid.diagnose.score_test import Candidate
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.estimation.map_estimate import MapFit

DRAGS = ("viscous", "quadratic", "cubic")


def impossible(cause: FoundCause) -> str:
    """Return in words which value of a cause cannot be; empty where all can.

    A reversed sign (-2) can be, also of a sensor, and so can a motor that does not turn (-1).
    """
    for p in cause.parameters:
        own = p.name.partition(".")[2]
        if not math.isfinite(p.value):
            return f"{p.name} has no finite value"
        if (
            cause.effect == "sensor_scale"
            and own.startswith("error")
            and abs(1.0 + p.value) < THRESHOLDS.sensor_reads
        ):
            return f"with {p.name} = {p.value:.4g} the sensor would read nothing"
        if own == "density" and 1.0 + p.value < THRESHOLDS.body_left:
            return f"with {p.name} = {p.value:.4g} {cause.location} would have no mass"
        if cause.effect == "joint_friction" and own in DRAGS and p.value < 0.0:
            return f"with {p.name} = {p.value:.4g} {p.unit} the drag would push"
        if own in ("mass", "m") and p.value < 0.0 and (cause.effect == "payload" or p.nominal is not None):
            return f"{p.name} = {p.value:.4g} {p.unit} is below zero"
    return ""


def impossible_fit(found: MapFit, candidate: Candidate) -> str:
    """Return in words which value of a candidate's parameters in a fit cannot be, or is within what its law
    does not resolve; empty where all can.
    """
    own = [u for u in found.unknowns if u.name in candidate.parameters]
    values = tuple(
        Value(u.name, found.point.value(u), math.nan, u.unit, None if candidate.effect else u.nominal)
        for u in own
    )
    told = candidate.kind, candidate.location, candidate.family, candidate.shape
    absurd = impossible(FoundCause(*told, values, (), {}))
    if absurd or candidate.effect is None:
        return absurd
    fields = [n.partition(".")[2] for n in candidate.free]
    return candidate.instance(found.point).why_unresolved(fields)
