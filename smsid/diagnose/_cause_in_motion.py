"""Causes that bring something along which moves by itself: fitted at rest first, in motion if that lacks."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from smsid.diagnose._noise_covariance import normalised_rmse
from smsid.diagnose.model_comparison import Cause, unfitted_parameters
from smsid.diagnose.score_test import Candidate
from smsid.diagnose.specification_tests import SpecificationTest
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.errors import SmsidError
from smsid.estimation.map_estimate import MapFit, fit
from smsid.estimation.parameter_vector import Point

LOGGER = logging.getLogger(__name__)
STEPS_OF_OTHERS, STEPS_IN_MOTION = 8, 25  # of the fits of an effect that moves by itself


def with_dynamics(found: MapFit, candidate: Candidate, nominal: Point | None = None) -> MapFit:
    """Return the fit with a candidate's effect in motion where it was taken at rest, if that fits better.

    It starts from the fit's point or, where that has gone far to make up for the motion, the ``nominal``.
    What moves tells of itself only where the rest follows, so that this is fitted first.
    """
    best, effect = found, None if candidate.effect is None else candidate.instance(found.point)
    own = set(candidate.free)
    others = [u for u in found.unknowns if u.name not in own]
    for moving, step in () if effect is None else effect.with_dynamics():
        problem = replace(found.problem, substep=min(found.problem.substep, step))
        try:
            point = (nominal or found.point).with_effect(moving, candidate.recording)
            begun = fit(point, others, problem, iterations=STEPS_OF_OTHERS)
            mine = [u for u in found.unknowns if u.name in own]
            mine += unfitted_parameters(begun.with_unfitted(mine), candidate)
            further = fit(begun.point, (*others, *mine), problem, iterations=STEPS_IN_MOTION)
        except (SmsidError, np.linalg.LinAlgError) as error:
            LOGGER.info("%s does not move in steps of %.2g s: %s", candidate.key, step, error)
            continue
        LOGGER.info("%s in motion: %.1f, was %.1f", candidate.key, further.objective, best.objective)
        best = min(best, further, key=lambda f: f.objective)
        if best is further and normalised_rmse(best.run) <= THRESHOLDS.noise_left:
            break
    return best


def in_motion(last: MapFit, causes: Sequence[Cause], left: Sequence[SpecificationTest]) -> MapFit | None:
    """Return the fit with what a cause brings along in motion, where tests of what is ``left`` say that it
    does not follow at once: of the first for which its further parameters pay, else none.
    """
    for own in (c.score.candidate for c in causes):
        if own.effect is None or not any(t.location == own.location for t in left):
            continue
        found = with_dynamics(last, own)
        price = (len(found.unknowns) - len(last.unknowns)) * float(np.log(last.run.samples))
        if found is not last and 2.0 * (last.objective - found.objective) > price:
            return found
    return None
