"""Measured motion on one clock: channels, clocks and delays, and the states it stands for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from twins.cases import random_pairs
from twins.channels import point_acceleration
from twins.description import Ordering
from twins.mujoco_twin import Drive, MujocoTwin

from smsid.errors import RecordingError
from smsid.identify.paper.motion import prepare, raw_rates
from smsid.identify.sensor_roles import Roles
from smsid.model import build_model
from smsid.recording import Recording
from smsid.sensing import Sensor

from ..support import exact_motion, from_twin, paper


@pytest.fixture(scope="module")
def exact(model, twin_flight):
    return prepare(model, twin_flight, cutoff=None, rate=None)


def test_nothing_is_changed_without_filter(exact, twin_flight):
    np.testing.assert_array_equal(exact.time, twin_flight.time())
    np.testing.assert_array_equal(exact.position, twin_flight["pose.position"])
    np.testing.assert_array_equal(exact.panels["panel"], twin_flight["panel.acceleration"])
    world = np.einsum("nij,nj->ni", exact.rotation, exact.velocity)
    np.testing.assert_allclose(world, twin_flight["pose.velocity"], atol=1e-15)


def test_filter_and_thinning_keep_slow_motion(model, twin_flight, exact):
    """2 Hz and 20 Hz, from where the filter has settled to where the arm whips through (28 s)."""
    found = prepare(model, twin_flight)
    assert len(found) == 801 and found.step == pytest.approx(0.05)
    thin = exact.thinned(5)
    inside = slice(100, 500)
    for name in ("position", "velocity", "rate", "acceleration", "angles", "angle_rates", "wheel_rates"):
        mine, theirs = getattr(found, name)[inside], getattr(thin, name)[inside]
        assert np.abs(mine - theirs).max() < 3e-3 * np.abs(theirs).max(), name


def test_derivative_of_the_body_rate(model, twin_flight, exact):
    """Against differences of the exact rate over two samples."""
    numeric = (exact.rate[2:] - exact.rate[:-2]) / 0.02
    np.testing.assert_allclose(
        exact.rate_derivative[50:-50], numeric[49:-49], atol=2e-3 * np.abs(numeric).max()
    )


def test_rigid_acceleration_is_the_twins(model):
    """Any bus-fixed point from the IMU's acceleration: random states, rates of order 1 rad/s."""
    states, inputs = zip(*random_pairs(20), strict=True)
    twin, point, other = MujocoTwin(), np.array([0.5, 1.5, 0.6]), np.array([-2.0, 0.3, 1.0])
    still = (np.zeros(3),) * 3
    vdot = [twin.accelerations(s, u) for s, u in zip(states, inputs, strict=True)]
    acceleration, expected = (
        np.array([point_acceleration(s, a, p, still) for s, a in zip(states, vdot, strict=True)])
        for p in (point, other)
    )
    motion = replace(
        exact_motion(states, point), acceleration=acceleration, rate_derivative=np.array(vdot)[:, 3:6]
    )
    np.testing.assert_allclose(motion.rigid_acceleration(other), expected, atol=1e-10)


def test_states_are_the_twins(model):
    states = [s for s, _ in random_pairs(20)]
    q, v = exact_motion(states, np.array([0.5, 1.5, 0.6])).states(model)
    order = Ordering(model)
    for found_q, found_v, state in zip(q, v, states, strict=True):
        np.testing.assert_allclose(found_q[:3], state.position, atol=1e-12)
        measured = [*range(6), *model.wheels.v, *model.arm_joints.v]
        np.testing.assert_allclose(found_v[measured], order.v(state)[measured], atol=1e-12)
        np.testing.assert_allclose(model.joint_angles(found_q), state.q, atol=1e-12)


