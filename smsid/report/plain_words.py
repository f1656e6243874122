"""Causes of a diagnosis in plain words, as one would tell them to a colleague."""

from __future__ import annotations

from collections.abc import Sequence

from smsid._statistics import NORMAL95
from smsid.diagnose.result import Diagnosis, FoundCause, Value
from smsid.effects.base import Effect, known_effect
from smsid.report.numbers import number, unit, with_half


def plain_words(d: Diagnosis) -> str:
    """Return what a diagnosis found as one or two sentences; empty where it names no cause."""
    return f"In plain words: {enumerate_words([cause_in_words(c) for c in d.causes])}." if d.causes else ""


def cause_in_words(cause: FoundCause) -> str:
    """Return a cause in words with its strength, when it began, and what it is not told from."""
    shape = cause.shape.replace("_", " ") if cause.shape else ""
    effect = known_effect(cause.effect) or Effect
    template = effect.in_words
    kind = effect.summary or f"{cause.effect.replace('_', ' ')}{f', {shape}' if shape else ''}"
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
