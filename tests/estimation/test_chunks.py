"""A filter some samples at a time is the filter; forces nobody recorded are states like others."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from smsid.estimation._normal_equations import normal_equations, objective_of
from smsid.estimation.flight import flight_of
from smsid.estimation.kalman import KalmanFilter
from smsid.estimation.map_estimate import columns_of
from smsid.estimation.measurements import measurements_of
from smsid.estimation.problem import Belief, UnknownInput
from smsid.estimation.sensitivities import Sensitivities, propagate
from smsid.estimation.unknowns import unknowns_of
from smsid.recording import Recording
from smsid.simulate import Inputs


@pytest.fixture(scope="module")
def flight(known, recording):
    return flight_of(known.point, recording, "flight")


def test_chunks_give_what_the_whole_recording_gives(known, flight):
    model, problem = known.point.model(), flight.problem
    unknowns = unknowns_of(known.point).unknowns[:12]
    whole = KalmanFilter(model, problem)
    run = whole.advance(len(problem.data.times))
    columns = propagate(run, columns_of(Sensitivities(known.point, model, problem, run), unknowns))
    parts = KalmanFilter(model, problem)
    delta = np.zeros((len(parts.covariance), len(unknowns)))
    first, likely = 0, 0.0
    while first < len(problem.data.times):
        part = parts.advance(170)
        changes = columns_of(Sensitivities(known.point, model, problem, part), unknowns)
        own = propagate(part, changes, delta)
        last = first + len(own)
        np.testing.assert_allclose(part.innovations, run.innovations[first:last], atol=1e-9)
        np.testing.assert_allclose(own, columns[first:last], rtol=1e-6, atol=1e-7 * np.abs(columns).max())
        likely += part.log_likelihood
        first = last
    assert likely == pytest.approx(run.log_likelihood, rel=1e-12)


def test_what_is_commanded_is_made_once_for_all_chunks(known, flight, monkeypatch):
    """Of a whole recording at each of them, time would go with its square."""
    made, plain = [], Inputs.applied
    monkeypatch.setattr(Inputs, "applied", lambda self, model: made.append(1) or plain(self, model))
    monkeypatch.setattr("smsid.estimation._normal_equations.SAMPLES_AT_ONCE", 50)
    normal_equations(known.point, unknowns_of(known.point).unknowns[:2], [flight])
    assert len(flight.problem.data.times) > 500 and len(made) == 1


def test_a_filter_started_again_is_a_new_one(known, flight):
    """From another belief, and from one chunk to the next."""
    model, problem = known.point.model(), flight.problem
    used = KalmanFilter(model, problem)
    used.advance(len(problem.data.times))
    begin = Belief(used.q, used.v, 0.1 * np.eye(2 * model.nv))
    fresh = KalmanFilter(model, replace(problem, begin=begin), until=10.0)
    again = used.restarted(begin, until=10.0)
    for count in (170, 100):
        one, other = fresh.advance(count), again.advance(count)
        np.testing.assert_array_equal(one.innovations, other.innovations)
        np.testing.assert_array_equal(one.states.v, other.states.v)


def test_curvature_and_slope_are_those_of_the_objective(known, flight):
    """To within what the innovations' covariance, which depends on parameters a little, brings by chance."""
    unknowns = [u for u in unknowns_of(known.point).unknowns if u.name in ("bus.m", "bus.Ixx")]
    found = normal_equations(known.point, unknowns, [flight])
    for i, u in enumerate(unknowns):
        step = np.zeros(len(unknowns))
        step[i] = 1e-3
        up, down = (
            objective_of(known.point.moved(unknowns, s * u.scale), unknowns, [flight]) for s in (step, -step)
        )
        curvature = (up + down - 2.0 * found.objective) / step[i] ** 2
        assert curvature == pytest.approx(found.gram[i, i], rel=0.02)
        assert abs(-(up - down) / (2.0 * step[i]) - found.slope[i]) < 0.5 * np.sqrt(curvature)


def test_an_unknown_force_moves_states_and_readings_as_a_known_one_does(known, flight):
    model = known.point.model()
    problem = replace(flight.problem, unknown_inputs=(UnknownInput(3, 1.0, 0.1), UnknownInput(6, 0.5, 0.1)))
    run = KalmanFilter(model, problem).advance(3)
    nv, step = model.nv, 1e-3
    for k in range(2):
        pushed = KalmanFilter(model, problem)
        pushed.unknown[k] = step
        moved = pushed.advance(3)
        change = (moved.predicted[0] - run.predicted[0]) / step
        for block in problem.data.blocks:
            if block.quantity != "attitude":
                np.testing.assert_allclose(
                    run.sensitivity[0][block.rows, 2 * nv + k], change[block.rows], atol=1e-8
                )
        # before the first correction: one step on
        plain = KalmanFilter(model, problem)
        plain.covariance[:] = 0.0
        alone = plain.advance(2)
        other = KalmanFilter(model, problem)
        other.covariance[:] = 0.0
        other.unknown[k] = step
        driven = other.advance(2)
        dv = (driven.states.v[1] - alone.states.v[1]) / step
        dq = pin.difference(model.pin, alone.states.q[1], driven.states.q[1]) / step
        np.testing.assert_allclose(alone.transition[0][nv : 2 * nv, 2 * nv + k], dv, rtol=2e-3, atol=1e-9)
        np.testing.assert_allclose(alone.transition[0][:nv, 2 * nv + k], dq, rtol=5e-2, atol=1e-9)


def test_clocks_of_their_own_are_all_read(known, recording):
    rates, pose = recording.time("imu.angular_rate")[::2], recording.time("pose.attitude")[::5] + 0.0031
    channels = {
        "imu.angular_rate": (rates, recording["imu.angular_rate"][::2]),
        "pose.attitude": (pose, recording["pose.attitude"][::5]),
    }
    log = Recording.from_arrays(None, channels, name="two clocks")
    sensors = known.point.description.effective_sensors()
    data = measurements_of(known.point.base, log, sensors, longest=0.01)
    gyro, attitude = (next(b for b in data.blocks if b.channel == c) for c in channels)
    assert np.isfinite(data.values[:, gyro.rows]).all(axis=1).sum() == len(rates)
    assert np.isfinite(data.values[:, attitude.rows]).all(axis=1).sum() == len(pose)
    assert np.diff(data.times).min() > 0.0 and np.diff(data.times).max() < 0.01 + 1e-9