def test_quaternions_may_change_sign(model, twin_flight, exact):
    flips = np.where(np.arange(len(twin_flight.time())) // 7 % 2, -1.0, 1.0)
    flipped = twin_flight.with_channels({"pose.attitude": twin_flight["pose.attitude"] * flips[:, None]})
    np.testing.assert_allclose(
        prepare(model, flipped).rotation, prepare(model, twin_flight).rotation, atol=1e-12
    )


def test_sensors_on_their_own_clocks(model, twin_flight):
    """Encoder at 50 Hz, tachometer at 10 Hz, panel at 50 Hz: the same motion, interpolated."""
    t = twin_flight.time()
    every = {"encoder": 2, "tachometer": 10, "panel": 2}
    channels = {}
    for name in twin_flight.channels:
        k = every.get(name.split(".")[0])
        channels[name] = (t[::k], twin_flight[name][::k]) if k else twin_flight[name]
    mixed = Recording.from_arrays(t, channels)
    found, expected = prepare(model, mixed), prepare(model, twin_flight)
    inside = slice(20, -20)
    for name in ("angles", "angle_rates", "wheel_rates"):
        mine, theirs = getattr(found, name)[inside], getattr(expected, name)[inside]
        assert np.abs(mine - theirs).max() < 1e-3 * np.abs(theirs).max(), name
    mine, theirs = found.panels["panel"][inside], expected.panels["panel"][inside]
    assert np.abs(mine - theirs).max() < 5e-3 * np.abs(theirs).max()


def test_described_delays_are_taken_out(twin_flight):
    """A star tracker 50 ms late at 10 Hz beside a pose sensor without attitude."""
    d = paper()
    pose = next(s for s in d.sensor if s.name == "pose")
    point = Sensor(
        name="pose", kind="pose", rate=100.0, position=pose.position, quantities=("position", "velocity")
    )
    tracker = Sensor(
        name="tracker", kind="pose", rate=10.0, quantities=("attitude",), errors={"attitude": {"delay": 0.05}}
    )
    model = build_model(d.with_sensors(point, tracker, *(s for s in d.sensor if s.name != "pose")))
    t = twin_flight.time()
    late = np.clip(np.arange(0, len(t), 10) - 5, 0, None)
    recording = Recording.from_arrays(
        t,
        {
            **{c: twin_flight[c] for c in twin_flight.channels if c != "pose.attitude"},
            "tracker.attitude": (t[::10], twin_flight["pose.attitude"][late]),
        },
    )
    found = prepare(model, recording)
    expected = prepare(build_model(d), twin_flight)
    n = min(len(found), len(expected))
    assert n > 790
    np.testing.assert_array_equal(found.time[:n], expected.time[:n])
    off = Rotation.from_matrix(found.rotation[20 : n - 20]).inv() * Rotation.from_matrix(
        expected.rotation[20 : n - 20]
    )
    # 50 ms at 0.08 rad/s would be 4 mrad
    assert np.linalg.norm(off.as_rotvec(), axis=1).max() < 1e-4


def test_the_quietest_sensor_is_taken(twin_flight):
    d = paper()
    loud = Sensor(name="loud", kind="imu", rate=100.0, errors={"acceleration": {"noise_sigma": 1.0}})
    model = build_model(d.with_sensors(loud, *d.sensor))
    both = twin_flight.with_channels(
        {f"loud.{q}": twin_flight[f"imu.{q}"] for q in ("acceleration", "angular_rate")}
    )
    assert Roles.of(model, both).imu.name == "imu"
    only = both.without("imu.acceleration")
    assert Roles.of(model, only).imu.name == "loud"


@pytest.mark.parametrize(
    ("channel", "named"),
    [
        ("imu.angular_rate", "imu.acceleration, imu.angular_rate"),
        ("pose.velocity", "pose.position, pose.velocity"),
        ("pose.attitude", "pose.attitude"),
        ("encoder.joint_velocity", "encoder.joint_position, encoder.joint_velocity"),
        ("tachometer.wheel_rate", "tachometer.wheel_rate"),
    ],
)
def test_missing_channels_are_named(model, twin_flight, channel: str, named: str):
    with pytest.raises(RecordingError, match=f"It needs the channels {named}") as caught:
        prepare(model, twin_flight.without(channel))
    assert channel in caught.value.evidence["missing"]
    assert channel not in caught.value.evidence["present"]


def test_a_sensor_missing_from_the_description_is_told(twin_flight):
    d = paper()
    model = build_model(d.with_sensors(*(s for s in d.sensor if s.kind != "tachometer")))
    with pytest.raises(RecordingError, match="description needs a sensor of kind 'tachometer'"):
        prepare(model, twin_flight)


@pytest.mark.parametrize(
    ("channel", "kept"),
    [("encoder.joint_position", 2), ("tachometer.wheel_rate", 2), ("panel.acceleration", 2)],
)
def test_columns_that_do_not_fit_are_told(model, twin_flight, channel: str, kept: int):
    t = twin_flight.time()
    channels = {c: twin_flight[c] for c in twin_flight.channels if c.split(".")[0] != channel.split(".")[0]}
    own = [c for c in twin_flight.channels if c.split(".")[0] == channel.split(".")[0]]
    short = Recording.from_arrays(t, {**channels, **{c: twin_flight[c][:, :kept] for c in own}})
    with pytest.raises(RecordingError, match="has 2 columns, the description 3"):
        prepare(model, short)


def test_uneven_samples_are_told(model, twin_flight):
    t = np.array(twin_flight.time())
    t[2000:] += 0.004
    uneven = Recording.from_arrays(t, {c: twin_flight[c] for c in twin_flight.channels})
    with pytest.raises(RecordingError, match="not evenly sampled"):
        prepare(model, uneven)


def test_clocks_without_common_time_are_told(model, twin_flight):
    t = twin_flight.time()
    channels = {c: twin_flight[c] for c in twin_flight.channels}
    channels["tachometer.wheel_rate"] = (t + 100.0, twin_flight["tachometer.wheel_rate"])
    with pytest.raises(RecordingError, match="no time in common"):
        prepare(model, Recording.from_arrays(t, channels))


def test_raw_rates_are_the_channels(model, twin_flight):
    found = raw_rates(model, twin_flight)
    assert set(found) == {
        "the velocity of the tracked point",
        "the body rate",
        "a joint's rate",
        "a wheel's rate",
    }
    np.testing.assert_array_equal(found["a wheel's rate"][1], twin_flight["tachometer.wheel_rate"])


def test_from_twin_is_what_the_mapping_makes(twin_flight):
    """The helper of these tests against its own source: quaternions in the project's order."""
    channels = MujocoTwin().simulate(Drive(), 0.05)
    assert from_twin(channels)["pose.attitude"][0] == pytest.approx([0, 0, 0, 1])
