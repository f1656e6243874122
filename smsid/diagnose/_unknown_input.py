"""Inputs that are taken as unknown: noise on the equation of a joint or wheel, as loud as hides it or as is
likeliest, and whether one of them alone explains more than causes do.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid.diagnose.specification_tests import PAST, Equation, SpecificationTest, adequacy, equations_of
from smsid.diagnose.thresholds import THRESHOLDS, DetectionThresholds
from smsid.errors import SmsidError
from smsid.estimation.filter_run import FilterRun
from smsid.estimation.joint_problem import at_point
from smsid.estimation.kalman import run_filter
from smsid.estimation.map_estimate import MapFit, continue_fit, fit
from smsid.estimation.problem import Problem

LOGGER = logging.getLogger(__name__)
CHANCE = "chance"
DOUBTED = 3  # inputs that are tried
NEAR = 3.0  # gain of the log-posterior below which a fit is near enough for a likelihood
NOISE_STEP = 10.0**0.5  # between noises of unknown inputs that are compared
QUIETEST_INPUT = 1e-6  # of the noise that hides them


def unknown_input_tests(found: MapFit) -> list[SpecificationTest]:
    """Return the test for noise of the inputs most in doubt, the most significant first.

    ``found`` is the fit of the nominal parameters. The ratio of each is what noise on it gains, with the
    parameters fitted again: else they have bent to it, and a neighbour of the noisy joint looks as noisy.
    """
    rest, tests = continue_fit(found, iterations=4, enough=NEAR).objective, []
    inputs = _in_doubt(found)
    for e in inputs[:DOUBTED]:
        noisy = _with_noise_on(found, e)
        if noisy is not None:
            ratio = max(0.0, 2.0 * (rest - noisy.objective))
            tests.append(SpecificationTest(e.name, CHANCE, ratio, 1, len(inputs), e.location))
    return sorted(tests, key=lambda b: b.order)


@dataclass(frozen=True)
class UnknownInput:
    """An input that is unknown: the test for its noise beside the nominal parameters, and minus the
    log-posterior with that as loud as is likeliest.
    """

    test: SpecificationTest
    objective: float

    def explains_more(self, found: MapFit, levels: DetectionThresholds) -> bool:
        """Return whether it explains more than a fit with causes does, even where that comes to rest."""
        if 2.0 * (found.objective - self.objective) < levels.alias:
            return False
        rest = continue_fit(found, iterations=4, enough=NEAR).objective
        return 2.0 * (rest - self.objective) >= levels.alias


def one_unknown_input(nominal: MapFit, found: MapFit, levels: DetectionThresholds) -> UnknownInput | None:
    """Return the one input that alone, if it is unknown, explains more than the causes of ``found`` do
    together, and leaves nothing beside the ``nominal`` parameters; nothing if there is none.

    Both in the problem of ``found``: that of the nominal fit may have louder noise, and longer steps.
    """
    try:
        if nominal.problem is not found.problem:
            nominal = fit(nominal.point, nominal.unknowns, found.problem, iterations=4, enough=NEAR)
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("no torque is asked without causes: %s", error)
        return None
    inputs = _in_doubt(nominal)
    for e in inputs[:DOUBTED]:
        loud = _with_noise_on(nominal, e)
        if loud is None:
            continue
        try:
            likeliest = fit_noise_of_unknown_inputs(loud)
            ratio = 2.0 * (nominal.objective - likeliest.objective)
            test = SpecificationTest(e.name, CHANCE, ratio, 1, len(inputs), e.location)
            one = UnknownInput(test, likeliest.objective)
            if not one.explains_more(found, levels):
                continue
            tests = [t for t in adequacy(loud) if t.dependence != PAST]  # a symptom, of noise not white
        except (SmsidError, np.linalg.LinAlgError) as error:
            LOGGER.info("noise of %s is not judged: %s", e.name, error)
            continue
        if not any(t.p_value * len(tests) < levels.block for t in tests):
            return one
    return None


def _in_doubt(found: MapFit) -> list[Equation]:
    """Return the equations that commands act in, the one first that its innovations put most in doubt."""
    inputs = [e for e in equations_of(found) if e.driven]
    slope, known = disturbances(found.run)
    index = [e.v[0] for e in inputs]
    doubt = (slope[:, index] ** 2).sum(axis=0) / np.maximum(known[:, index].sum(axis=0), 1e-300)
    return [inputs[i] for i in np.argsort(-doubt)]


def _with_noise_on(found: MapFit, equation: Equation) -> MapFit | None:
    problem = with_unknown(found.problem, run=found.run, dofs=[equation.v[0]])
    try:
        return fit(found.point, found.unknowns, problem, iterations=4, enough=NEAR)
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("noise of %s is not tried: %s", equation.name, error)
        return None


def with_unknown(
    problem: Problem, *lost: str, run: FilterRun | None = None, dofs: Sequence[int] = (), held: int = 1
) -> Problem:
    """Return a problem without the readings of channels or components ``lost``, and with noise on the inputs
    ``dofs`` that hides what a run tells of them (`THRESHOLDS.hidden`).

    Noise is white: of an input that is wrong in one way for so many samples, ``held``, more is needed.
    """
    data, noise = problem.data, problem.noise
    if run is not None:
        _, known = disturbances(run)
        loud = tuple(
            (d, float(np.sqrt(held * THRESHOLDS.hidden / max(float(known[:, d].mean()), 1e-300))))
            for d in dofs
        )
        noise = replace(noise, more=(*noise.more, *loud))
    out = np.zeros(data.values.shape, dtype=bool)
    for block in data.blocks:
        out[:, block.rows] = [block.channel in lost or name in lost for name in block.names]
        if not block.quantity.endswith(("rate", "velocity")):  # where the filter begins is read from there
            out[[p.first for p in problem.parts] or [0], block.rows] = False
    return replace(problem, data=data.without(out), noise=noise)


def disturbances(run: FilterRun) -> tuple[np.ndarray, np.ndarray]:
    """Return the slope of the log-likelihood by a generalised force held over an interval, and its variance
    where nothing disturbs: (N - 1, nv) each.

    Source: de Jong and Penzer, J. Am. Stat. Assoc. 93 (1998) 796, after Bryson and Frazier.
    """
    n, nv = len(run.innovations), run.middle_inverse.shape[1]
    slope, known = np.zeros((2, n - 1, nv))
    one = np.eye(run.gain.shape[1])  # biases that wander are states, too
    by_state, information = np.zeros(len(one)), np.zeros_like(one)
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


def fit_noise_of_unknown_inputs(found: MapFit) -> MapFit:
    """Return a fit with the noise of its unknown inputs, all together, as large as is likeliest.

    To hide what is unknown it is louder than that; standard deviations of what goes with it would be as much
    too large. They are at least those that slow errors make.
    """
    loud = found.problem.noise
    if not loud.more:
        return found

    def quieter(by: float) -> Problem:
        more = tuple((dof, by * size) for dof, size in loud.more)
        return replace(found.problem, noise=replace(loud, more=more), coloured=True)

    try:
        best, by = found.run.log_likelihood, 1.0
        model = found.point.model()
        while by > QUIETEST_INPUT:
            tried = run_filter(model, at_point(found.point, quieter(by / NOISE_STEP))).log_likelihood
            if tried <= best:
                break
            best, by = tried, by / NOISE_STEP
        if by == 1.0:
            return found
        LOGGER.info("unknown inputs are likeliest %.3g times as loud", by)
        return fit(found.point, found.unknowns, quieter(by), iterations=6)
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("unknown inputs stay as loud as they are: %s", error)
        return found
