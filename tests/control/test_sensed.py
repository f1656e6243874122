"""What a closed loop's sensors read is what the same sensors read of a recording."""

from __future__ import annotations

import numpy as np

from smsid.control._sensed import _stream
from smsid.sensing import Sensor


def test_errors_of_single_components_act_in_a_closed_loop() -> None:
    errors = {"scale_error": 0.1, "components": {"1": {"scale_error": 0.2, "misalignment": 0.3, "bias": 0.4}}}
    sensor = Sensor.model_validate(
        {"name": "gyro", "kind": "imu", "rate": 10.0, "errors": {"angular_rate": errors}}
    )
    stream = _stream(sensor, "angular_rate", 3, 1.0, 10.0, lambda: np.random.default_rng(0))
    x = np.array([[0.1, -0.2, 0.3]])
    found = x @ stream.linear + stream.errors[:1]
    np.testing.assert_allclose(found, sensor.measure("angular_rate", np.zeros(1), x, None), atol=1e-15)
