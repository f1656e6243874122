"""Does the filter integrate finely enough for the motion it predicts? If not, its errors pass for causes."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from smsid.diagnose.thresholds import THRESHOLDS
from smsid.errors import SmsidError
from smsid.estimation.joint_problem import at_point
from smsid.estimation.kalman import run_filter
from smsid.estimation.map_estimate import Fit, fit
from smsid.estimation.problem import Problem

LOGGER = logging.getLogger(__name__)
SEEN = THRESHOLDS.steps_seen
FINER = 3  # times that the steps are halved


def finely_stepped(found: Fit) -> Fit:
    """Return a fit with steps as short as its motion needs, or the same where they are short enough.

    A strong cause may make an arm swing far faster than anybody has reckoned with.
    """
    for _ in range(FINER):
        try:
            size = discretisation_chi2(found)
            if not size > SEEN:
                break
            problem = _with_half_the_step(found)
            LOGGER.info(
                "errors of integration of %.1f in chi-squared: steps of %.4g s", size, problem.substep
            )
            found = fit(found.point, found.unknowns, problem, iterations=8)
        except (SmsidError, np.linalg.LinAlgError) as error:
            LOGGER.info("no shorter steps: %s", error)
            break
    return found


def discretisation_chi2(found: Fit) -> float:
    """Return what errors of integration add to the sum of squares of innovations, beside the parameters.

    By the difference to the innovations of a filter with steps of half the length.
    """
    model = found.point.model()
    coarse, fine = (
        run_filter(model, at_point(found.point, problem)).innovations
        for problem in (found.problem, _with_half_the_step(found))
    )
    left = found.left((fine - coarse).reshape(-1, 1))
    return float(np.vdot(left, left))


def _with_half_the_step(found: Fit) -> Problem:
    """Return the problem with half the step that is taken: an even number of them fills a sample."""
    taken = float(np.median(np.diff(found.run.states.time))) / found.changes.applied.means.shape[1]
    return replace(found.problem, substep=0.5 * taken)
