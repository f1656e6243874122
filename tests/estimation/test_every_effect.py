"""Every kind of listed effect is estimated, or said not to be and why."""

import numpy as np
import pytest

from smsid.effects import Gear

from .effect_cases import by_name, deviations, fly, identified

pytest.importorskip("mujoco")
FAST = ("joint_offset", "sensor_bias wheel")
OTHERS = [n for n in by_name() if n not in FAST]


def recovered(name, folder):
    flight = fly(by_name()[name], 0, folder)
    found = identified(flight)
    assert found.quality.judgement == "explained"
    assert found.quality.widening < 1.3
    off = deviations(flight, found)  # a parameter that is silently held has no row: KeyError
    assert max(abs(x) for x in off.values()) < 4.0


@pytest.mark.parametrize("name", FAST)
def test_an_effect_is_recovered_from_nothing(name, tmp_path):
    recovered(name, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHERS)
def test_every_effect_is_recovered_from_nothing(name, tmp_path):
    recovered(name, tmp_path)


def test_where_motors_are_held_an_accelerometer_tells_its_place(tmp_path):
    """With torques that wander between samples it was 2.5 sigma off, five times as wide, in every draw."""
    flight = fly(by_name()["lever_arm"], 3, tmp_path)
    found = identified(flight)
    off = deviations(flight, found)
    assert max(abs(x) for x in off.values()) < 3.0
    assert all(found.estimate[n].sigma < 5e-4 for n in off)


def test_an_encoder_whose_zero_is_off_reads_less_by_the_offset(tmp_path):
    description = fly(by_name()["joint_offset"], 0, tmp_path).description
    offset = description.get_effect("cause").with_values({"cause.angle": 0.01})
    (encoder,) = [s for s in description.with_effects(offset).effective_sensors() if s.name == "encoder"]
    assert encoder.error("joint_position").components["1"].bias == pytest.approx(-0.01)
    assert np.isclose(offset.angle, 0.01)


def test_what_a_spacecraft_does_not_tell_of_a_gear_is_said():
    gear = Gear(name="gear", joint="joint1", ratio=-100.0)
    assert set(gear.held()) == {"gear.ratio", "gear.torque_gain"}
    assert all("welded arm" in why for why in gear.held().values())
