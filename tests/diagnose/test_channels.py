"""Predicted readings: derivatives against differences, one sample against the simulator's sensors."""

import numpy as np
import pinocchio as pin
import pytest

from smsid.diagnose.channels import Outputs, measured
from smsid.effects import GearCompliance, GeometricStiffness, SensorBias
from smsid.errors import RecordingError
from smsid.recording import Recording
from smsid.simulate.trajectory import States

STEP = 1e-6


@pytest.fixture(scope="module", params=["as described", "drawn in"])
def place(known, problem, request):
    """A state; with ``drawn in`` the panel shortens as it bends, and its accelerometers see that."""
    point = known.point
    if request.param == "drawn in":
        point = point.with_effect(GeometricStiffness(name="soft", appendage="panel", factor=0.7))
    model, rng = point.model(), np.random.default_rng(0)
    q = pin.integrate(model.pin, model.home, 0.2 * rng.standard_normal(model.nv))
    return Outputs(model, problem.data), q, *(0.2 * rng.standard_normal((2, model.nv)))


def test_one_sample_reads_what_the_simulator_reads(place):
    outputs, q, v, a = place
    nothing = np.zeros((1, len(v)))
    states = States(np.zeros(1), q[None], v[None], a[None], nothing, nothing)
    np.testing.assert_allclose(outputs.predict(q, v, a)[0], outputs.all(states)[0], atol=1e-13)


@pytest.mark.parametrize("by", ["q", "v", "a"])
def test_derivatives_are_those_of_central_differences(place, by):
    outputs, q, v, a = place
    model = outputs.model.pin

    def reading(step):
        if by == "q":
            return outputs.predict(pin.integrate(model, q, step), v, a)[0]
        return outputs.predict(q, v + step, a)[0] if by == "v" else outputs.predict(q, v, a + step)[0]

    found = dict(zip("qva", outputs.predict(q, v, a)[1:], strict=True))[by]
    steps = STEP * np.eye(len(v))
    expected = np.stack([(reading(s) - reading(-s)) / (2 * STEP) for s in steps], axis=1)
    rows = [i for i, name in enumerate(outputs.data.names) if "attitude" not in name]
    np.testing.assert_allclose(found[rows], expected[rows], atol=2e-9)


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
        measured(known.point.base, other, known.point.description.sensor)


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
    change = Outputs(model, later).all(states) - Outputs(model, data).all(states)
    np.testing.assert_allclose(change[:, rows], np.outer([0.0, 1.0, 1.0], bias), atol=1e-15)


def test_encoder_sees_a_gear_that_gives_at_once(known, problem):
    gear = GearCompliance(name="g", joint="joint2", compliance=1e-3, motor_inertia=0.5, quasistatic=True)
    model = known.point.with_effect(gear).model()
    rng = np.random.default_rng(3)
    tau, a = rng.standard_normal((2, model.nv))
    h = np.zeros(problem.data.rows)
    Outputs(model, problem.data).twisted(h, tau, a)
    rows = next(b.rows for b in problem.data.blocks if b.channel == "encoder.joint_position")
    v = int(model.arm_joints.v[1])
    expected = np.zeros(problem.data.rows)
    expected[rows.start + 1] = 1e-3 * (tau[v] - 0.5 * a[v])
    np.testing.assert_allclose(h, expected, atol=1e-18)
