"""Scores of candidates along a motion, with signatures of another one where they do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from smsid.diagnose._one_recording import in_one_recording
from smsid.diagnose.score_test import Candidate, Score, score_candidates, signatures
from smsid.estimation.filter_run import FilterRun
from smsid.estimation.innovations import squared_distance
from smsid.estimation.map_estimate import MapFit

REFUSED = 0.05  # chance, uncorrected, above which a signature of a motion near by needs no better one
APART = 100.0  # times what the motion changed, that has to be left of it: a tenth of its size is off then


class CandidateScores:
    """What scores candidates, with the signatures that are known: whitened ``columns`` (N rows, d) by key.

    ``alone`` are the odds that a candidate in one of several recordings alone gains beyond its search.
    """

    def __init__(self, alone: float) -> None:
        self.alone = alone
        self.columns: dict[tuple[str, str, str], np.ndarray] = {}

    def score(self, found: MapFit, candidates: Sequence[Candidate], *, coarsely: bool = False) -> list[Score]:
        """Return the scores of candidates on a fit; signatures already known are used again.

        ``coarsely``: nothing is looked for more finely where there is something.
        """
        missing = [c for c in candidates if c.key not in self.columns]
        if missing:
            known = signatures(found, missing)
            self.columns.update({missing[i].key: columns for i, columns in known.items()})
        seen = [c for c in candidates if c.key in self.columns]
        scores = score_candidates(found, seen, [self.columns[c.key] for c in seen], coarsely=coarsely)
        return in_one_recording(found, scores, self.columns, self.alone)

    def score_again(self, found: MapFit, candidates: Sequence[Candidate], before: FilterRun) -> list[Score]:
        """Return the scores along another motion than one ``before``, with signatures of that where they do.

        They do where they explain nothing and are so far apart from what is fitted that what the motion
        changes is small beside what is left of them: of a payload beside its link's mass it is not.
        """
        least = APART * squared_distance(before, found.run) if self.columns else np.inf
        known = self.score(found, candidates, coarsely=True) if least < 1.0 else ()  # none is excited by more
        refused = [s for s in known if s.p_value > REFUSED and s.excited > least]
        keys = {s.candidate.key for s in refused}
        self.columns = {key: own for key, own in self.columns.items() if key in keys}
        return [*self.score(found, [c for c in candidates if c.key not in keys]), *refused]
