"""Recordings and descriptions that cannot be judged: the verdict says why, and names nothing."""

import sys

import numpy as np
import pytest

from smsid.diagnose import diagnose
from smsid.effects import GeometricStiffness
from smsid.recording import Recording


@pytest.fixture(scope="module")
def longer(flown):
    """Twelve seconds of the second experiment, noisy."""
    return flown("exp2", 12.0, 5)


@pytest.fixture
def other(longer):
    """The recording of another spacecraft: joints are driven by what this one's would do to the opposite."""
    channels = {c: np.asarray(longer[c]) for c in longer.channels if not c.startswith("truth")}
    channels["command.joint_torque"] = -channels["command.joint_torque"]
    channels["command.wheel_torque"] = channels["command.wheel_torque"][:, ::-1]
    return Recording.from_arrays(
        longer.time(), channels, labels=longer.labels, role="estimation", name="other"
    )


def test_columns_that_are_wrong_are_named(description, other):
    named = diagnose(description, [other], rate=10.0).diagnosis
    assert named.verdict == "not_evaluated" and "wheel_x and wheel_z are swapped" in named.sentence


@pytest.mark.slow
def test_a_recording_of_another_spacecraft(description, other):
    """Every strong cause is tried before that is said: minutes."""
    found = diagnose(description, [other.unchecked()], rate=10.0).diagnosis
    assert found.verdict == "not_evaluated"
    assert "another spacecraft" in found.sentence
    assert not found.causes


def test_a_description_that_does_not_simulate(description, longer):
    broken = description.with_effects(GeometricStiffness(name="gs", appendage="panel", factor=1e7))
    found = diagnose(broken, [longer], rate=10.0).diagnosis
    assert found.verdict == "not_evaluated"
    assert found.sentence
    assert not found.causes


def test_no_candidate_is_excited(description, recording, monkeypatch):
    monkeypatch.setattr(sys.modules["smsid.diagnose.diagnose"], "propose", lambda *_: [])
    found = diagnose(description, [recording], rate=10.0).diagnosis
    assert found.verdict == "not_evaluated"
    assert "excites no candidate" in found.sentence


def test_without_validation_the_gain_is_not_known_and_says_so(description, recording):
    found = diagnose(description, [recording], rate=10.0).diagnosis
    assert found.verdict in ("adequate", "explained", "unexplained")
    assert found.gain is None
    assert "no validation recording" in found.gain_reason


@pytest.mark.parametrize(
    ("channel", "sentence"),
    [("imu.angular_rate", "excites no candidate"), ("command.joint_torque", "'command.joint_torque' is nan")],
)
def test_sensors_may_miss_samples_and_commands_may_not(
    description, recording, monkeypatch, channel, sentence
):
    """As in `identify`: what drove the motion meanwhile is not known, what was not read is not needed."""
    monkeypatch.setattr(sys.modules["smsid.diagnose.diagnose"], "propose", lambda *_: [])
    values = np.array(recording[channel])
    values[[20, 21, 60]] = np.nan
    holed = recording.with_channels({channel: (recording.time(channel), values)})
    found = diagnose(description, [holed], rate=10.0).diagnosis
    assert sentence in found.sentence
