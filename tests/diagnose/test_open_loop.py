"""A model simulates a recording by itself from the initial state it fits there."""

import numpy as np

from smsid.diagnose.open_loop import open_loop


def test_the_true_model_leaves_the_noise(known, problem):
    run = open_loop(known.point.model(), problem)
    whitened = (run.errors / problem.data.sigma)[run.used]
    assert 0.9 < np.sqrt(np.mean(whitened**2)) < 1.1
