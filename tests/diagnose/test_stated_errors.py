"""Errors of sensors that a description states are no causes, and a sensor that pauses no reason to stop."""

import pytest

from smsid.diagnose import diagnose
from smsid.diagnose.priors import nominal
from smsid.recording import Recording
from tests.diagnose.test_hold_rivals import flown

STATED = {"random_walk": 1e-5, "bias_sigma": 3e-4, "scale_sigma": 3e-3, "misalignment_sigma": 3e-3}


def with_gyro(description, **errors):
    """Return the description with more errors of its gyro stated."""
    sensors = []
    for sensor in description.sensor:
        if "angular_rate" in sensor.quantities:
            own = sensor.error("angular_rate").model_copy(update=errors)
            sensor = sensor.model_copy(update={"errors": {**sensor.errors, "angular_rate": own}})
        sensors.append(sensor)
    return description.model_copy(update={"sensor": tuple(sensors)})


@pytest.mark.parametrize("seed", [1, 2])
def test_errors_that_are_stated_are_no_causes(tmp_path, seed):
    description, recording = flown(tmp_path, True, stated=lambda d: with_gyro(d, **STATED), seed=seed)
    found = diagnose(description, [recording]).diagnosis
    assert found.verdict == "adequate", found.sentence


def test_a_bias_that_is_not_stated_is_no_nuisance(tmp_path):
    """Only then can it be found as a cause; the walk begins at nothing."""
    description, _ = flown(tmp_path, True)
    for errors, sigma in (({"random_walk": 1e-5}, 1e-5), ({"bias_sigma": (0.0, 3e-4, 0.0)}, 3e-4)):
        unknowns = nominal(with_gyro(description, **errors), None).unknowns
        biases = [u for u in unknowns if u.name.startswith("gyro.angular_rate.bias")]
        assert biases
        assert all(u.sigma == sigma for u in biases)


def test_a_sensor_may_pause(tmp_path):
    description, recording = flown(tmp_path, True)
    t = recording.time("gyro.angular_rate")
    read = (t < 15.0) | (t > 16.0)
    channels = {
        c: (recording.time(c)[read], recording[c][read]) if c.startswith("gyro.") else recording[c]
        for c in recording.channels
    }
    paused = Recording.from_arrays(t, channels, labels=recording.labels, name="paused")
    assert paused.gaps()
    found = diagnose(description, [paused]).diagnosis
    assert found.verdict == "adequate", found.sentence


def test_every_recording_has_its_own_stated_errors(tmp_path):
    """Searched together, and where a third one is simulated, by which nothing that wanders is followed."""
    flights = [
        flown(tmp_path, True, stated=lambda d: with_gyro(d, **STATED), seed=seed) for seed in (1, 2, 3)
    ]
    one, two, three = (r.with_name(f"flight {k}") for k, (_, r) in enumerate(flights))
    made = diagnose(flights[0][0], [one, two], validation=[three.with_role("validation")]).diagnosis
    assert made.verdict == "adequate", made.sentence
    assert made.gain is not None, made.gain_reason


def test_a_validation_flight_has_errors_of_sensors_of_its_own(tmp_path):
    """With those of the flight that was searched, a sound model left twice the noise and more on another."""
    stated = {"scale_sigma": 3e-3, "misalignment_sigma": 3e-3}
    more = {"stated": lambda d: with_gyro(d, **stated), "seconds": 20.0}
    flights = [flown(tmp_path, True, seed=seed, **more) for seed in (1, 2)]
    (description, one), (_, two) = flights
    held_out = two.with_name("two").with_role("validation")
    found = diagnose(description, [one.with_name("one")], validation=[held_out]).diagnosis
    assert found.gain is not None, found.gain_reason
    whitened = found.gain.whitened_given, found.gain.whitened_nominal, found.gain.whitened_extended
    assert whitened == pytest.approx((1.0, 1.0, 1.0), abs=0.05)
