"""Any flight, everything listed: against a world of plain Newton's laws that smsid knows nothing of."""

from dataclasses import replace

import numpy as np
import pytest

from smsid.effects import SensorBias
from smsid.errors import NotIdentifiableError, RecordingError
from smsid.estimation.identify_flights import identify_flights
from smsid.export.bodies import parse_combination

from .satellite import AXES, Satellite, burns_and_wheels, guess, recorded, true_values

RIGID = Satellite(tank=(1e-9, 1e-9, 1e-9), panel=(1.0, 0.1, 1e-6, -1e-6))
COMMANDS = ("command.wheel_torque", "command.force", "command.torque")


def deviations(found, truth):
    """Return how far identifiable values are from the truth, in standard deviations, by name."""
    return {
        p.name: (p.value - truth[p.name]) / p.sigma
        for p in found.estimate.parameters
        if p.name in truth and p.status != "not_identifiable"
    }


def combined(found, truth):
    """Return the true values of an estimate's combinations, by their names."""
    terms = {p.name: parse_combination(p.name) for p in found.estimate.parameters}
    return {
        n: sum(f * truth[k] for k, f in t.items()) for n, t in terms.items() if t and set(t) <= set(truth)
    }


@pytest.fixture(scope="module")
def flown():
    truth = Satellite()
    return truth, truth.fly(120.0, burns_and_wheels)


@pytest.fixture(scope="module")
def found(flown, tmp_path_factory):
    truth, flight = flown
    description = guess(tmp_path_factory.mktemp("craft"), truth)
    return identify_flights(description, [recorded(truth, flight, np.random.default_rng(1))])


def test_a_satellite_at_10_hz_without_position_is_found_from_a_wrong_guess(flown, found):
    off = deviations(found, true_values(flown[0]))
    assert {"tank.mass", "tank.stiffness.x", "panel.mode1.frequency", "bus.Ixx", "bus.Izz"} <= set(off)
    assert max(abs(x) for x in off.values()) < 4.0
    assert np.sqrt(np.mean([x**2 for x in off.values()])) < 1.6
    assert found.estimate["tank.mass"].relative_sigma < 0.01


def test_the_model_is_said_to_explain_its_recording(found):
    assert found.quality.judgement == "explained"
    assert found.quality.widening == 1.0
    assert found.estimate.notes[0].startswith("The model explains the recordings")


def test_covariance_is_that_of_the_parameters_in_order(found):
    sigma = [p.sigma for p in found.estimate.parameters]
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), sigma, rtol=1e-9)
    assert np.linalg.eigvalsh(found.covariance).min() > -1e-9 * found.covariance.max()


def wheels_alone(t):
    return np.zeros(3), np.zeros(3), 0.1 * np.sin(2 * np.pi * np.array([0.05, 0.083, 0.031]) * t)


def about_the_centre_of_mass(truth):
    """Return the moments and products of inertia about the centre of mass, by name."""
    c = np.array(truth.centre)
    inertia = np.array(truth.inertia) - truth.mass * ((c @ c) * np.eye(3) - np.outer(c, c))
    return {f"bus.Ic{AXES[i]}{AXES[k]}": inertia[i, k] for i in range(3) for k in range(i, 3)}


def test_gyro_and_wheels_alone_give_inertias_and_no_mass(tmp_path):
    flight = RIGID.fly(60.0, wheels_alone)
    description = guess(tmp_path, RIGID, tank=False, panel=False)
    recording = recorded(
        RIGID,
        flight,
        np.random.default_rng(3),
        without=(
            "st.attitude",
            "gyro.acceleration",
            "command.wheel_torque",
            "command.force",
            "command.torque",
        ),
    )
    found = identify_flights(description, [recording])
    off = deviations(found, about_the_centre_of_mass(RIGID))
    assert {"bus.Icxx", "bus.Icyy", "bus.Iczz", "bus.Icxy", "bus.Icyz"} <= set(off)
    assert not [p for p in found.estimate.parameters if p.name.startswith("bus.m")]
    assert max(abs(x) for x in off.values()) < 4.0


