"""How fast unknown forces wander is estimated: by the likelihood's slope, as fast as they do."""

from dataclasses import replace

import numpy as np
import pytest

from smsid.estimation import walk_intensity
from smsid.estimation.flight import FlightOptions, flight_of
from smsid.estimation.joint_problem import at_point
from smsid.estimation.kalman import run_filter
from smsid.estimation.parameter_vector import Point
from smsid.estimation.problem import Timing
from smsid.estimation.walk_intensity import walk_slopes, with_walks_as_seen

from .satellite import Satellite, guess, recorded

RIGID = Satellite(tank=(1e-9, 1e-9, 1e-9), panel=(1.0, 0.1, 1e-6, -1e-6))
STEP, WALK = 0.05, 0.02  # [s], [N m/sqrt(s)]


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """A satellite of known inertia under a torque on its bus that nobody records, a random walk about z."""
    rng, count = np.random.default_rng(5), 1200
    walk = np.cumsum(WALK * np.sqrt(STEP) * rng.standard_normal(count + 1))

    def drive(t):
        return np.zeros(3), np.array([0.0, 0.0, walk[min(round(t / STEP), count)]]), np.zeros(3)

    flown = RIGID.fly(count * STEP, drive, step=STEP)
    flown[3][:] = 0.0  # no command says so
    recording = recorded(RIGID, flown, rng, every=1, without=("gyro.acceleration",))
    folder = tmp_path_factory.mktemp("walk")
    point = Point.of(guess(folder, RIGID, off=0.0, tank=False, panel=False))
    options = FlightOptions(torque=(0.1, 5.0 * WALK))
    return point, flight_of(point, recording, "flight", options)


def _likelihood(point, flight):
    return run_filter(point.model(), at_point(point, flight.problem)).log_likelihood


def _with(flight, **changed):
    return replace(flight, problem=replace(flight.problem, **changed))


@pytest.mark.parametrize("timing", [Timing("linear"), Timing("held", "left"), Timing("held", "right")])
def test_slopes_are_differences_of_the_likelihood(flight, timing, monkeypatch):
    monkeypatch.setattr(walk_intensity, "CHUNK", 10_000)
    point, own = flight
    inputs = tuple(replace(u, motor=True) for u in own.problem.unknown_inputs)
    own = _with(own, timing=timing, unknown_inputs=inputs)
    monkeypatch.setattr(walk_intensity, "_without_commands", lambda f: f)
    slopes, information = walk_slopes(point, own)
    for i, u in enumerate(inputs):
        values = []
        for share in (1e-3, -1e-3):
            other = replace(u, walk=u.walk * np.exp(0.5 * share))
            values.append(
                _likelihood(point, _with(own, unknown_inputs=(*inputs[:i], other, *inputs[i + 1 :])))
            )
        assert slopes[i] == pytest.approx((values[0] - values[1]) / 2e-3, rel=1e-3, abs=1e-3)
    assert (information > 0.0).all()


def test_a_walk_is_as_wide_as_the_one_that_drove(flight):
    point, own = flight
    (found,) = with_walks_as_seen(point, [own])
    x, y, z = (u.walk for u in found.problem.unknown_inputs)
    information = walk_slopes(point, found)[1][2]
    assert abs(np.log((z / WALK) ** 2)) < 3.0 / np.sqrt(information)
    assert max(x, y) < 0.3 * own.problem.unknown_inputs[0].walk  # nothing pushes there; less is not seen
    assert _likelihood(point, found) > _likelihood(point, own) + 50.0
