"""A model simulates a recording by itself from the initial state it fits there."""

from dataclasses import replace

import numpy as np
import pytest

from smsid.diagnose._open_loop import _levels, _squared_errors, open_loop


def whitened(run, problem):
    return np.sqrt(np.mean((run.errors / problem.data.sigma)[run.used] ** 2))


@pytest.fixture(scope="module")
def true(known, problem):
    return open_loop(known.point.model(), problem)


def test_the_true_model_leaves_the_noise(true, problem):
    assert 0.9 < whitened(true, problem) < 1.1


def test_a_first_sample_that_is_read_badly_leads_nowhere_else(known, problem, true):
    """Within what its prior allows; every channel is followed to its noise all the same."""
    values = problem.data.values.copy()
    values[0] += 4.0 * problem.data.sigma * np.random.default_rng(5).choice([-1.0, 1.0], len(values[0]))
    off = replace(problem, data=replace(problem.data, values=values))
    found = open_loop(known.point.model(), off)
    later = (found.errors / problem.data.sigma)[1:]
    for block in problem.data.blocks:
        assert np.sqrt(np.mean(later[:, block.rows] ** 2)) < 1.15, block.channel
    mine = _squared_errors(found, _levels(off.data, found))
    best = _squared_errors(true, _levels(problem.data, true))
    assert abs(mine / best - 1.0) < 0.1
