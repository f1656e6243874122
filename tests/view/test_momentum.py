from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson
from scipy.spatial.transform import Rotation

from smsid.recording import Recording
from smsid.simulate import truth_of
from smsid.view._momentum import momenta
from smsid.view._motion import DrawnMotion, motion_of
from smsid.view._recorded import slopes
from smsid.view._scene import build_scene


@pytest.fixture(scope="module")
def motion(model, trajectory):
    return motion_of(model, trajectory, 0.01, 1000)


def test_momentum_is_the_impulse_of_the_thrust(model, motion):
    """Newton's law, from force and attitude alone."""
    found = momenta(model, motion)
    force = Rotation.from_quat(motion.q[:, 3:7]).apply(motion.force)
    impulse = cumulative_simpson(force, x=motion.time, axis=0, initial=0.0)
    np.testing.assert_allclose(found.linear, impulse, atol=1e-6 * np.abs(impulse).max() + 1e-8)


def test_centre_of_mass_moves_with_the_momentum(model, motion):
    found = momenta(model, motion)
    rate = np.gradient(found.com, motion.time, axis=0)
    np.testing.assert_allclose(model.mass * rate[5:-5], found.linear[5:-5], atol=2e-3 * found.linear_scale)


def test_scales_are_what_there_would_be_if_nothing_cancelled(model, motion):
    found = momenta(model, motion)
    assert np.linalg.norm(found.linear, axis=1).max() <= found.linear_scale * (1 + 1e-9)
    assert np.linalg.norm(found.angular, axis=1).max() <= found.angular_scale * (1 + 1e-9)
    still = momenta(model, DrawnMotion(np.arange(3.0), np.tile(model.home, (3, 1)), np.zeros((3, 3))))
    assert still.linear_scale == 0.0 and not still.angular.any()


def test_slopes_are_the_velocities(model, motion):
    found = slopes(model, motion.time, motion.q)
    assert motion.v is not None
    np.testing.assert_allclose(found[5:-5], motion.v[5:-5], atol=3e-3 * np.abs(motion.v).max())


def test_recorded_velocities_are_taken_where_they_were_measured(model, trajectory, motion):
    times = np.linspace(0.0, 6.0, 601)
    channels = truth_of(trajectory, model.description.sensor)(times)
    played = motion_of(model, Recording.from_arrays(times, channels), 0.01, 1000)
    assert played.v is not None and motion.v is not None
    np.testing.assert_allclose(played.v, motion.v, atol=2e-5 * np.abs(motion.v).max())
    for name in ("joint_torque", "wheel_torque"):
        np.testing.assert_allclose(getattr(played, name), getattr(motion, name), atol=1e-9)
    less = {k: x for k, x in channels.items() if "velocity" not in k and "rate" not in k}
    guessed = motion_of(model, Recording.from_arrays(times, less), 0.01, 1000)
    assert guessed.v is not None
    index = model.arm_joints.v
    assert np.abs(guessed.v[50:-50, index] - motion.v[50:-50, index]).max() < 0.1 * np.abs(motion.v).max()


def test_momentum_that_is_sensor_noise_is_left_out(model, trajectory):
    """Two tonnes times the noise of a velocity sensor is a momentum that nothing has."""
    still = np.tile(model.home, (400, 1))
    times = np.arange(400) / 20.0
    rng = np.random.default_rng(4)
    noise = 1e-3 * rng.standard_normal((400, model.nv))
    motion = DrawnMotion(times, still, np.zeros((400, 3)), v=noise, smoothed=0.5)
    assert momenta(model, motion).telling == (False, False)
    scene = build_scene(model, motion)
    assert not {"momentum", "angular momentum"} & set(scene.layers)
    assert any("sensors' noise" in note for note in scene.notes)


def test_momentum_of_a_measured_motion_is_averaged(model, trajectory):
    exact = motion_of(model, trajectory, 0.05, 1000)
    assert exact.v is not None
    noise = 2e-3 * np.random.default_rng(5).standard_normal(exact.v.shape)
    noise[:, 6:] = 0.0
    measured = replace(exact, v=exact.v + noise, smoothed=0.5)
    raw, found, true = (momenta(model, m) for m in (replace(measured, smoothed=0.0), measured, exact))
    inner = slice(10, -10)
    before, after = (np.sqrt(np.mean((x.linear - true.linear)[inner] ** 2)) for x in (raw, found))
    assert after < 0.5 * before and found.telling[0]
