"""Fits that go astray: what is out of reach is given up, a step too long is cut to its lowest point."""

import numpy as np
import pytest

from smsid.diagnose import fit as fitting
from smsid.diagnose.fit import evaluate, fit


@pytest.fixture()
def runs(monkeypatch):
    """How often the filter has run."""
    count, run_filter = [], fitting.run_filter

    def counted(*args, **kwargs):
        count.append(1)
        return run_filter(*args, **kwargs)

    monkeypatch.setattr(fitting, "run_filter", counted)
    return count


def astray(known):
    """The point with one parameter far off, in prior standard deviations."""
    u = next(u for u in known.unknowns if u.kind == "inertial")
    return known.point.moved((u,), np.array([30.0 * u.scale]))


def test_what_is_out_of_reach_is_given_up(known, problem, runs):
    fit(astray(known), known.unknowns, problem, iterations=6, at_most=-np.inf)
    given_up = len(runs)
    runs.clear()
    reached = fit(astray(known), known.unknowns, problem, iterations=6)
    assert given_up < len(runs)
    runs.clear()
    again = fit(astray(known), known.unknowns, problem, iterations=6, at_most=reached.objective + 1.0)
    assert again.objective == pytest.approx(reached.objective, abs=1.0)


def test_a_step_too_long_is_cut_to_its_lowest_point(known, problem, runs):
    start = evaluate(astray(known), known.unknowns, problem)
    step = fitting.bounded_step(start)
    runs.clear()
    better = fitting._descend(start, 8.0 * step, known.unknowns, problem)
    assert better is not None and better.objective < start.objective
    assert len(runs) <= 3  # halves would take four


def test_the_spread_of_parameters_with_others_held_is_that_without_these(known, problem):
    found = evaluate(known.point, known.unknowns, problem)
    held = {u.name for u in known.unknowns[1::2]}
    kept = [i for i, u in enumerate(known.unknowns) if u.name not in held]
    scales = found.scales[kept]
    expected = np.linalg.inv(found.gram[np.ix_(kept, kept)]) * np.outer(scales, scales)
    covariance = found.covariance(held)
    size = np.sqrt(np.diag(expected))
    assert covariance[np.ix_(kept, kept)] / np.outer(size, size) == pytest.approx(
        expected / np.outer(size, size), abs=1e-6
    )
    assert (size < np.sqrt(np.diag(found.covariance())[kept])).any(), "something was held that matters"
