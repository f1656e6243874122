"""What the prediction cannot follow is refused, whenever and wherever in the motion it acts."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.effects.actuator import ThrusterGain, ThrusterMisalignment
from smsid.effects.external import ExternalWrench
from smsid.effects.friction import JointFriction
from smsid.effects.slosh import SloshNonlinearity
from smsid.errors import DescriptionError
from smsid.likelihood.inputs import measured_drive
from smsid.model import build_model
from smsid.recording import Recording

from . import twin

TIMES = np.arange(6001) * 0.01


def pushed(force: np.ndarray) -> Recording:
    """A record of 60 s of which only commands, and what names the sensors, matter."""
    n = len(TIMES)
    channels = {
        "command.force": force,
        "imu.acceleration": np.zeros((n, 3)),
        "imu.angular_rate": np.zeros((n, 3)),
    }
    return Recording.from_arrays(TIMES, channels, role="estimation", name="exp1")


def steps() -> np.ndarray:
    force = np.zeros((len(TIMES), 3))
    force[: len(TIMES) // 2, 0] = 20.0
    return force


@pytest.mark.parametrize(
    "effect",
    [
        ExternalWrench(name="leak", force=(0.01, 0.0, 0.0), start=40.0),
        ExternalWrench(name="leak", force=(0.01, 0.0, 0.0), start=59.9),
        ExternalWrench(name="leak", force=(0.01, 0.0, 0.0)),
        SloshNonlinearity(name="hard", tank="tank", cubic=2.0),  # nothing at rest in the middle
        SloshNonlinearity(name="drag", tank="tank", quadratic_damping=2.0, start=30.0),
    ],
    ids=["later", "at the end", "from the start", "deflected", "moving, later"],
)
def test_a_force_on_what_is_free_is_refused(effect):
    model = build_model(twin.description().with_effects(effect))
    with pytest.raises(DescriptionError, match="nonlinear force"):
        measured_drive(model, pushed(steps()), 0.0, 60.0)


def test_what_begins_after_the_record_or_acts_on_joints_is_not():
    late = ExternalWrench(name="leak", force=(0.01, 0.0, 0.0), start=61.0)
    friction = JointFriction(name="rub", joint="joint1", coulomb=1.0)
    model = build_model(twin.description().with_effects(late, friction))
    assert measured_drive(model, pushed(steps()), 0.0, 60.0).held


def test_thrust_acts_as_the_description_says():
    gain = ThrusterGain(name="gain", gain=(0.1, 0.0, 0.0))
    turned = ThrusterMisalignment(name="turned", angles=(0.0, 0.0, np.pi / 2), start=15.005)
    model = build_model(twin.description().with_effects(gain, turned))
    thrust = measured_drive(model, pushed(steps()), 0.0, 60.0).thrust
    assert thrust is not None
    assert thrust.steps
    at = np.array([1.0, 15.0, 15.006, 29.0, 31.0])
    expected = [[22.0, 0.0, 0.0], [22.0, 0.0, 0.0], [0.0, 22.0, 0.0], [0.0, 22.0, 0.0], [0.0, 0.0, 0.0]]
    np.testing.assert_allclose(thrust.at(at, at)[:, :3], expected, atol=1e-12)
    np.testing.assert_allclose(thrust.jumps, [15.005, 30.0])
