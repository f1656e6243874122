"""Flying experiments: what is recorded, which limits are passed, what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.errors import ExperimentError
from smsid.experiments import ConstantProfile, Experiment, fly, thrust_experiment
from smsid.experiments.fly import LimitUse
from smsid.model import build_model


@pytest.fixture(scope="module")
def flight(model):
    return fly(model, thrust_experiment("x", duration=12.0), np.random.default_rng(1))


def test_the_recording_is_of_the_sensors(model, flight):
    r = flight.recording
    assert {c for s in model.description.sensor for c in s.channels} <= set(r.channels)
    assert {"command.force", "truth.slosh_position", "truth.modal_position"} <= set(r.channels)
    assert r.name == "exp1_x" and r.role == "estimation"
    assert len(r.time()) == 1201
    assert r.labels["joint"] == model.arm_joints.names
    r.check()


def test_newton_by_hand(flight):
    """Just after the start the acceleration is 40 N over all mass but the slosh, which stays behind."""
    r = flight.recording
    inside = (r.time() > 0.05) & (r.time() < 0.5)
    a = r["imu.acceleration"][inside, 0].mean()
    # along x the panel does not bend; the slosh has a period of 69 s
    assert a == pytest.approx(40.0 / (2256.8 - 49.6), rel=2e-3)


def test_the_seed_gives_it_back(model, flight):
    again = fly(model, thrust_experiment("x", duration=12.0), np.random.default_rng(1))
    assert again.recording.equals(flight.recording)
    other = fly(model, thrust_experiment("x", duration=12.0), np.random.default_rng(2))
    assert not np.array_equal(other.recording["imu.acceleration"], flight.recording["imu.acceleration"])


def test_provenance_says_how_it_was_made(flight):
    note = flight.recording.provenance
    assert note["simulated_by"].startswith("smsid ")
    assert Experiment.model_validate(note["experiment"]) == thrust_experiment("x", duration=12.0)
    assert note["sensing"]["entropy"] == "1"


def test_limits_passed_are_named(model):
    """100 N where the description has 60; the wheels' torque where it has 2 N m."""
    hard = Experiment(
        name="hard",
        duration=1.0,
        force=ConstantProfile(value=(100.0, 0.0, 0.0)),
        wheel_torque=ConstantProfile(value=(0.0, 3.0, 0.0)),
    )
    passed = {u.quantity: u for u in fly(model, hard, np.random.default_rng(0)).exceeded}
    assert set(passed) == {"thrust per axis", "torque of wheel_y"}
    assert passed["thrust per axis"].value == pytest.approx(100.0)
    assert passed["torque of wheel_y"].value == pytest.approx(3.0)
    assert str(passed["thrust per axis"]) == "thrust per axis: 100 N (limit 60 N)"


def test_within_limits_nothing_is_named(flight):
    assert flight.exceeded == ()
    uses = {u.quantity: u for u in flight.limits}
    assert uses["thrust per axis"].value == pytest.approx(40.0)
    assert uses["torque holding the attitude"].limit is None
    assert uses["stroke of tank"].value > 0.01


def test_no_limit_is_never_exceeded():
    use = LimitUse("x", 1e9, None, "m")
    assert not use.exceeded and "no limit stated" in str(use)


def test_no_sensors_are_told(model):
    bare = build_model(model.description.with_sensors())
    with pytest.raises(ExperimentError, match="has no sensors, so nothing would be recorded"):
        fly(bare, thrust_experiment("x"), np.random.default_rng(0))


@pytest.mark.parametrize(("kind", "what"), [("encoder", "no arm joint"), ("tachometer", "no wheel")])
def test_sensors_with_nothing_to_measure_are_told(two_arms, kind: str, what: str):
    d = two_arms.description
    bare = d.model_copy(update={"arm": () if kind == "encoder" else d.arm, "wheel": ()})
    if kind == "encoder":
        bare = bare.model_copy(update={"sensor": tuple(s for s in d.sensor if s.kind != "tachometer")})
    with pytest.raises(ExperimentError, match=f"Sensor '{kind}' has nothing to measure: .* has {what}"):
        fly(build_model(bare), thrust_experiment("x"), np.random.default_rng(0))


def test_start_angles_that_do_not_fit_are_told(model):
    with pytest.raises(ExperimentError, match="starts 2 joints, the spacecraft has 3"):
        fly(model, Experiment(name="e", duration=1.0, joints=(0.1, 0.2)), np.random.default_rng(0))


def test_start_angles_are_taken(model):
    e = Experiment(name="e", duration=0.2, joints=(0.1, 0.2, 0.3), lock_joints=True)
    r = fly(model, e, np.random.default_rng(0)).recording
    np.testing.assert_allclose(r["encoder.joint_position"][0], [0.1, 0.2, 0.3], atol=1e-4)


def test_two_arms_in_exp1(two_arms):
    """Both tanks by name, both panels recorded."""
    flight = fly(two_arms, thrust_experiment("z", duration=6.0), np.random.default_rng(0))
    assert {"truth_fuel.slosh_position", "truth_oxidiser.slosh_position"} <= set(flight.recording.channels)
    assert {"panel_a.acceleration", "panel_b.acceleration"} <= set(flight.recording.channels)
    assert {"stroke of fuel", "stroke of oxidiser"} <= {u.quantity for u in flight.limits}
    assert flight.recording["encoder.joint_position"].shape[1] == 6
