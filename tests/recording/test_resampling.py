from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from smsid.errors import RecordingError
from smsid.recording import Recording

from .samples import motion, recording


def test_resampling_at_the_samples_changes_nothing():
    rec = recording()
    again = rec.resampled(rec.time())
    for name in rec.channels:
        np.testing.assert_allclose(again[name], rec[name], atol=1e-15)
    assert again.labels == rec.labels


@pytest.mark.parametrize("rate", [7.0, 50.0, 123.4])
def test_a_rate_stays_inside_and_keeps_both_ends_if_it_meets_them(rate):
    new = recording().resampled(rate).time()
    assert new[0] == 0.0
    assert 20.0 - 1.0 / rate < new[-1] <= 20.0
    np.testing.assert_allclose(np.diff(new), 1.0 / rate, rtol=1e-9)


def test_interpolation_has_the_error_of_a_linear_one_and_attitudes_stay_unit():
    rec = recording()
    new = rec.resampled(333.0)
    for name, exact in motion(new.time()).items():
        np.testing.assert_allclose(new[name], exact, atol=2e-4)
    np.testing.assert_allclose(np.linalg.norm(new["pose.attitude"], axis=1), 1.0, atol=1e-15)
    assert new.provenance["steps"] == [{"resampled": {"start": 0.0, "samples": new.time().size}}]


def test_several_clocks_become_one_over_what_they_share():
    t, own = np.arange(100) / 10.0, np.arange(150) / 20.0 + 0.33
    channels = {"pose.position": motion(t)["pose.position"]}
    rec = Recording.from_arrays(t, {**channels, "imu.angular_rate": (own, motion(own)["imu.angular_rate"])})
    new = rec.resampled(20.0)
    assert new.clocks == ("time",)
    assert new.time()[0] == 0.33
    assert new.time()[-1] <= min(t[-1], own[-1])


@given(st.floats(0.05, 1.0), st.floats(-3.0, 3.0))
def test_linear_signals_are_reproduced(step, slope):
    t = np.arange(30) * 0.7
    rec = Recording.from_arrays(t, {"extra.ramp": slope * t + 1.0}, units={"extra.ramp": "1"})
    new = rec.resampled(1.0 / step)
    np.testing.assert_allclose(new["extra.ramp"], slope * new.time() + 1.0, atol=1e-12)


@pytest.mark.parametrize("times", [[-0.01, 1.0], [19.0, 20.01]])
def test_nothing_is_extrapolated(times):
    with pytest.raises(RecordingError, match="runs from 0 to 20 s"):
        recording().resampled(times)


def test_gaps_are_not_bridged():
    t = np.arange(100) / 10.0
    time = np.where(t > 5.0, t + 2.0, t)
    rec = Recording.from_arrays(time, {"pose.position": motion(time)["pose.position"]})
    with pytest.raises(RecordingError, match="lie in a gap"):
        rec.resampled(5.0)
    assert rec.resampled([1.0, 2.0, 7.5]).time().size == 3
    assert rec.window(0.0, 5.0).resampled(5.0).time().size == 26


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (0.0, "rate of 0.0"),
        (-1.0, "rate"),
        (float("nan"), "rate of nan"),
        ([2.0, 1.0], "goes back"),
        ([1.0, np.nan], "nan"),
        ([], "at least one sample"),
    ],
)
def test_senseless_rates_and_times_are_refused(asked, message):
    with pytest.raises(RecordingError, match=message):
        recording().resampled(asked)


def test_samples_that_are_not_finite_are_not_spread():
    holes = recording()["pose.position"].copy()
    holes[4] = np.nan
    with pytest.raises(RecordingError, match=r"'pose\.position' is nan"):
        recording().with_channels({"pose.position": holes}).resampled(10.0)


def test_clocks_without_common_time_are_refused():
    rec = Recording.from_arrays(
        [0.0, 1.0], {"pose.position": np.zeros((2, 3)), "imu.angular_rate": ([5.0, 6.0], np.zeros((2, 3)))}
    )
    with pytest.raises(RecordingError, match="no time in common"):
        rec.resampled(10.0)


def test_a_rate_that_no_memory_holds_is_refused_with_the_count():
    with pytest.raises(RecordingError, match=r"1e\+300 Hz over 20 s are 2e\+301 samples"):
        recording().resampled(1e300)


def test_a_valve_is_open_or_shut_at_any_rate():
    """What is on or off stays so between samples; a torque that varies is interpolated as readings are."""
    times = 0.1 * np.arange(101)
    valve = (np.sin(2 * np.pi * 0.3 * times) > 0.4).astype(float)[:, None]
    torque = np.sin(times)[:, None] * np.ones(3)
    recording = Recording.from_arrays(times, {"command.thruster": valve, "command.wheel_torque": torque})
    for rate in (7.0, 20.0):
        found = recording.resampled(rate)
        assert set(np.unique(found["command.thruster"])) == {0.0, 1.0}
        held = valve[np.floor(found.time() / 0.1 + 1e-6).astype(int)]
        assert np.array_equal(np.asarray(found["command.thruster"]).reshape(held.shape), held)
        assert np.abs(np.asarray(found["command.wheel_torque"])[:, 0] - np.sin(found.time())).max() < 2e-3


@pytest.mark.parametrize(("said", "between"), [("held", 0.0), ("linear", 0.05)])
def test_commands_go_on_as_the_recording_says(said, between):
    """A torque that varies, on a clock of 10 Hz; what it says holds as long as no sample of it is lost."""
    times = 0.1 * np.arange(101)
    recording = Recording.from_arrays(
        times, {"command.wheel_torque": times[:, None] * np.ones(3)}, provenance={"inputs": said}
    )
    finer = recording.resampled(20.0)
    torque = np.asarray(finer["command.wheel_torque"])[:, 0]
    np.testing.assert_allclose(torque[::2], times, atol=1e-9)
    np.testing.assert_allclose(torque[1::2], times[:-1] + between, atol=1e-9)
    assert finer.provenance["inputs"] == said
    assert "inputs" not in recording.resampled(15.0).provenance
    assert "inputs" not in recording.resampled(5.0).provenance
