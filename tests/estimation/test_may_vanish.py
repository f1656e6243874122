"""What is listed and not there is estimated down to zero where it may vanish, and told by an upper end."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.diagnose.priors import nominal
from smsid.effects import ActuatorDelay, JointFriction, SensorDelay
from smsid.effects.base import catalogue
from smsid.estimation.identify_flights import identify_flights
from smsid.estimation.parameter_vector import Point
from smsid.estimation.unknowns import effect_unknown, unknowns_of
from tests.estimation.satellite import Satellite, guess
from tests.tracking.craft import craft, flight

SHAPE = ("stribeck", "stribeck_rate", "stribeck_exponent", "load", "position_cos", "position_sin")


@pytest.fixture(scope="module")
def flown():
    return flight(40.0)


@pytest.mark.parametrize(
    "listed",
    [
        ActuatorDelay(name="late", actuator="rw1", delay=0.02),
        SensorDelay(name="late", sensor="gyro", quantity="angular_rate", delay=0.02),
    ],
    ids=["actuator", "sensor"],
)
def test_a_delay_that_is_not_there_has_an_upper_end(listed, flown, tmp_path):
    found = identify_flights(craft(tmp_path).with_effects(listed), [flown])
    assert found.quality.judgement == "explained"
    delay = found.estimate["late.delay"]
    low, high = delay.interval
    assert delay.status == "identifiable"
    assert low == pytest.approx(0.0, abs=0.01 * delay.sigma)
    assert high < 1e-3
    assert high == pytest.approx(delay.value + 1.96 * delay.sigma, rel=0.1)


def test_friction_that_is_not_there_is_at_most_what_noise_hides(flown, tmp_path):
    listed = JointFriction(name="drag", joint="rw1", viscous=1e-3, coulomb=1e-3, known=SHAPE)
    found = identify_flights(craft(tmp_path).with_effects(listed), [flown])
    assert found.quality.judgement == "explained"
    for name, largest in (("drag.viscous", 1e-4), ("drag.coulomb", 1e-4)):
        told = found.estimate[name]
        assert told.status == "identifiable"
        assert told.interval[0] == 0.0 < told.interval[1] < largest
        if told.value == 0.0:
            assert "at its bound: at most" in told.note


def test_one_step_takes_friction_to_zero_and_half_of_a_mass(tmp_path):
    listed = JointFriction(name="drag", joint="rw1", viscous=1e-3, coulomb=1e-3, known=SHAPE)
    point = Point.of(craft(tmp_path).with_effects(listed))
    drag = next(u for u in unknowns_of(point).unknowns if u.name == "drag.viscous")
    assert not drag.positive
    assert point.moved([drag], np.array([-1.0])).value(drag) == 0.0
    kept = drag.__class__("drag.viscous", "effect", drag.unit, 1e-3, np.inf, 1e-3, lower=0.0)
    assert kept.positive
    assert point.moved([kept], np.array([-1.0])).value(kept) == 5e-4


def test_no_mass_and_no_frequency_may_vanish():
    """What may vanish has a bound at zero, and gives no motion of its own."""
    for kind in catalogue().values():
        for name, field in kind.model_fields.items():
            extra = field.json_schema_extra
            if isinstance(extra, dict) and extra.get("may_vanish"):
                assert extra["lower"] == 0.0, (kind, name)
                assert not {"mass", "frequency", "length", "gap", "stiffness"} & {name}, (kind, name)


def test_what_may_vanish_is_an_unknown_that_may():
    own = {p.name: p for p in ActuatorDelay(name="late", actuator="rw1", delay=0.02).parameters()}
    assert own["late.delay"].may_vanish
    assert effect_unknown(own["late.delay"]).may_vanish


def test_a_diagnosis_takes_them_so_too(tmp_path):
    tank = guess(tmp_path, Satellite(), panel=True)
    found = {u.name: u for u in nominal(tank, None).unknowns}
    assert found["tank.damping.x"].may_vanish and found["panel.mode1.damping"].may_vanish
    assert not found["tank.mass"].may_vanish and not found["tank.stiffness.x"].may_vanish
