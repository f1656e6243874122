"""What was measured: attitudes as turns, biases that begin midway, recordings of other sensors."""

import numpy as np
import pinocchio as pin
import pytest

from smsid.effects import SensorBias
from smsid.errors import RecordingError
from smsid.estimation._measurement_model import MeasurementModel
from smsid.estimation.measurements import measurements_of
from smsid.recording import Recording
from smsid.simulate.trajectory import States


def test_attitude_residual_is_the_turn_from_prediction_to_measurement(problem):
    data, k = problem.data, 40
    block = next(b for b in data.blocks if b.quantity == "attitude")
    q = pin.Quaternion(*data.attitude[block.channel][k][[3, 0, 1, 2]])
    turn = np.array([1e-3, -2e-3, 5e-4])
    rotation = q.matrix() @ pin.exp3(-turn)
    residual = data.residual(k, np.zeros(data.rows), rotation)
    np.testing.assert_allclose(residual[block.rows], turn, atol=1e-8)


def test_a_recording_of_other_sensors_is_refused(known, recording):
    other = Recording.from_arrays(
        recording.time(), {"elsewhere.angular_rate": np.asarray(recording["imu.angular_rate"])}
    )
    with pytest.raises(RecordingError, match="nothing the sensors"):
        measurements_of(known.point.base, other, known.point.description.sensor)


def test_a_clock_that_jumps_is_refused_before_it_is_integrated_over(known, recording):
    """An array of 73 TiB was asked for."""
    times, rates = np.array(recording.time()), np.asarray(recording["imu.angular_rate"])
    times[100:] += 1e9
    jumped = Recording.from_arrays(times, {"imu.angular_rate": rates})
    with pytest.raises(RecordingError, match=rf"After {times[99]:.6g} s nothing is recorded for 1e\+09 s"):
        measurements_of(known.point.base, jumped, known.point.description.sensor, longest=0.01)


def test_a_bias_that_begins_midway_is_there_from_then_on(known, problem):
    """In the reading of one sample and of all, as the sensors' own error model has it."""
    start, bias = 2.0, (1e-3, -2e-3, 3e-3)
    effect = SensorBias(name="b", sensor="imu", quantity="angular_rate", bias=bias, start=start)
    point = known.point.with_effect(effect)
    data, later = problem.data, problem.data.with_blocks(point.sensors())
    rows = next(b.rows for b in data.blocks if b.channel == "imu.angular_rate")
    predicted = np.zeros(data.rows)
    for k in (0, int(np.searchsorted(data.times, start)) - 1, int(np.searchsorted(data.times, start)), -1):
        change = data.residual(k, predicted, np.eye(3)) - later.residual(k, predicted, np.eye(3))
        expected = np.zeros(data.rows)
        expected[rows] = bias if data.times[k] >= start else 0.0
        np.testing.assert_allclose(change, expected, atol=1e-15)
    model, n = point.base, 3
    still = np.zeros((n, model.nv))
    states = States(np.array([1.9, 2.0, 2.1]), np.tile(model.home, (n, 1)), still, still, still, still)
    change = MeasurementModel(model, later).all(states) - MeasurementModel(model, data).all(states)
    np.testing.assert_allclose(change[:, rows], np.outer([0.0, 1.0, 1.0], bias), atol=1e-15)


def test_the_sign_of_quaternions_says_nothing_of_their_noise(known, recording):
    """Where no noise is stated it is told from third differences of the samples."""
    channel = "pose.attitude"
    sensors = [
        s.model_copy(update={"quantities": ("attitude",), "errors": {}})
        for s in known.point.description.sensor
        if channel in s.channels
    ]
    q = np.array(recording[channel])
    signs = np.random.default_rng(2).choice([-1.0, 1.0], len(q))[:, None]
    flipped = recording.with_channels({channel: (recording.time(channel), signs * q)})
    sigmas = [measurements_of(known.point.base, r, sensors).sigma for r in (recording, flipped)]
    np.testing.assert_allclose(*sigmas, rtol=1e-12)
