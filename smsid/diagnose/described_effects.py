"""Candidates where the description has an effect of their kind already: how far that is off is asked."""

from __future__ import annotations

from dataclasses import replace

from smsid.diagnose.score_test import Candidate
from smsid.effects.base import Effect
from smsid.estimation.parameter_vector import Point


def from_described(candidate: Candidate, point: Point) -> Candidate:
    """Return a candidate that does nothing where its effect is as the description has it, if that has one of
    its kind there, by whatever name.
    """
    own = candidate.effect
    there = [] if own is None else [e for e in point.description.effect if _is_there(own, e)]
    if own is None or not there:
        return candidate
    mine = next((e for e in there if e.name == own.name), there[0])
    freed = mine.model_copy(update={"prior": own.prior})  # as far as the recording says
    return replace(candidate.renamed(mine.name), effect=freed, beside=own)


def _is_there(own: Effect, other: Effect) -> bool:
    """Whether an effect acts where a candidate's does, from the beginning on: what that names (joint, frame,
    number of a mode) is the same.
    """
    if other.kind != own.kind or getattr(other, "start", None) is not None:
        return False
    physical = {p.name.split(".")[1] for p in own.parameters()}
    stated = {f: getattr(own, f) for f in own.model_fields_set - physical - {"kind", "name"}}
    place = {f: x for f, x in stated.items() if isinstance(x, str | int) and not isinstance(x, bool)}
    return all(getattr(other, f) == x for f, x in place.items())
