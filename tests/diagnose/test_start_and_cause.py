"""A recording that begins in motion and lacks something in its model."""

import numpy as np
import pytest

from smsid.diagnose import diagnose


@pytest.mark.slow
@pytest.mark.parametrize(
    "seed",
    [
        5,
        pytest.param(
            0, marks=pytest.mark.xfail(strict=True, reason="the bias is named, the rest unexplained")
        ),
    ],
)
def test_a_start_metres_off_and_a_cause_are_told_apart(description, flown, seed):
    """The cause bent where the tank was put, by 0.2 m, and what that left was of no cause: unexplained."""
    window = flown("exp1", 50.0, seed).window(30.0, 50.0)
    rate = np.asarray(window["imu.angular_rate"]) + np.array([2e-4, 0.0, 0.0])
    found = diagnose(description, [window.with_channels({"imu.angular_rate": rate})]).diagnosis
    assert found.verdict == "explained", found.sentence
    (cause,) = found.causes
    assert (cause.effect, cause.location) == ("sensor_bias", "imu.angular_rate")
    (x,) = (p for p in cause.parameters if p.name.endswith(".x"))
    assert x.interval[0] < 2e-4 < x.interval[1] and x.sigma < 5e-6
