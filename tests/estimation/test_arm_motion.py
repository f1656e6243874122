"""A welded arm by its motion: against MuJoCo's arm with something in it that torques do not tell linearly."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import smsid
from smsid.arm import identify_arm
from smsid.description import Description, load_description
from smsid.effects import ActuatorDelay, JointFriction, Payload, SensorScale, TorqueGain
from smsid.errors import DescriptionError, RecordingError
from smsid.estimation.arm_motion import identify_arm_motion, why_by_motion
from smsid.identify.estimate import Estimate
from smsid.identify.momentum_rows import whole_bodies
from smsid.identify.parameter_estimate import parse_combination
from smsid.model.regressor import INERTIAL_NAMES, body_names
from smsid.recording import Recording
from tests.hidden.catalogue import hidden_effects
from tests.hidden.description import write_description
from tests.hidden.flight import write_run
from tests.hidden.numbers import WORLDS, draw

SEED = [1, 79]


@pytest.fixture(scope="module")
def truth(tmp_path_factory) -> dict[str, float]:
    """The true inertial parameters of the arm that all recordings here are of, by name."""
    true = draw(WORLDS["arm"], np.random.default_rng(SEED))
    model = smsid.build_model(load_description(write_description(true, tmp_path_factory.mktemp("true"))))
    names = [f"{body}.{i}" for body in body_names(model.pin) for i in INERTIAL_NAMES]
    return dict(zip(names, whole_bodies(model), strict=True))


def flown(folder: Path, hidden: str, value: float) -> tuple[Description, Recording, Recording]:
    """The arm as described, and two recordings of MuJoCo's, which hides something."""
    rng = np.random.default_rng(5)
    changes = [hidden_effects("arm")[hidden].make(value, None, rng)] if hidden else []
    files = write_run("arm", folder, SEED, changes, duration=30.0)
    loaded = [smsid.load_recording(path) for path in (files.recording, files.validation)]
    return load_description(files.description), *loaded


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    return flown(tmp_path_factory.mktemp("clean"), "", 0.0)


@pytest.fixture(scope="module")
def late(tmp_path_factory):
    """joint2 acts 20 ms after it is commanded: an arm that holds itself falls until the first one arrives."""
    return flown(tmp_path_factory.mktemp("late"), "actuator_delay:delay@joint2", 0.02)


def off(estimate: Estimate, truth: dict[str, float]) -> np.ndarray:
    """By how many standard deviations combinations of inertial parameters are off."""
    found = []
    for p in estimate.parameters:
        terms = parse_combination(p.name)
        if terms and all(name in truth for name in terms):
            found.append((p.value - sum(x * truth[name] for name, x in terms.items())) / p.sigma)
    return np.array(found)


def test_a_delay_is_found_with_the_bodies(late, truth):
    described, recording, _ = late
    described = described.with_effects(ActuatorDelay(name="late", actuator="joint2", delay=5e-3))
    found = identify_arm_motion(described, [recording], reason="a test")
    delay = found.estimate["late.delay"]
    assert delay.status == "identifiable" and delay.sigma < 2e-6
    assert delay.value == pytest.approx(0.02, abs=4.0 * delay.sigma)
    z = off(found.estimate, truth)
    assert len(z) == 17 and np.abs(z).max() < 4.0 and 0.5 < np.sqrt(np.mean(z**2)) < 1.6
    assert found.quality is not None and found.quality.judgement == "explained"
    assert "fitted to the motion under commanded torques: a test" in found.estimate.notes


