"""What speaks against a cause: a value that cannot be."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from smsid.diagnose._plausibility import impossible, impossible_fit
from smsid.diagnose.result import FoundCause, Value
from smsid.diagnose.score_test import Candidate
from smsid.diagnose.verdict import describe, verdict
from smsid.effects import JointFriction


def cause(effect, family, location, name, value, sigma=1e-3, unit="1", nominal=None):
    values = (Value(name, value, sigma, unit, nominal),)
    return FoundCause(effect, location, family, "shape", values, (), {})


GYRO = ("sensor_scale", "sensor", "imu.angular_rate", "scale.error.z")
SEAL = ("joint_friction", "friction", "joint2")
MOTOR = ("torque_gain", "actuator", "joint2", "gain.error")


@pytest.mark.parametrize(
    ("one", "cannot_be"),
    [
        (cause(*GYRO, -1.0001), True),
        (cause(*GYRO, -2.0), False),  # a reversed axis
        (cause(*GYRO, 0.03), False),
        (cause(*MOTOR, -1.0), False),  # a motor that does not turn
        (cause("body_error", "inertia", "link1", "body.density", -1.2), True),
        (cause("body_error", "inertia", "link1", "body.density", 1.0), False),
        (cause("slosh", "slosh", "tank", "tank.mass", -3.0, unit="kg", nominal=20.0), True),
        (cause(*MOTOR, float("nan")), True),
        (cause(*SEAL, "seal.quadratic", -0.4), True),  # a drag that pushes
        (cause(*SEAL, "seal.coulomb_direction", -0.4), False),
    ],
)
def test_an_absurd_value_is_never_explained(one, cannot_be):
    assert bool(impossible(one)) is cannot_be
    hidden = SimpleNamespace(where="torque of joint1", dependence="time")
    followed = SimpleNamespace(left=(), left_before=(hidden,), misfit=False, causes=())
    said, sentence = verdict(followed, (one,))
    assert (said == "unexplained") is cannot_be
    assert cannot_be == ("torque of joint1 depends on time; what would (" in sentence), sentence
    assert cannot_be == ("is not believed" in sentence)


def test_what_a_gain_means_is_said_and_no_sentence_has_a_nan():
    assert "its sign is reversed" in describe(cause(*MOTOR, -2.0))
    assert "it does nothing" in describe(cause(*MOTOR, -1.0))
    assert "reversed" not in describe(cause(*MOTOR, -0.1))
    unknown = describe(cause(*MOTOR, 0.1, sigma=float("nan")))
    assert "nan" not in unknown and "not known" in unknown


@pytest.mark.parametrize(
    ("rate", "height", "within"), [(0.004, 0.5, True), (0.05, 0.5, False), (0.004, 0.0, False)]
)
def test_a_curve_that_falls_before_the_sign_has_turned_is_a_shape_of_the_sign(rate, height, within):
    """What friction does within 0.01 rad/s of rest no sign of the rate resolves (tanh(2) = 0.96)."""
    own = JointFriction(name="rub", joint="joint2", coulomb=2.0, stribeck=height, stribeck_rate=rate)
    found = SimpleNamespace(unknowns=(), point=SimpleNamespace(description=SimpleNamespace(effect=(own,))))
    candidate = Candidate("joint_friction", "joint2", "friction", "stribeck", own, ("rub.stribeck",), (1.0,))
    assert bool(impossible_fit(found, candidate)) is within
    assert impossible_fit(found, replace(candidate, effect=None)) == ""
    beside = replace(candidate, shape="viscous", free=("rub.viscous",))
    assert impossible_fit(found, beside) == "", "another law of the same effect"
