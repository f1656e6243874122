"""Candidates of a diagnosis: how much each explains alone, and which this experiment cannot tell apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from smsid.diagnose.score_test import Candidate, Score, correlation, scored, signatures
from smsid.diagnose.stepwise import Search
from smsid.report.heat import correlation_map
from smsid.report.model import Figure

COMPARED = 14


def rescore(search: Search) -> tuple[Score, ...]:
    """Return every candidate's score on the nominal fit, the most informative first.

    The search keeps those of its last round only, with the causes in the model already.
    """
    candidates: dict[tuple[str, str, str], Candidate] = {}
    for s in (*(c.score for c in search.causes), *search.scores):
        candidates.setdefault(s.candidate.key, s.candidate)
    if not search.causes:
        found: Sequence[Score] = search.scores
    else:
        known = list(candidates.values())
        columns = signatures(search.nominal, known)
        found = scored(search.nominal, [known[i] for i in columns], list(columns.values()))
    return tuple(sorted(found, key=lambda s: -s.information_gain(search.samples)))


def alias_matrix(search: Search, scores: Sequence[Score]) -> Figure | None:
    """Return the correlations of the strongest candidates' signatures, nominal parameters projected out."""
    wanted = {c.score.candidate.key for c in search.causes}
    wanted |= {a.candidate.key for c in search.causes for a, _ in c.aliases}
    usable = [s for s in scores if s.freedom]
    chosen = [s for s in usable if s.candidate.key in wanted]
    chosen += [s for s in usable if s.candidate.key not in wanted][: COMPARED - len(chosen)]
    chosen = sorted(chosen[:COMPARED], key=lambda s: -s.ratio)
    if len(chosen) < 2:
        return None
    n = len(chosen)
    values = np.ones((n, n))
    for i in range(n):
        for j in range(i):
            values[i, j] = values[j, i] = correlation(chosen[i], chosen[j])
    names = [label(s.candidate) for s in chosen]
    body = correlation_map(
        names, names, values, "correlations of the candidates' signatures in this experiment"
    )
    caption = (
        "Largest canonical correlation of two candidates' signatures, nominal parameters projected out. Near "
        "one, this experiment cannot tell the two apart."
    )
    return Figure("alias-matrix", "Alias matrix", body, caption)


def label(c: Candidate) -> str:
    """Return a candidate in words."""
    return f"{c.shape.replace('_', ' ')} at {c.location}"
