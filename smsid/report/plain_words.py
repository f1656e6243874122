"""Causes of a diagnosis in plain words, as one would tell them to a colleague."""

from __future__ import annotations

from collections.abc import Sequence

from smsid._statistics import NORMAL95
from smsid.diagnose.result import Diagnosis, FoundCause, Value
from smsid.effects import catalogue
from smsid.report.numbers import number, unit, with_half

WORDS = {
    "joint_friction": "{place} has {shape} friction that the description lacks",
    "joint_cable": "a cable or hose across {place} pulls it back",
    "motor_inertia": "the motor of {place} adds inertia that the description lacks",
    "torque_gain": "the torque of {place} is not what is commanded, by a factor",
    "actuator_delay": "{place} acts later than it is commanded",
    "gear_compliance": "the gear of {place} is elastic",
    "backlash": "the gear of {place} has play",
    "servo": "the servo of {place} has another gain than described",
    "base_tilt": "the base under {place} is not level",
    "gear": "the gear of {place} turns by another ratio than described",
    "motor_coupling": "the motors of {place} are coupled",
    "joint_offset": "the angle of {place} has an offset",
    "torque_offset": "a constant torque acts at {place}",
    "payload": "{place} carries a mass that the description lacks",
    "grasped_body": "{place} has grasped a body that the description lacks",
    "body_error": "the {shape} of {place} is not what the description says",
    "mass_loss": "{place} loses mass",
    "thruster_gain": "the thrust is not what is commanded",
    "thruster_misalignment": "the thrust points elsewhere than commanded",
    "external_wrench": "something outside pushes or turns {place}: a {shape}",
    "gravity_gradient": "the gravity gradient turns {place}",
    "slosh": "the fuel in {place} moves otherwise than described: {shape}",
    "slosh_pendulum": "the fuel in {place} swings otherwise than described: {shape}",
    "slosh_nonlinearity": "the fuel in {place} moves non-linearly: {shape}",
    "slosh_wall": "the fuel in {place} reaches the wall of its tank",
    "mode_error": "{place} bends at another frequency or damping than described",
    "frequency_drift": "the frequency of {place} drifts",
    "beam_mode": "{place} has a mode that the description lacks",
    "extra_mode": "{place} has a mode that the description lacks",
    "beam_appendage": "{place} bends otherwise than described",
    "modal_appendage": "{place} bends otherwise than described",
    "geometric_stiffness": "{place} grows stiffer or softer as the craft moves",
    "thermal_snap": "{place} comes to rest bent, as by heat on one side",
    "wheel_imbalance": "{place} is out of balance",
    "sensor_bias": "{place} has a bias",
    "sensor_scale": "{place} reads on another scale",
    "scale_by_rate": "{place} reads on a scale that depends on the rate",
    "sensor_misalignment": "{place} is turned against where the description has it",
    "lever_arm": "{place} sits elsewhere than the description says",
    "time_offset": "the clock of {place} is off",
    "sensor_delay": "{place} reports late",
    "stuck": "{place} is stuck for a while",
    "outliers": "{place} has outliers",
    "quantisation": "{place} is read in coarse steps",
}
"""What a cause of a kind is, in words; one that is not here, of a new law say, by its own summary."""


def plain_words(d: Diagnosis) -> str:
    """Return what a diagnosis found as one or two sentences; empty where it names no cause."""
    return f"In plain words: {enumerate_words([cause_in_words(c) for c in d.causes])}." if d.causes else ""


def cause_in_words(cause: FoundCause) -> str:
    """Return a cause in words with its strength, when it began, and what it is not told from."""
    shape = cause.shape.replace("_", " ") if cause.shape else ""
    template = WORDS.get(cause.effect, "{place} has what the description lacks: {kind}")
    known = catalogue().get(cause.effect)
    kind = (known.summary if known is not None else "") or cause.effect.replace("_", " ")
    what = " ".join(template.format(place=cause.location, shape=shape, kind=kind).split())
    value = strength(cause)
    if value is not None:
        what += f", {quantity(value)}"
        if value.nominal is not None:
            what += f" instead of {number(value.nominal, 4)}"
    if cause.onset is not None:
        what += f", from {number(cause.onset, 4)} s on"
    if cause.recording:
        what += f", in the recording '{cause.recording}'"
    others = [f"{a.shape.replace('_', ' ')} at {a.location}" for a in cause.aliases[:2]]
    return what + (f" (this flight does not tell it from {' or '.join(others)})" if others else "")


def strength(cause: FoundCause) -> Value | None:
    """Return the parameter of a cause that is known best beside its size, as far as it has any."""
    own = [p for p in cause.parameters if p.sigma > 0.0]
    return max(own, key=lambda p: abs(p.value - (p.nominal or 0.0)) / p.sigma, default=None)


def quantity(p: Value) -> str:
    """Return a parameter with half its 95 % interval and its unit."""
    return f"{with_half(p.value, NORMAL95 * p.sigma)} {unit(p.unit)}".rstrip()


def enumerate_words(parts: Sequence[str]) -> str:
    """Return parts as an enumeration; those that hold commas themselves are parted by semicolons."""
    if len(parts) < 2:
        return "".join(parts)
    return "; ".join(parts[:-1]) + f"; and {parts[-1]}"
