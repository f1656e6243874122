"""Effects that are in one of several recordings alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from smsid.diagnose.score_test import Candidate, Score, score_candidates, seen_where
from smsid.estimation.map_estimate import MapFit


def in_one_recording(
    current: MapFit, scores: Sequence[Score], columns: Mapping[tuple[str, str, str], np.ndarray], alias: float
) -> list[Score]:
    """Return scores, each as of its effect in one recording alone where that explains clearly more.

    Nothing passes from one recording to the next, so that the columns (N rows, d) of an effect in one of
    them are those of the effect in all, with the other rows zero. Which one it is, of all and each, was
    searched: its likelihood ratio is to be larger by twice the logarithm of how many these are, and by
    ``alias``. An effect of a name that is there already is another one.
    """
    parts = current.problem.parts
    if not parts:
        return list(scores)
    names = {e.name for e in current.point.description.effect}
    tried = len(parts) + 1
    least = 2.0 * float(np.log(tried)) + alias
    best = {s.candidate.key: s for s in scores}
    may = [s.candidate for s in scores if _may(s.candidate, current.point.within)]
    for part in parts:
        own = [replace(c.apart(names), recording=part.label, grid=c.grid * tried) for c in may]
        there = [seen_where(current, c, columns[c.key]) for c in own]
        for one in score_candidates(current, own, there):
            known = best[one.candidate.key]
            if one.ratio > known.ratio + (0.0 if known.candidate.recording else least):
                best[one.candidate.key] = one
    return [best[s.candidate.key] for s in scores]


def _may(candidate: Candidate, within: Mapping[str, str]) -> bool:
    """Whether a candidate is of an effect that acts throughout, and may do so in one recording alone."""
    effect = candidate.effect
    if effect is None or type(candidate) is not Candidate:
        return False
    return candidate.start is None and effect.name not in within