def test_two_late_joints_hold_opposite_loads(tmp_path, truth):
    """Their first commands are 197 and -166 N m: what acted before is unknown of both, by a common share."""
    both = [hidden_effects("arm")[f"actuator_delay:delay@{j}"] for j in ("joint1", "joint2")]
    rng = np.random.default_rng(5)
    files = write_run("arm", tmp_path, SEED, [b.make(0.03, None, rng) for b in both], duration=30.0)
    described = load_description(files.description).with_effects(
        *(ActuatorDelay(name=f"late_{j}", actuator=j, delay=0.02) for j in ("joint1", "joint2"))
    )
    found = identify_arm_motion(described, [smsid.load_recording(files.recording)], reason="a test")
    assert found.quality is not None and found.quality.judgement == "explained"
    for name in ("late_joint1.delay", "late_joint2.delay"):
        p = found.estimate[name]
        assert p.sigma < 5e-6 and abs(p.value - 0.03) < 4.0 * p.sigma
    assert np.abs(off(found.estimate, truth)).max() < 4.0


def test_without_the_effect_it_is_not_explained(tmp_path):
    """Of a delay of 0.2 ms: equations of torques call 14 combinations identifiable, up to 7 sigma off."""
    described, recording, _ = flown(tmp_path, "actuator_delay:delay@joint2", 2e-4)
    found = identify_arm_motion(described, [recording], reason="a test")
    assert found.quality is not None and found.quality.judgement == "not explained"
    assert not any(p.status == "identifiable" for p in found.estimate.parameters)


def test_it_goes_that_way_by_itself(late):
    described, recording, _ = late
    described = described.with_effects(ActuatorDelay(name="late", actuator="joint2", delay=0.02))
    estimate = smsid.identify(described, recording)
    assert estimate["late.delay"].value == pytest.approx(0.02, abs=1e-5)
    assert any("late does not enter torques linearly" in n for n in estimate.notes)


def test_combinations_are_those_that_torques_tell(clean, truth):
    """Names and values as of equations of torques, from other equations."""
    described, recording, _ = clean
    motion = smsid.identify(described, recording, method="filter")
    torques = identify_arm(described, recording).estimate
    assert [p.name for p in motion.parameters] == [p.name for p in torques.parameters]
    assert np.abs(off(motion, truth)).max() < 4.0
    for p in motion.parameters:
        other = torques[p.name]
        assert p.sigma < other.sigma
        assert abs(p.value - other.value) < 4.5 * np.hypot(p.sigma, other.sigma)


def test_several_recordings_tell_more(clean, truth):
    described, recording, second = clean
    one = identify_arm_motion(described, [recording], reason="a test").estimate
    both = identify_arm_motion(
        described, [recording, second.with_role("estimation")], reason="a test"
    ).estimate
    assert np.abs(off(both, truth)).max() < 4.0
    smaller = [both[p.name].sigma < p.sigma for p in one.parameters if p.name in both]
    assert len(smaller) > 10 and all(smaller)


def test_why(clean):
    described, _, _ = clean
    linear = described.with_effects(
        JointFriction(name="f", joint="joint1", coulomb=1.0), Payload(name="p", frame="link3", mass=1.0)
    )
    assert why_by_motion(described, "ml") == why_by_motion(linear, "ml") == ""
    assert why_by_motion(linear, "filter") == "asked for"
    gain = TorqueGain(name="g", joint="joint1", error=0.0)
    scale = SensorScale(name="s", sensor="encoder", quantity="joint_velocity", component="joint2", error=0.1)
    assert why_by_motion(described.with_effects(gain), "ml") == "g does not enter torques linearly"
    assert why_by_motion(described.with_effects(gain, scale), "ml") == "g, s do not enter torques linearly"


def test_what_cannot_be(clean, tmp_path):
    described, recording, _ = clean
    measured = recording.without("command.joint_torque")
    with pytest.raises(RecordingError, match=r"no commanded torques.*asked for"):
        smsid.identify(described, measured, method="filter")
    with pytest.raises(DescriptionError, match="free-flying"):
        smsid.identify(described, recording, method="paper")
    with pytest.raises(DescriptionError, match="cutoff is for equations of torques"):
        smsid.identify(described, recording, method="filter", cutoff=5.0)
    with pytest.raises(DescriptionError, match="no prior"):
        smsid.identify(described, recording, cad=0.05)
    with pytest.raises(DescriptionError, match="no welded arm"):
        identify_arm_motion(smsid.load_spacecraft("paper_sms"), [recording], reason="a test")
