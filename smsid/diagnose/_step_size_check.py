"""Steps of the integration as short as a fit's motion needs."""

from __future__ import annotations

import logging
from collections.abc import Callable

import numpy as np

from smsid.diagnose.thresholds import THRESHOLDS
from smsid.errors import SmsidError
from smsid.estimation.joint_problem import at_point
from smsid.estimation.kalman import run_filter
from smsid.estimation.map_estimate import MapFit, fit
from smsid.estimation.parameter_vector import Point
from smsid.estimation.problem import Problem
from smsid.estimation.step_size import with_half_the_step

LOGGER = logging.getLogger(__name__)
SEEN = THRESHOLDS.steps_seen
FINER = 3  # times that the steps are halved


def refine_steps(found: MapFit, again: Callable[[Point, Problem], MapFit] | None = None) -> MapFit:
    """Return a fit with steps as short as its motion needs, or the same where they are short enough.

    A strong cause may make an arm swing far faster than anybody has reckoned with, and strong friction is
    stiff. ``again`` fits with shorter steps from where the last fit was, if not the same parameters.
    """
    for _ in range(FINER):
        try:
            size = discretisation_chi2(found)
            if not size > SEEN:
                break
            problem = with_half_the_step(found.problem)
            LOGGER.info(
                "errors of integration of %.1f in chi-squared: steps of %.4g s", size, problem.substep
            )
            found = (
                again(found.point, problem)
                if again
                else fit(found.point, found.unknowns, problem, iterations=8)
            )
        except (SmsidError, np.linalg.LinAlgError) as error:
            LOGGER.info("no shorter steps: %s", error)
            break
    return found


def discretisation_chi2(found: MapFit) -> float:
    """Return what errors of integration add to the sum of squares of innovations, beside the parameters.

    By the difference to the innovations of a filter with steps of half the length.
    """
    coarse = found.changes  # where the filter ran: the last step of a fit is not filtered again
    finer = at_point(coarse.point, with_half_the_step(found.problem))
    fine = run_filter(coarse.point.model(), finer)
    left = found.left((fine.innovations - coarse.run.innovations).reshape(-1, 1))
    return float(np.vdot(left, left))
