"""How many causes there are, and which further one has room: those of one panel or tank count once."""

from __future__ import annotations

from collections.abc import Sequence

from smsid.diagnose.score_test import Candidate

STRUCTURES = ("slosh", "appendage")
"""Families of what a panel or a tank does."""


def cause_count(causes: Sequence[Candidate]) -> int:
    """Return the number of causes, those of one panel or tank counted once: one that is described wrongly
    takes several to follow, and hides none elsewhere.
    """
    places = _structures(causes)
    return len(causes) - len(places) + len(set(places))


def has_room(candidate: Candidate, causes: Sequence[Candidate], most: int) -> bool:
    """Return whether a candidate may be a further cause of ``most`` that are looked for; those of one panel
    or tank are no more than that, either.
    """
    places = _structures(causes)
    if candidate.family in STRUCTURES and candidate.location in places:
        return places.count(candidate.location) < most
    return cause_count(causes) < most


def _structures(causes: Sequence[Candidate]) -> list[str]:
    return [c.location for c in causes if c.family in STRUCTURES]
