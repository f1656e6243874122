"""Steps of the filter's integration: short enough for the motion, or halved until they are."""

from dataclasses import replace

import pytest

from smsid.diagnose._step_size_check import SEEN, discretisation_chi2, refine_steps
from smsid.estimation.map_estimate import evaluate


def test_steps_that_are_short_enough_stay(known, problem):
    found = evaluate(known.point, known.unknowns, problem)
    assert discretisation_chi2(found) < 0.1
    assert refine_steps(found) is found


@pytest.fixture
def coarse(known, problem):
    return evaluate(
        known.point, known.unknowns, replace(problem, data=problem.data.thinned(2.0), substep=0.25)
    )


def test_steps_that_are_too_long_are_halved(coarse):
    assert discretisation_chi2(coarse) > SEEN
    finer = refine_steps(coarse)
    assert finer.problem.substep < coarse.problem.substep
    assert discretisation_chi2(finer) < SEEN
    assert finer.objective < coarse.objective


def test_what_is_fitted_again_with_shorter_steps_may_be_more_than_parameters(coarse):
    asked = []

    def again(point, problem):
        asked.append(problem.substep)
        return evaluate(point, coarse.unknowns, problem)

    finer = refine_steps(coarse, again)
    assert asked == sorted(asked, reverse=True)
    assert finer.problem.substep == asked[-1] < coarse.problem.substep


def test_the_steps_that_are_taken_are_halved_not_the_longest_allowed(known, problem):
    """Two fill the time between samples however long they may be."""
    found = evaluate(known.point, known.unknowns, replace(problem, substep=1.0))
    assert found.changes.applied.means.shape[1] == 2
    assert discretisation_chi2(found) > 0.0
