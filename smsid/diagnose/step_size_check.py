"""Does the filter integrate finely enough for the motion it predicts? If not, its errors pass for causes."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import pinocchio as pin

from smsid.diagnose.thresholds import THRESHOLDS
from smsid.errors import SmsidError
from smsid.estimation.filter_pass import Applied
from smsid.estimation.joint_problem import JointSensitivities
from smsid.estimation.kalman import applied
from smsid.estimation.map_estimate import Fit, fit
from smsid.estimation.process_model import ProcessModel
from smsid.estimation.sensitivities import Sensitivities
from smsid.simulate.trajectory import States

LOGGER = logging.getLogger(__name__)
SEEN = THRESHOLDS.steps_seen
FINER = 3  # times that the steps are halved


def finely_stepped(found: Fit) -> Fit:
    """Return a fit with steps as short as its motion needs, or the same where they are short enough.

    A strong cause may make an arm swing far faster than anybody has reckoned with.
    """
    for _ in range(FINER):
        size = discretisation_chi2(found)
        if not size > SEEN:
            break
        problem = replace(found.problem, substep=0.5 * _substep(found.changes))
        LOGGER.info("errors of integration of %.1f in chi-squared: steps of %.4g s", size, problem.substep)
        try:
            found = fit(found.point, found.unknowns, problem, iterations=8)
        except (SmsidError, np.linalg.LinAlgError) as error:
            LOGGER.info("no shorter steps: %s", error)
            break
    return found


def discretisation_chi2(found: Fit) -> float:
    """Return what errors of integration add to the sum of squares of innovations, beside the parameters.

    By the difference to steps of half the length, taken through the filter as it ran.
    """
    changes = found.changes
    each = changes.each if isinstance(changes, JointSensitivities) else (changes,)
    shift = np.concatenate([_shift(s) for s in each])
    left = found.left(shift.reshape(-1, 1))
    return float(np.vdot(left, left))


def _shift(changes: Sensitivities) -> np.ndarray:
    """Return the same in the innovations (N, rows) of one recording."""
    run, model, problem = changes.run, changes.model, changes.problem
    plant = ProcessModel(model, problem.locked)
    coarse = changes.applied
    fine = applied(plant, replace(problem, substep=0.5 * _substep(changes)), changes.inputs)
    shift = np.empty_like(run.innovations)
    delta = np.zeros(2 * model.nv)
    for k in range(len(shift)):
        predicted = run.sensitivity[k] @ delta
        shift[k] = run.whitening[k] @ predicted
        if k == len(shift) - 1:
            break
        far, near = (_stepped(plant, run.states, drive, k) for drive in (coarse, fine))
        error = np.concatenate([pin.difference(model.pin, far[0], near[0]), near[1] - far[1]])
        delta = run.transition[k] @ (delta - run.gain[k] @ predicted) + error
    return shift


def _substep(changes: Sensitivities) -> float:
    """Return the step that is taken [s]: an even number of them fills the time between samples."""
    return float(np.median(np.diff(changes.run.states.time))) / changes.applied.means.shape[1]


def _stepped(plant: ProcessModel, states: States, drive: Applied, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Return q and v a sample on from the prediction at sample k."""
    q, v, t = states.q[k], states.v[k], float(states.time[k])
    substeps = drive.means.shape[1]
    h = float(states.time[k + 1] - t) / substeps
    for s in range(substeps):
        q, v = plant.step(t + s * h, h, q, v, drive.means[k, s], drive.rise[k, s])
    return q, v
