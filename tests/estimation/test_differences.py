"""Slopes of the log-posterior by differences of whole runs, where those along the filter's states fail."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from smsid.estimation.differences import differenced
from smsid.estimation.flight import flight_of
from smsid.estimation.kalman import Timing
from smsid.estimation.maximum import converged, settled
from smsid.estimation.normal_equations import normal_equations, objective_of
from smsid.estimation.retraction import retract
from smsid.estimation.unknowns import unknowns_of


@pytest.fixture(scope="module")
def flight(known, recording):
    return flight_of(known.point, recording.window(0.0, 1.5), "flight")


@pytest.fixture(scope="module")
def unknowns(known):
    names = ("bus.m", "bus.Ixx")
    return [u for u in unknowns_of(known.point).unknowns if u.name in names]


def test_the_slope_is_the_objectives_where_the_model_is_wrong(known, flight, unknowns):
    """Commands taken as linear where they are held: innovations of many standard deviations."""
    wrong = [replace(flight, problem=replace(flight.problem, timing=Timing("linear", "right")))]
    found = normal_equations(known.point, unknowns, wrong)
    exact = differenced(found, wrong)
    for i, u in enumerate(unknowns):
        step = np.zeros(len(unknowns))
        step[i] = 0.03 / np.sqrt(found.gram[i, i])
        up, down = (
            objective_of(retract(known.point, unknowns, s * u.scale), unknowns, wrong) for s in (step, -step)
        )
        assert exact.slope[i] == pytest.approx(-(up - down) / (2.0 * step[i]), rel=1e-2, abs=1e-3 / step[i])


def test_both_curvatures_agree_where_the_model_is_right(known, flight, unknowns):
    found = normal_equations(known.point, unknowns, [flight])
    exact = differenced(found, [flight])
    size = np.sqrt(np.diag(found.gram))
    np.testing.assert_allclose((exact.gram - found.gram) / np.outer(size, size), 0.0, atol=0.05)


def test_from_a_halt_it_goes_on_to_the_maximum(known, flight, unknowns):
    """A start two standard deviations off in each parameter."""
    at = normal_equations(known.point, unknowns, [flight])
    start = retract(known.point, unknowns, 2.0 * at.scales / np.sqrt(np.diag(at.gram)))
    end = settled(normal_equations(start, unknowns, [flight]), [flight])
    assert converged(end) and end.objective < at.objective
