"""Sensors that are mounted at an angle: errors act in their own axes, readings are in the bus's."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from smsid.estimation._measurement_model import MeasurementModel
from smsid.estimation.kalman import run_filter
from smsid.estimation.measurements import measurements_of
from smsid.estimation.parameter_vector import Unknown
from smsid.estimation.sensitivities import Sensitivities

TURNED = (0.4, -0.7, 1.1)
ERRORS = {
    "angular_rate": {"bias": (1e-4, -2e-4, 3e-4), "scale_error": (0.01, 0.02, -0.03)},
    "acceleration": {"bias": (1e-3, 2e-3, -1e-3), "misalignment": (0.01, 0.0, -0.02)},
    "position": {"bias": (0.01, -0.02, 0.03), "scale_error": (0.01, 0.02, -0.03)},
    "attitude": {"bias": (1e-4, -2e-4, 3e-4)},
}


@pytest.fixture(scope="module")
def turned(known, problem):
    """The point with pose sensor and IMU at an angle, and the problem read through them."""
    sensors = tuple(s.model_copy(update={"orientation": TURNED}) for s in known.point.description.sensor)
    description = known.point.description.model_copy(update={"sensor": sensors})
    point = replace(known.point, description=description)
    return point, replace(problem, data=problem.data.with_blocks(point.sensors()))


@pytest.mark.parametrize("quantity", ERRORS)
def test_a_reading_is_that_of_the_sensor(turned, recording, quantity):
    """Gain and bias of a channel give what the sensor's own error model gives."""
    point, _ = turned
    sensor = next(
        s for s in point.description.sensor if quantity in s.quantities and s.kind in ("pose", "imu")
    )
    error = type(sensor.error(quantity)).model_validate(ERRORS[quantity])
    sensor = sensor.model_copy(update={"errors": {quantity: error}, "quantities": (quantity,)})
    block = measurements_of(point.base, recording, [sensor]).blocks[0]
    rng, times = np.random.default_rng(1), np.arange(3.0)
    if quantity == "attitude":
        truth = pin.Quaternion(pin.exp3(np.array([0.3, 0.2, -0.5])))
        read = sensor.measure(quantity, times, np.tile(truth.coeffs(), (3, 1)), None)[0]
        turn = truth.matrix().T @ pin.Quaternion(read[[3, 0, 1, 2]][0], *read[:3]).matrix()
        np.testing.assert_allclose(block.bias, pin.log3(turn), atol=1e-9)
        return
    truth = rng.standard_normal((3, 3))
    expected = sensor.measure(quantity, times, truth, None)
    np.testing.assert_allclose(truth @ block.gain.T + block.bias, expected, atol=1e-12)


@pytest.mark.parametrize("quantity", ["angular_rate", "acceleration"])
def test_the_change_by_a_bias_is_that_of_differences(turned, quantity):
    point, problem = turned
    model = point.model()
    changes = Sensitivities(point, model, problem, run_filter(model, problem))
    states = changes.run.states
    for i, axis in enumerate("xyz"):
        bias = Unknown(f"imu.{quantity}.bias.{axis}", "bias", "", 0.0, 1.0, 1.0, column=i)
        ends = [point.moved([bias], np.array([d])) for d in (1e-3, -1e-3)]
        high, low = (
            MeasurementModel(model, problem.data.with_blocks(p.sensors()), problem.locked).all(states)
            for p in ends
        )
        found, changed = changes.bias(bias), np.zeros_like(high)
        changed[:, found.rows] = found.reading
        np.testing.assert_allclose(changed, (high - low) / 2e-3, atol=1e-9)
