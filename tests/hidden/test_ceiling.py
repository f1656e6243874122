"""What no diagnosis can do better, against what these numbers mean."""

import numpy as np
import pytest
from scipy.stats import chi2

from .ceiling import chance, held_out, power, separable


def test_strength_one_is_found_with_the_power_it_is_defined_by():
    assert power(60, 0.01) == pytest.approx(0.95, abs=0.003)


def test_power_grows_with_the_strength_and_falls_with_the_number_of_candidates():
    assert power(122, 0.003) < power(60, 0.01) < power(60, 0.01, strength=1.2)


def test_chance_of_one_eigenvalue_is_that_of_chi_squared():
    assert chance(np.array([3.0]), 6.0, np.random.default_rng(0), draws=20000) == pytest.approx(
        chi2.cdf(2.0, 1), abs=0.01
    )


def test_what_is_told_apart_is_counted_by_distance():
    """Three others within the resolution are one too many; at three times the strength none is."""
    from .limits import table

    near = {name: np.array([2.0, 2.0, 2.0, 9.0]) for name in table()["arm"]}
    assert separable(near, "arm", 3.0, np.random.default_rng(0), draws=50) == 1.0
    assert (
        separable(near, "arm", 1.0, np.random.default_rng(0), draws=50) < 0.2
    )  # counted ones, found by rule, are not in question


@pytest.mark.slow
def test_what_stays_unknown_costs_on_the_held_out_flight_what_the_tool_says_too(tmp_path):
    """The filter's own derivatives and covariance predict the same excess as simulations of the world."""
    from smsid.diagnose.diagnose import RATE
    from smsid.diagnose.fit import evaluate
    from smsid.diagnose.gain import _read
    from smsid.recording import load_recording

    from .flight import write_run
    from .study import diagnosed

    files = write_run("arm", tmp_path, [60017, 79])
    found, _ = diagnosed(files, tmp_path)
    last = found.search.last
    _, problem = _read(last.point, load_recording(files.validation), last.problem, RATE)
    w = evaluate(last.point, last.unknowns, problem).whitened.reshape(-1, len(last.unknowns))
    own = float(np.trace(w @ np.linalg.inv(last.gram) @ w.T))
    assert held_out("arm").sum() == pytest.approx(own, rel=0.25)
