"""What a search found in words: when it is an explanation, and when pieces of something else."""

from types import SimpleNamespace

import pytest

from smsid.diagnose.result import FoundCause
from smsid.diagnose.verdict import verdict

WHOLE = SimpleNamespace(left=(), misfit=False)
STRAYS = SimpleNamespace(left=(), misfit=True, followed=0.99, noise={"imu.angular_rate": 20.0})


def cause(family, location, onset):
    return FoundCause(f"an effect of {family}", location, family, "shape", (), (), {}, onset=onset)


@pytest.mark.parametrize(
    ("second", "decided"),
    [
        (("actuator", "joint3", 8.9), "unexplained"),
        (("actuator", "joint2", 58.2), "explained"),  # at once
        (("actuator", "joint3", None), "explained"),
        (("inertia", "tool", 8.9), "explained"),  # a payload is grasped, later a motor weakens
    ],
)
@pytest.mark.parametrize("whole", [WHOLE, STRAYS], ids=["followed", "misfit"])
def test_causes_of_a_family_that_begin_in_turn_are_pieces_of_a_drift(whole, second, decided):
    found = (cause("actuator", "joint2", 58.4), cause(*second))
    said, sentence = verdict(whole, found)
    assert said == decided
    assert "joint2" in sentence and ("drift" in sentence) == (said == "unexplained")
    assert verdict(whole, found[:1])[0] == "explained"


@pytest.mark.parametrize(
    ("first", "second", "decided"),
    [
        (
            ("sensor", "imu.angular_rate", 20.0),
            ("sensor", "encoder.joint_position[joint1]", 50.0),
            "explained",
        ),
        (("sensor", "imu.angular_rate", 20.0), ("sensor", "imu.angular_rate", 50.0), "unexplained"),
        (("external", "bus", 20.0), ("external", "link1", 50.0), "unexplained"),
    ],
)
def test_sensors_fail_one_by_one(first, second, decided):
    assert verdict(WHOLE, (cause(*first), cause(*second)))[0] == decided
