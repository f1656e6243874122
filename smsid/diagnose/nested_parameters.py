"""What a cause has further is freed before another cause is named for what it does."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np

from smsid.diagnose.model_comparison import Cause, DetectionThresholds, unfitted_parameters
from smsid.diagnose.score_test import Score, odds
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.errors import SmsidError
from smsid.estimation.map_estimate import Fit, fit, within_reach

LOGGER = logging.getLogger(__name__)
CURVED = THRESHOLDS.curved


def free_nested_before_adding(
    current: Fit, causes: Sequence[Cause], best: Score, levels: DetectionThresholds
) -> Fit | None:
    """Return a fit with further parameters of a cause free, unless the next candidate is clearly likelier.

    A payload whose centre of mass is not in the tool's frame leaves what another link's inertia would; freed
    when it was found, its place may not have paid for itself. Weighed by their odds alike, what is there
    already comes first.
    """
    return free_nested(current, causes, best.odds(current.run.samples) - levels.alias)


def free_nested(current: Fit, causes: Sequence[Cause], least: float = 0.0) -> Fit | None:
    """Return the fit with those further parameters of a cause free that have most odds, if more than nothing
    and than ``least``.
    """
    samples, found, most = current.run.samples, None, max(least, 0.0)
    for cause in causes:
        more = unfitted_parameters(current, cause.score.candidate)
        if not more:
            continue
        try:
            promised = 2.0 * (within_reach(current) - within_reach(current.with_unfitted(more)))
            if odds(CURVED * promised, len(more), samples) < most:
                continue
            larger = fit(current.point, (*current.unknowns, *more), current.problem, iterations=20)
        except (SmsidError, np.linalg.LinAlgError) as error:
            LOGGER.info("%s: nothing further: %s", cause.score.candidate.key, error)
            continue
        gained = odds(2.0 * (current.objective - larger.objective), len(more), samples)
        LOGGER.info("%s: %s free: odds %.1f", cause.score.candidate.key, [u.name for u in more], gained)
        if gained > most:
            found, most = larger, gained
    return found
