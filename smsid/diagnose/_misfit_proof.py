"""What is asked in noise as stated while misfit is counted: raised noise hides it.

Noise that is raised to what a cause leaves bounds what that cause can prove. That the model follows to the
noise as stated with it, and does not without, proves more.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from smsid.diagnose._cause_in_motion import with_dynamics
from smsid.diagnose._noise_covariance import InflatedFit, fit_to_stated_noise, normalised_rmse
from smsid.diagnose.model_comparison import Cause, own_component, with_further
from smsid.diagnose.score_test import Candidate, Score
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.estimation.map_estimate import MapFit, evaluate


def is_hopeful(fitted: InflatedFit, s: Score) -> bool:
    """Whether a candidate takes most of the errors away, in stated noise, where misfit is counted."""
    if not (fitted.misfit and s.freedom and s.ratio > 0.0):
        return False
    return fitted.explained(np.asarray(s.columns), s.estimate) > THRESHOLDS.hopeful * fitted.left


def follows(fitted: InflatedFit, found: MapFit) -> bool:
    """Whether a fit in the noise levels of another goes on to the noise as stated."""
    exact = replace(fitted, fit=found).stated
    return fit_to_stated_noise(found.point, found.unknowns, exact) is not None


def with_what_it_lacks(fitted: InflatedFit, cause: Cause, found: MapFit) -> MapFit:
    """Return a fit with a cause in motion or its further parameters free, if that explains what counts as
    misfit: beside that, they would not pay.
    """
    candidate = cause.score.candidate
    if candidate.effect is None:
        return found
    rest = evaluate(found.point, found.unknowns, replace(fitted, fit=found).stated)
    least, more = THRESHOLDS.misfit, rest
    if candidate.instance(found.point).with_dynamics():
        more = with_dynamics(rest, candidate)
    if more is rest and _is_left_where_it_acts(fitted, candidate, rest):
        least, more = THRESHOLDS.followed, with_further(rest, [cause]) or rest
    if more is rest or normalised_rmse(more.run) > least:
        return found
    problem = replace(found.problem, substep=more.problem.substep)  # the noise is found again from here
    return evaluate(more.point, more.unknowns, problem)


def _is_left_where_it_acts(fitted: InflatedFit, candidate: Candidate, rest: MapFit) -> bool:
    """Whether most that a fit to stated noise leaves beyond that is in the component that a candidate changes
    most.
    """
    own = own_component(rest, candidate, np.ones_like(fitted.factors))
    left = np.where(rest.run.used, rest.run.normalised**2 - 1.0, 0.0).sum(axis=0)
    return bool(2.0 * left[own] > left.sum())
