"""One cause in the place of two whose work it does."""

from __future__ import annotations

import logging
from collections.abc import Collection, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from smsid.diagnose._wald_test import chance_of_nothing
from smsid.diagnose._without_cause import columns_by_key, residual_squares, rivals_beside, without_cause
from smsid.diagnose.model_comparison import Cause, cost, refit
from smsid.diagnose.score_test import Candidate, score_candidates, signatures
from smsid.diagnose.specification_tests import open_joints
from smsid.diagnose.thresholds import DetectionThresholds
from smsid.errors import SmsidError
from smsid.estimation.map_estimate import MapFit

LOGGER = logging.getLogger(__name__)


def merge_step(
    causes: Sequence[Cause],
    last: MapFit,
    nominal: MapFit,
    candidates: Sequence[Candidate],
    levels: DetectionThresholds,
    settled: Collection[tuple[str, str, str]] = (),
) -> tuple[list[Cause], MapFit]:
    """Return the causes, with one in the place of two that explains what both do (by Bayes's criterion,
    refitted) and beside which nothing of them is left, and the fit.

    The first of two that a third cause joins may be its alias: motors of two joints, of gains alike, are that
    of the third joint, of the other sign, where all inertias may scale.
    """
    samples, columns = last.run.samples, dict[tuple[str, str, str], np.ndarray]()
    taken = {c.score.candidate.key for c in causes}
    for pair in combinations([c for c in causes if c.score.candidate.key not in settled], 2):
        less = last
        try:
            for cause in pair:
                less = without_cause(less, cause.score.candidate, nominal)
        except (SmsidError, np.linalg.LinAlgError) as error:
            LOGGER.info("%s are not taken out: %s", [c.score.candidate.key for c in pair], error)
            continue
        if less.point.model().nv != last.changes.model.nv:  # how one moves itself is not of first order
            continue
        columns = columns or columns_by_key(last, candidates)
        others = [c for c in causes if not any(c is x for x in pair)]
        beside = [c for c in rivals_beside(candidates, others) if c.location not in open_joints(last)]
        rivals = [c for c in beside if c.key in columns and c.key not in taken]
        scores = score_candidates(less, rivals, [columns[c.key] for c in rivals])
        best = max((s for s in scores if s.freedom), key=lambda s: s.information_gain(samples), default=None)
        explained = residual_squares(less) - residual_squares(last)
        spared = sum(cost(less, c.score, last) for c in pair)
        if best is None or best.information_gain(samples) - explained + spared < levels.alias:
            continue
        found = refit(less, best, last.objective + 0.5 * (spared - levels.alias))
        if found is None or chance_of_nothing(found, best.candidate, less) > levels.candidate:  # it ran away
            continue
        gained = 2.0 * (last.objective - found.objective)
        names = [c.score.candidate.key for c in pair]
        LOGGER.info("%s for both of %s: gains %.1f", best.candidate.key, names, gained)
        if gained + spared - cost(less, best, found) < levels.alias or _is_left(
            found, pair, levels, len(candidates)
        ):
            continue
        one = Cause(replace(best, ratio=explained + gained).with_own_columns(), (), explained + gained)
        return [one, *others], found
    return list(causes), last


def _is_left(found: MapFit, causes: Sequence[Cause], levels: DetectionThresholds, tried: int) -> bool:
    """Whether something of causes is left in a fit without them."""
    own = [c.score.candidate for c in causes]
    columns = signatures(found, own)
    scores = score_candidates(found, [own[i] for i in columns], list(columns.values()))
    return any(s.p_value * tried < levels.candidate for s in scores)