def test_a_moving_start_is_no_trouble(tmp_path):
    start = np.zeros(24)
    start[3:7] = np.array([0.1, -0.2, 0.3, 0.9]) / np.linalg.norm([0.1, -0.2, 0.3, 0.9])
    start[7:10], start[10:13] = (0.2, -0.1, 0.05), (0.01, -0.008, 0.005)
    start[21:24] = 1.0, -2.0, 3.0
    flight = RIGID.fly(60.0, wheels_alone, start=start)
    description = guess(tmp_path, RIGID, tank=False, panel=False)
    found = identify_flights(description, [recorded(RIGID, flight, np.random.default_rng(4))])
    off = deviations(found, combined(found, true_values(RIGID, tank=False, panel=False)))
    assert {n.split(" ")[0] for n in off} >= {"bus.Ixx", "bus.Iyy", "bus.Izz"}
    assert max(abs(x) for x in off.values()) < 4.0


def test_flights_of_two_spacecraft_are_said_to_contradict_each_other(tmp_path):
    other = replace(RIGID, inertia=((84.0, 1.0, 0.0), (1.0, 95.0, -2.0), (0.0, -2.0, 70.0)))
    recordings = [
        recorded(truth, truth.fly(40.0, wheels_alone), np.random.default_rng(k), name=name)
        for k, (name, truth) in enumerate((("one", RIGID), ("two", other)))
    ]
    description = guess(tmp_path, RIGID, tank=False, panel=False)
    found = identify_flights(description, recordings)
    assert {c.recording for c in found.contradictions} == {"one", "two"}
    assert any("bus.Ixx" in p[0] or "bus.Icxx" in p[0] for p in found.contradictions[0].parameters)
    same = [recordings[0], recorded(RIGID, RIGID.fly(40.0, wheels_alone), np.random.default_rng(8), name="b")]
    assert not identify_flights(description, same).contradictions


def test_a_bias_that_is_listed_is_estimated_once(tmp_path):
    description = guess(tmp_path, RIGID, tank=False, panel=False)
    description = description.with_effects(
        SensorBias(name="drift", sensor="gyro", quantity="angular_rate", bias=(0.0, 0.0, 0.0))
    )
    recording = recorded(RIGID, RIGID.fly(30.0, wheels_alone), np.random.default_rng(6))
    moved = {c: recording[c] for c in recording.channels}
    moved["gyro.angular_rate"] = moved["gyro.angular_rate"] + np.array([3e-4, -2e-4, 1e-4])
    recording = type(recording).from_arrays(
        recording.time("gyro.angular_rate"), moved, labels={"wheel": ("rw1", "rw2", "rw3")}, name="biased"
    )
    found = identify_flights(description, [recording])
    for axis, truth in zip(AXES, (3e-4, -2e-4, 1e-4), strict=True):
        p = found.estimate[f"drift.bias.{axis}"]
        assert abs(p.value - truth) < 4.0 * p.sigma
    assert not [p for p in found.estimate.parameters if "angular_rate.bias" in p.name and ": " in p.name]


def test_a_wheel_that_is_wired_the_wrong_way_round_is_not_explained(tmp_path):
    flight = RIGID.fly(40.0, wheels_alone)
    recording = recorded(RIGID, flight, np.random.default_rng(7), without=("command.wheel_torque",))
    moved = {c: recording[c] for c in recording.channels}
    moved["tacho.wheel_rate"] = moved["tacho.wheel_rate"] * np.array([1.0, -1.0, 1.0])
    wrong = type(recording).from_arrays(
        recording.time("gyro.angular_rate"), moved, labels={"wheel": ("rw1", "rw2", "rw3")}, name="reversed"
    )
    try:
        found = identify_flights(guess(tmp_path, RIGID, tank=False, panel=False), [wrong])
    except NotIdentifiableError:
        return
    assert found.quality.judgement == "not explained"
    assert all(p.status != "identifiable" for p in found.estimate.parameters)


def test_what_cannot_be_used_is_refused(tmp_path):
    description = guess(tmp_path, RIGID, tank=False, panel=False)
    with pytest.raises(RecordingError, match="No recording"):
        identify_flights(description, [])
    short = recorded(RIGID, RIGID.fly(0.6, wheels_alone), np.random.default_rng(5))
    with pytest.raises(RecordingError, match="samples"):
        identify_flights(description, [short])
