"""Noise on an input: the smoother against the forward derivatives, and that the noisy joint is named."""

from dataclasses import replace

import numpy as np
import pytest

from smsid.diagnose._unknown_input import (
    CHANCE,
    UnknownInput,
    disturbances,
    fit_noise_of_unknown_inputs,
    one_unknown_input,
    unknown_input_tests,
    with_unknown,
)
from smsid.diagnose.specification_tests import SpecificationTest
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.estimation.map_estimate import evaluate, fit
from smsid.estimation.sensitivities import Sensitivity, propagate


@pytest.fixture(scope="module")
def found(known, problem):
    return evaluate(known.point, known.unknowns, problem)


def test_the_smoother_agrees_with_forces_propagated_one_by_one(found):
    run = found.run
    slope, known = disturbances(run)
    for k in (0, 31, len(slope) - 1):
        for dof in (1, 4, int(found.changes.model.arm_joints.v[2])):
            middle = np.zeros(len(slope))
            middle[k] = 1.0
            column = propagate(run, [Sensitivity.on(dof, middle, np.zeros(len(slope) + 1))])[:, :, 0]
            assert slope[k, dof] == pytest.approx((column * run.innovations).sum(), rel=1e-6)
            assert known[k, dof] == pytest.approx((column**2).sum(), rel=1e-6)


@pytest.mark.parametrize("joint", ["joint1", "joint3"])
def test_the_noisy_joint_is_named(known, problem, recording, joint):
    """What was commanded is told with an error that the joint did not get."""
    model = known.point.base
    column = list(model.arm_joints.names).index(joint)
    told = np.array(recording["command.joint_torque"])
    told[:, column] += 0.2 * np.random.default_rng(5).standard_normal(len(told))
    noisy = replace(problem, recording=recording.with_channels({"command.joint_torque": told}))
    tests = unknown_input_tests(fit(known.point, known.unknowns, noisy, iterations=3))
    assert tests[0].where == f"torque of {joint}"
    assert tests[0].dependence == CHANCE
    assert tests[0].p_value < 1e-6
    assert tests[0].ratio > 1.02 * tests[1].ratio


def test_noise_of_unknown_inputs_is_told_by_its_likelihood(known, problem, recording):
    """Noise that hides a joint's torque is far louder than what is wrong with it; so were intervals."""
    model = known.point.base
    column = list(model.arm_joints.names).index("joint2")
    told, size = np.array(recording["command.joint_torque"]), 0.05
    told[:, column] += size * np.random.default_rng(5).standard_normal(len(told))
    noisy = replace(problem, recording=recording.with_channels({"command.joint_torque": told}))
    found = fit(known.point, known.unknowns, noisy, iterations=3)
    dof = int(model.arm_joints.v[column])
    hidden = with_unknown(noisy, run=found.run, dofs=[dof], held=len(noisy.data.times))
    loud = fit(found.point, known.unknowns, hidden, iterations=3)
    quiet = fit_noise_of_unknown_inputs(loud)
    ((_, before),), ((own, after),) = loud.problem.noise.more, quiet.problem.noise.more
    assert own == dof and before > 30.0 * size
    assert 0.5 * size < after < 2.0 * size
    assert fit_noise_of_unknown_inputs(found) is found  # nothing is unknown


@pytest.fixture(scope="module")
def noisy(known, problem, recording):
    """What was commanded of joint2 is told with an error: the nominal fit of that."""
    told = np.array(recording["command.joint_torque"])
    told[:, 1] += 0.05 * np.random.default_rng(5).standard_normal(len(told))
    told = replace(problem, recording=recording.with_channels({"command.joint_torque": told}))
    return fit(known.point, known.unknowns, told, iterations=10)


def test_one_unknown_torque_explains_more_than_causes_that_stand_in_for_it(noisy):
    one = one_unknown_input(noisy, replace(noisy, objective=noisy.objective - 10.0), THRESHOLDS)
    assert one is not None and (one.test.where, one.test.dependence) == ("torque of joint2", CHANCE)
    assert one.test.location == "joint2"
    assert one.test.ratio > 20.0 + THRESHOLDS.alias


def test_causes_that_are_as_likely_as_noise_are_no_parts_of_it(noisy):
    """As likely as the noise that the torque has, not as that which hides it."""
    one = one_unknown_input(noisy, noisy, THRESHOLDS)
    assert one is not None
    for less, found in ((0.5 * THRESHOLDS.alias, False), (2.0 * THRESHOLDS.alias, True)):
        as_likely = noisy.objective - 0.5 * (one.test.ratio - less)
        again = one_unknown_input(noisy, replace(noisy, objective=as_likely), THRESHOLDS)
        assert (again is not None) is found


def test_beside_something_else_that_is_left_no_one_torque_is_all(noisy):
    """A sensor's jump is left whatever a joint does."""
    data = noisy.problem.data
    values = np.array(data.values)
    values[len(values) // 2 :, data.names.index("tachometer.wheel_rate[wheel_x]")] += 1.0
    jumped = replace(noisy.problem, data=replace(data, values=values))
    both = fit(noisy.point, noisy.unknowns, jumped, iterations=3)
    assert one_unknown_input(both, both, THRESHOLDS) is None


def test_with_nothing_hidden_no_torque_is_unknown(known, problem):
    found = fit(known.point, known.unknowns, problem, iterations=6)
    assert one_unknown_input(found, found, THRESHOLDS) is None


def test_noise_that_was_louder_before_the_causes_is_no_reason_against_it(noisy):
    """Beside strong causes the nominal fit stays in the noise it had: it is fitted again in theirs."""
    louder = replace(noisy.problem, data=replace(noisy.problem.data, sigma=1.5 * noisy.problem.data.sigma))
    before = fit(noisy.point, noisy.unknowns, louder, iterations=3)
    assert before.objective > noisy.objective + 1000.0
    one, same = (one_unknown_input(nominal, noisy, THRESHOLDS) for nominal in (before, noisy))
    assert one is not None and same is not None
    assert one.test.where == "torque of joint2"
    assert one.objective == pytest.approx(same.objective, abs=1.0)


def test_causes_that_had_not_come_to_rest_are_no_parts_of_it(known, noisy):
    begun = evaluate(known.point, known.unknowns, noisy.problem)
    one = UnknownInput(SpecificationTest("torque", CHANCE, 9.0, 1), noisy.objective - 1.0)
    assert 2.0 * (begun.objective - one.objective) > THRESHOLDS.alias
    assert not one.explains_more(begun, THRESHOLDS)
