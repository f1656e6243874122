"""Known errors of sensors are undone: what `ErrorModel` makes of a truth comes out as the truth."""

from __future__ import annotations

import numpy as np
import pytest
from likelihood import twin

from smsid.effects.sensor_errors import (
    LeverArm,
    SensorBias,
    SensorMisalignment,
    SensorScale,
    StuckChannel,
    TimeOffset,
)
from smsid.identify.clocks import event_times
from smsid.identify.sensor_correction import correct_readings
from smsid.identify.sensor_roles import Roles
from smsid.model import build_model
from smsid.recording import Recording
from smsid.sensing import Sensor, add_noise
from smsid.sensing.component import ComponentError

EFFECTS = (
    SensorBias(name="b1", sensor="imu", quantity="acceleration", bias=(0.1, -0.2, 0.3), start=1.0),
    SensorBias(name="b2", sensor="pose", quantity="attitude", bias=(0.01, 0.02, -0.01)),
    SensorBias(name="b3", sensor="encoder", quantity="joint_position", component=1, bias=0.05),
    SensorScale(name="s1", sensor="imu", quantity="acceleration", error=(0.01, 0.0, -0.02)),
    SensorScale(name="s2", sensor="panel", quantity="acceleration", station=1, component="z", error=0.1),
    SensorMisalignment(name="m1", sensor="imu", quantity="acceleration", angles=(0.1, -0.05, 0.2)),
    SensorMisalignment(name="m2", sensor="pose", quantity="attitude", angles=(0.0, 0.1, 0.0)),
)


def truth() -> Recording:
    rng, n = np.random.default_rng(0), 301
    quaternions = rng.standard_normal((n, 4))
    channels = {
        "pose.position": rng.standard_normal((n, 3)),
        "pose.velocity": rng.standard_normal((n, 3)),
        "pose.attitude": quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True),
        "imu.acceleration": rng.standard_normal((n, 3)),
        "imu.angular_rate": rng.standard_normal((n, 3)),
        "encoder.joint_position": rng.standard_normal((n, 3)),
        "encoder.joint_velocity": rng.standard_normal((n, 3)),
        "tachometer.wheel_rate": rng.standard_normal((n, 3)),
        "panel.acceleration": rng.standard_normal((n, 3, 3)),
    }
    return Recording.from_arrays(np.arange(n) * 0.01, channels, role="estimation", name="truth")


def without_noise(sensors: tuple[Sensor, ...]) -> list[Sensor]:
    """The sensors with known errors alone."""
    quiet = {"noise_density": None, "noise_sigma": None, "bias_sigma": 0.0, "scale_sigma": 0.0}
    quiet |= {"misalignment_sigma": 0.0, "bias_instability": 0.0, "random_walk": 0.0, "quantisation": 0.0}
    quiet |= {"bias_correlation_time": None}
    return [
        s.model_copy(
            update={
                "preset": None,
                "errors": {q: s.error(q).model_copy(update=quiet) for q in s.quantities},
            }
        )
        for s in sensors
    ]


def test_what_sensors_make_of_a_truth_is_undone():
    turned = {"components": {"1,2": ComponentError(misalignment=0.2)}}
    sensors = tuple(
        s.model_copy(update={"errors": {"acceleration": s.error("acceleration").model_copy(update=turned)}})
        if s.kind == "accelerometers"
        else s
        for s in twin.description().with_effects(*EFFECTS).effective_sensors()
    )
    clean = truth()
    with_error = add_noise(clean, without_noise(sensors), np.random.default_rng(0))
    assert np.abs(with_error["panel.acceleration"] - clean["panel.acceleration"]).max() > 0.1
    assert np.abs(with_error["imu.acceleration"] - clean["imu.acceleration"]).max() > 0.1
    found = correct_readings(with_error, sensors)
    for name in clean.channels:
        expected, values = clean[name], found[name]
        if name == "pose.attitude":  # either sign is the same attitude
            values = values * np.sign(np.sum(values * expected, axis=1))[:, None]
        np.testing.assert_allclose(values, expected, atol=1e-12, err_msg=name)


def test_a_stuck_channel_is_not_a_number():
    stuck = StuckChannel(name="s", sensor="encoder", quantity="joint_position", component=2, start=2.0)
    sensors = twin.description().with_effects(stuck).effective_sensors()
    found = correct_readings(truth(), sensors)["encoder.joint_position"]
    bad = np.isnan(found)
    assert not bad[:, :2].any()
    np.testing.assert_array_equal(np.flatnonzero(bad[:, 2]), np.arange(200, 301))


def test_without_known_errors_nothing_is_copied():
    recording = truth()
    assert correct_readings(recording, twin.description().effective_sensors()) is recording


def test_where_and_when_are_as_the_effects_say():
    lever = LeverArm(name="l", sensor="imu", offset=(0.1, 0.0, 0.0))
    late = TimeOffset(name="t", sensor="imu", offset=0.03)
    model = build_model(twin.description().with_effects(lever, late))
    recording = truth()
    imu = Roles.of(model, recording).imu
    described = next(s for s in twin.description().sensor if s.name == "imu")
    np.testing.assert_allclose(np.subtract(imu.position, described.position), [0.1, 0.0, 0.0], atol=1e-15)
    times = event_times(recording, imu, "acceleration")
    assert times[0] == pytest.approx(-0.03 - described.error("acceleration").delay)
