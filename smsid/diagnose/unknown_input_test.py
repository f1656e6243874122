"""Erratic inputs: does noise on one of them explain what is left, where no law of angle, rate or time does?

The disturbances that a smoother finds say which inputs are in doubt; then the nominal parameters are fitted
again with noise on one of these at a time, and the likelihoods compare them. Without that refit they have
bent to the noise, and a neighbour of the noisy joint looks as noisy.

Source of the smoother: de Jong and Penzer, J. Am. Stat. Assoc. 93 (1998) 796 (disturbances), after Bryson and
Frazier.
"""

from __future__ import annotations

import logging
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from smsid.diagnose.specification_tests import SpecificationTest, equations_of
from smsid.errors import SmsidError
from smsid.estimation.filter_run import FilterRun
from smsid.estimation.map_estimate import Fit, continued, fit
from smsid.estimation.problem import Problem

LOGGER = logging.getLogger(__name__)
CHANCE = "chance"
DOUBTED = 3  # inputs that are tried
LOUD = 30.0  # variance of the noise tried, over that to which one sample of the input is known by itself
NEAR = 3.0  # gain of the log-posterior below which a fit is near enough for a likelihood


def unknown_input_tests(found: Fit) -> list[SpecificationTest]:
    """Return the test for noise of the inputs most in doubt, the most significant first.

    ``found`` is the fit of the nominal parameters. The ratio of each is what noise on it gains, with the
    parameters fitted again.
    """
    inputs = [e for e in equations_of(found) if e.driven]
    rest = continued(found, iterations=4, enough=NEAR).objective
    index = [e.v[0] for e in inputs]
    slope, known = disturbances(found.run)
    doubt = (slope[:, index] ** 2).sum(axis=0) / np.maximum(known[:, index].sum(axis=0), 1e-300)
    tests = []
    for i in np.argsort(-doubt)[:DOUBTED]:
        name, dof = inputs[i].name, index[i]
        problem = with_unknown(found.problem, found.run, [dof])
        try:
            noisy = fit(found.point, found.unknowns, problem, iterations=4, enough=NEAR)
        except (SmsidError, np.linalg.LinAlgError) as error:
            LOGGER.info("noise of %s is not tried: %s", name, error)
            continue
        ratio = max(0.0, 2.0 * (rest - noisy.objective))
        tests.append(SpecificationTest(name, CHANCE, ratio, 1, len(inputs), inputs[i].location))
    return sorted(tests, key=lambda b: b.order)


def with_unknown(
    problem: Problem, run: FilterRun, dofs: Sequence[int], lost: Collection[str] = (), *, held: int = 1
) -> Problem:
    """Return a problem with noise on inputs that hides what a run tells of them (`LOUD`), and without the
    readings of channels or components ``lost``.

    Noise is white: of an input that is wrong in one way for so many samples, ``held``, more is needed.
    """
    data, (_, known) = problem.data, disturbances(run)
    loud = tuple((d, float(np.sqrt(held * LOUD / max(float(known[:, d].mean()), 1e-300)))) for d in dofs)
    out = np.zeros(data.values.shape, dtype=bool)
    for block in data.blocks:
        out[:, block.rows] = [block.channel in lost or name in lost for name in block.names]
    out[list(run.begins)] = False  # where the filter begins is read from there
    noise = replace(problem.noise, more=(*problem.noise.more, *loud))
    return replace(problem, data=data.without(out), noise=noise)


def disturbances(run: FilterRun) -> tuple[np.ndarray, np.ndarray]:
    """Return the slope of the log-likelihood by a generalised force held over an interval, and its variance
    where nothing disturbs: (N - 1, nv) each.
    """
    n, nv = len(run.innovations), run.middle_inverse.shape[1]
    slope, known = np.zeros((2, n - 1, nv))
    by_state, information = np.zeros(2 * nv), np.zeros((2 * nv, 2 * nv))
    one = np.eye(2 * nv)
    for k in range(n - 1, 0, -1):
        white = run.whitening[k] @ run.sensitivity[k]
        kept = one - run.gain[k] @ run.sensitivity[k]
        by_state = kept.T @ by_state + white.T @ run.innovations[k]
        information = kept.T @ information @ kept + white.T @ white
        by_force = run.forcing[k - 1] @ run.middle_inverse[k - 1]
        slope[k - 1] = by_force.T @ by_state
        known[k - 1] = np.einsum("ij,ij->j", by_force, information @ by_force)
        f = run.transition[k - 1]
        by_state, information = f.T @ by_state, f.T @ information @ f
    return slope, known
