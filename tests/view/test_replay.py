from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from smsid.description import load_description
from smsid.errors import RecordingError, SmsidError
from smsid.recording import Recording, load_recording, save_recording
from smsid.simulate import States, truth_of
from smsid.view import Look, build_replay, replay, write_view

from .conftest import URDF


@pytest.fixture(scope="module")
def channels(model, trajectory):
    """Times and exact channels at 100 Hz."""
    times = np.linspace(0.0, 6.0, 601)
    return times, truth_of(trajectory, model.description.sensor)(times)


def test_recording_and_simulation_play_the_same(model, trajectory, channels):
    times, found = channels
    recorded = replay(model, Recording.from_arrays(times, found))
    simulated = replay(model, trajectory)
    assert not recorded.motion.notes
    np.testing.assert_allclose(recorded.motion.time, simulated.motion.time)
    np.testing.assert_allclose(recorded.motion.force, simulated.motion.force, atol=1e-9)
    np.testing.assert_allclose(
        Rotation.from_quat(recorded.motion.q[:, 3:7]).as_matrix(),
        Rotation.from_quat(simulated.motion.q[:, 3:7]).as_matrix(),
        atol=1e-12,
    )
    rest = np.setdiff1d(np.arange(model.nq), [3, 4, 5, 6])
    np.testing.assert_allclose(recorded.motion.q[:, rest], simulated.motion.q[:, rest], atol=2e-4)


def test_sources_with_clocks_of_their_own_play_where_they_overlap(model, channels):
    times, found = channels
    recording = Recording.from_arrays(
        None,
        {
            "pose.position": (times[50:], found["pose.position"][50:]),
            "pose.attitude": (times[50:], found["pose.attitude"][50:]),
            "encoder.joint_position": (times[:500:3], found["encoder.joint_position"][:500:3]),
        },
    )
    motion = replay(model, recording).motion
    assert motion.time[0] == pytest.approx(0.5)
    assert motion.time[-1] == pytest.approx(times[498], abs=0.05)


def test_what_is_missing_rests_and_is_named(model, channels, caplog):
    times, found = channels
    names = ("pose.attitude", "encoder.joint_position")
    played = replay(model, Recording.from_arrays(times, {k: found[k] for k in names}))
    for word in ("position", "wheel rates", "slosh", "deflection of appendages"):
        assert any(note.startswith(f"{word} not recorded") for note in played.notes)
        assert f"{word} not recorded" in caplog.text
    moved = np.ptp(played.motion.q, axis=0) > 0
    assert moved[3:7].all() and moved[model.arm_joints.q].all()
    assert not moved[:3].any() and not moved[model.wheels.q].any() and not moved[model.modes.q].any()


def test_samples_that_are_not_finite_are_bridged(model, channels):
    times, found = channels
    angles = found["encoder.joint_position"].copy()
    angles[100:110] = np.nan
    motion = replay(model, Recording.from_arrays(times, {"encoder.joint_position": angles})).motion
    assert np.isfinite(motion.q).all()


def test_recording_without_motion_is_refused(model, channels):
    times, found = channels
    only_imu = Recording.from_arrays(times, {"imu.angular_rate": found["imu.angular_rate"]})
    with pytest.raises(RecordingError, match="nothing about the motion"):
        replay(model, only_imu)


def test_states_are_resampled_on_the_manifold(model, trajectory):
    coarse: States = trajectory.states(np.linspace(1.0, 5.0, 9))
    motion = replay(model, coarse, fps=10.0).motion
    np.testing.assert_allclose(motion.time, np.arange(1.0, 5.05, 0.1))
    np.testing.assert_allclose(motion.q[::5], coarse.q, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(motion.q[:, 3:7], axis=1), 1.0, atol=1e-12)


def test_speed_spaces_the_frames_and_too_many_are_thinned(model, trajectory):
    fast = replay(model, trajectory, fps=20.0, speed=3.0)
    assert np.diff(fast.motion.time) == pytest.approx(0.15)
    assert fast.frame_rate == pytest.approx(20.0)
    thin = replay(model, trajectory, max_frames=31)
    assert len(thin.motion.time) == 31
    assert thin.frame_rate * 0.2 == pytest.approx(1.0)


@pytest.mark.parametrize("wrong", [{"fps": 0.0}, {"speed": -1.0}, {"max_frames": 1}])
def test_senseless_rates_are_refused(model, trajectory, wrong):
    with pytest.raises(SmsidError):
        replay(model, trajectory, **wrong)


def test_states_of_another_spacecraft_are_refused(model, trajectory):
    states = trajectory.states(np.array([0.0, 1.0]))
    wrong = States(states.time, states.q[:, :-1], states.v, states.a, states.tau, states.reaction)
    with pytest.raises(SmsidError, match="do not fit"):
        replay(model, wrong)


def test_exaggeration_is_stated(model, trajectory):
    notes = replay(model, trajectory, look=Look(panel_factor=5.0)).notes
    assert "deflection of appendages drawn 5 times larger" in notes


def test_fuel_stays_in_its_tank_and_the_view_says_how(model, trajectory):
    played = replay(model, trajectory, look=Look(slosh_factor=1000.0))
    drawn = np.linalg.norm(played.frames.q[:, model.slosh[0].q], axis=1).max()
    tank = played.scene.part("spacecraft/root_joint/tank.tank").half_size[0]
    ball = played.scene.part("spacecraft/root_joint/tank/ball").half_size[0]
    assert drawn + ball < tank < 3.5 * ball
    assert any(note.startswith("slosh drawn") for note in played.notes)


def test_a_view_of_files_is_a_page(channels, tmp_path):
    pytest.importorskip("meshcat")
    times, found = channels
    names = ("pose.position", "pose.attitude", "truth.slosh_position")
    save_recording(Recording.from_arrays(times, {k: found[k] for k in names}), tmp_path / "rec.nc")
    craft = load_description(URDF / "paper_sms.toml")
    view = build_replay(craft, [load_recording(tmp_path / "rec.nc")])
    page = write_view(view, tmp_path / "view.html")
    assert page.stat().st_size > 1e6
    assert any("joint angles" in note for note in view.notes)
    home = build_replay(load_description(URDF / "two_arm_sms.toml"))
    assert write_view(home, tmp_path / "home.html").is_file()
