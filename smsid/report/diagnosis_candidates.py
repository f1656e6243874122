"""Candidates of a diagnosis: how much each explains alone, and which this experiment cannot tell apart."""

from __future__ import annotations

from collections.abc import Sequence

from smsid.diagnose.score_test import Candidate, Score, correlation, scored, signatures
from smsid.diagnose.stepwise import Search
from smsid.report.heat import HeatCell, HeatMap, step_of
from smsid.report.model import Figure

SHOWN, COMPARED = 24, 14
EDGES = (0.1, 0.3, 0.5, 0.7, 0.8, 0.9, 0.97)
TOLD_APART = 0.9


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


def threshold(search: Search) -> float:
    """Return the likelihood ratio of one degree of freedom that is significant over all candidates."""
    from scipy.stats import chi2

    return float(chi2.isf(search.levels.candidate / max(search.candidates, 1), 1))


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
    values = [[1.0] * n for _ in range(n)]
    for i in range(n):
        for j in range(i):
            values[i][j] = values[j][i] = correlation(chosen[i], chosen[j])
    cells = tuple(
        tuple(
            HeatCell(
                0 if i == j else step_of(values[i][j], EDGES),
                "1" if i == j else f"{values[i][j]:.2f}",
                f"{label(chosen[i].candidate)} and {label(chosen[j].candidate)}: {values[i][j]:.3f}",
                i != j and values[i][j] >= TOLD_APART,
            )
            for j in range(n)
        )
        for i in range(n)
    )
    body = HeatMap(
        tuple(f"{label(s.candidate)}  {i}" for i, s in enumerate(chosen, 1)),
        tuple(str(i) for i in range(1, n + 1)),
        cells,
        "correlations of the candidates' signatures in this experiment",
        ((0, "below 0.1"), (3, "0.5"), (5, "0.8"), (6, "0.9"), (7, "0.97"), (-1, "0.9 and above")),
        square=True,
    )
    caption = (
        "Largest canonical correlation of two candidates' signatures, nominal parameters projected out. Near "
        "one, this experiment cannot tell the two apart."
    )
    return Figure("alias-matrix", "Alias matrix", body, caption)


def label(c: Candidate) -> str:
    """Return a candidate in words."""
    return f"{c.shape.replace('_', ' ')} at {c.location}"
