"""Predicted readings: derivatives against differences, one sample against the simulator's sensors."""

import numpy as np
import pinocchio as pin
import pytest

from smsid.diagnose.channels import Outputs, measured
from smsid.errors import RecordingError
from smsid.recording import Recording
from smsid.simulate.trajectory import States

STEP = 1e-6


@pytest.fixture(scope="module")
def place(known, problem):
    model, rng = known.point.base, np.random.default_rng(0)
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
