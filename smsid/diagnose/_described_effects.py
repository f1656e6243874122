"""Candidates where the description has an effect of their kind already: how far that is off is asked."""

from __future__ import annotations

from collections.abc import Collection, Container, Iterable, Mapping
from dataclasses import replace

from smsid.diagnose.score_test import Candidate
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.effects.base import Effect
from smsid.estimation.map_estimate import MapFit
from smsid.estimation.parameter_vector import Point

ASIDE = {"kind", "name", "prior", "known", "start", "laws"}  # fields that say nothing of where an effect acts


def from_described(candidate: Candidate, point: Point) -> Candidate:
    """Return a candidate that does nothing where its effect is as the description has it, if that has one of
    its kind there, by whatever name; else, where its name is another effect's, under a name of its own.

    Candidates that are searched for otherwise than by slopes act beside what is described.
    """
    own, listed = candidate.effect, point.description.effect
    if own is None:
        return candidate
    there = [e for e in listed if _is_there(own, e, candidate.parameters)]
    if not there or type(candidate) is not Candidate:
        name = free_name(own.name, {e.name for e in listed})
        return candidate if name == own.name else candidate.renamed(name)
    mine = next((e for e in there if e.name == own.name), there[0])
    freed = mine.model_copy(update={"prior": own.prior})  # as far as the recording says
    return replace(candidate.renamed(mine.name), effect=freed, beside=own)


def _is_there(own: Effect, other: Effect, names: Collection[str]) -> bool:
    """Whether an effect acts where a candidate's does, from the beginning on: what they name (joint, frame,
    number of a mode) is the same, and it has all parameters of these ``names``.
    """
    if other.kind != own.kind or getattr(other, "start", None) is not None:
        return False
    physical = {p.name.split(".")[1] for e in (own, other) for p in e.parameters()}
    places = set(type(own).model_fields) - physical - ASIDE
    alike = all(
        getattr(other, f) == x for f in places if not isinstance(x := getattr(own, f), bool | float | dict)
    )
    return alike and {n.partition(".")[2] for n in names} <= {
        p.name.partition(".")[2] for p in other.parameters()
    }


def least_beside_listed(found: MapFit, candidates: Iterable[Candidate]) -> dict[tuple[str, str], float]:
    """Return likelihood ratios by place and family up to which a candidate may be the shape of a law that is
    listed there, of which nature has the size only, as beside a cause (`THRESHOLDS.beside`).

    ``found`` is the fit of the nominal parameters, ``candidates`` are all there are.
    """
    least: dict[tuple[str, str], float] = {}
    listed = [c for c in candidates if c.beside is not None and c.beside.open_shape]
    told = dict(zip((u.name for u in found.unknowns), found.told, strict=True)) if listed else {}
    for c in listed:
        place = c.location, c.family
        for u in (u for u in found.unknowns if u.name in c.free and told[u.name]):
            ratio = (found.point.value(u) / found.sigma(u.name)) ** 2
            least[place] = max(THRESHOLDS.beside * ratio, least.get(place, 0.0))
    return least


def least_for(candidate: Candidate, found: MapFit, listed: Mapping[tuple[str, str], float]) -> float:
    """Return the likelihood ratio up to which a candidate may be the shape of a ``listed`` law, as
    `least_beside_listed` has them: none for one that frees what is nominal in a fit, an error in size.
    """
    least = listed.get((candidate.location, candidate.family), 0.0)
    return 0.0 if least and {u.name for u in found.unknowns} & set(candidate.free) else least


def free_name(name: str, taken: Container[str]) -> str:
    """Return a name, numbered where it is taken."""
    numbered = (name, *(f"{name}_{k}" for k in range(2, 1000)))
    return next(n for n in numbered if n not in taken)
