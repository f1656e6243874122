"""The yardstick of the gain: the true model leaves nothing but noise of a flight it has not seen."""

import numpy as np

from .flight import write_run
from .judge import Injected, Judgement
from .plan import Run
from .study import diagnosed
from .truth import against_truth


def test_the_true_model_gains_what_there_is_to_gain(tmp_path):
    from .catalogue import hidden_effects

    effect = hidden_effects("arm")["joint_friction:coulomb@joint1"]
    run = Run(41, "single", "arm", (Injected(effect, 0.02, 80.0),))
    files = write_run("arm", tmp_path, [run.seed, 79], [effect.make(0.02, None, np.random.default_rng(0))])
    found, document = diagnosed(files, tmp_path)
    right = Judgement("right", deviation=0.0)
    measured = against_truth(run, files, tmp_path, found, document, right)
    assert measured is not None
    assert measured["nominal"] > 1e3
    assert 0.99 < measured["excess"] < 1.01
    assert 0.9 < measured["open_loop"] < 1.1
    # a wrong truth leaves more than noise, and is no yardstick
    wrong = Run(41, "single", "arm", (Injected(effect, 0.01, 40.0),))
    assert against_truth(wrong, files, tmp_path, found, document, right) is None
    assert against_truth(run, files, tmp_path, found, document, Judgement("missed")) is None
