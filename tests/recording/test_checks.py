from __future__ import annotations

import numpy as np
import pytest

from smsid.errors import RecordingError
from smsid.recording import Recording

from .samples import motion, recording

T = np.arange(200) / 10.0
RATE = np.sin(T)[:, None] * np.ones(3)


def of(time: np.ndarray, rate: np.ndarray = RATE) -> Recording:
    return Recording.from_arrays(time, {"imu.angular_rate": rate})


def test_a_sound_recording_passes_and_comes_back():
    rec = recording()
    assert rec.check() is rec
    assert rec.suspicious() == []
    assert rec.gaps() == ()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_samples_that_are_not_finite_are_named(value):
    rate = RATE.copy()
    rate[7:10, 1] = value
    with pytest.raises(RecordingError, match=r"'imu.angular_rate' is -?(nan|inf) at index 7 ") as caught:
        of(T, rate).check()
    assert caught.value.evidence == {
        "channel": "imu.angular_rate",
        "index": (7, 1),
        "time": pytest.approx(0.7),
        "count": 3,
    }


@pytest.mark.parametrize(("value", "word"), [(0.3, "goes back"), (0.4, "stands still")])
def test_time_that_does_not_increase_is_named(value, word):
    time = T.copy()
    time[5] = value
    with pytest.raises(RecordingError, match=f"'time' {word} at index 5: 0.4 s, then {value} s") as caught:
        of(time).check()
    assert caught.value.evidence["values"] == (0.4, value)


def test_a_time_that_is_nan_is_named():
    time = T.copy()
    time[3] = np.nan
    with pytest.raises(RecordingError, match="Clock 'time' is nan at index 3"):
        of(time).check()


def test_the_clock_of_a_source_is_checked_too():
    rec = Recording.from_arrays(T, {"pose.position": RATE, "imu.angular_rate": (T[::-1], RATE)})
    with pytest.raises(RecordingError, match=r"'imu.time' goes back at index 1"):
        rec.check()


def test_gaps_are_found_with_place_and_length():
    time = np.where(T > 5.0, T + 2.0, T)
    rec = of(time)
    (gap,) = rec.gaps()
    assert (gap.clock, gap.start, gap.end) == ("time", pytest.approx(5.0), pytest.approx(7.1))
    assert gap.duration == pytest.approx(2.1)
    with pytest.raises(RecordingError, match=r"gap of 2.1 s from t = 5 s \(21.0 steps\)"):
        rec.check()
    rec.window(0.0, 5.05).check()


def test_a_step_of_five_medians_is_no_gap_yet():
    time = np.arange(20.0)
    time[10:] += 4.0
    assert of(time, RATE[:20]).gaps() == ()
    time[10:] += 0.001
    assert len(of(time, RATE[:20]).gaps()) == 1


def test_the_place_of_a_gap_is_told_where_stamps_count_from_1970():
    t = np.delete(1.764e9 + 0.1 * np.arange(600), np.arange(311, 330))
    with pytest.raises(RecordingError, match="from t = 1764000031 s, 31 s after the start"):
        Recording.from_arrays(t, {"imu.angular_rate": np.zeros((t.size, 3))}).check()


def test_quaternions_off_the_unit_norm_are_named():
    q = np.tile([0.0, 0.0, 0.0, 1.0], (200, 1))
    q[9] *= 1.01
    with pytest.raises(RecordingError, match="quaternion at index 9") as caught:
        Recording.from_arrays(T, {"pose.attitude": q}).check()
    assert caught.value.evidence["norm"] == pytest.approx(1.01)
    q[9] = [0.0, 0.0, 0.0, 1.0005]
    Recording.from_arrays(T, {"pose.attitude": q}).check()


DEGREE, GRAVITY = 180.0 / np.pi, 9.80665


@pytest.mark.parametrize(
    ("channel", "factor", "words"),
    [
        ("encoder.joint_position", DEGREE, "'encoder.joint_position' is probably in degrees, not in rad"),
        ("encoder.joint_velocity", DEGREE, "'encoder.joint_velocity' is probably in degrees, not in rad/s"),
        ("encoder.joint_velocity", 30 / np.pi, "'encoder.joint_velocity' is probably in rpm, not in rad/s"),
        ("imu.angular_rate", DEGREE, "'imu.angular_rate' is probably in degrees, not in rad/s"),
        (
            "imu.angular_rate",
            1 / DEGREE,
            "'imu.angular_rate' is probably in rad/s already, but was taken for deg",
        ),
        (
            "imu.angular_rate",
            np.pi / 30,
            "'imu.angular_rate' is probably in rad/s already, but was taken for rpm",
        ),
        ("imu.acceleration", 1 / GRAVITY, "'imu.acceleration' is probably in units of standard gravity"),
        ("imu.acceleration", 1000.0, "'imu.acceleration' is probably too large by 1000"),
        ("imu.acceleration", 1000.0 / GRAVITY, "thousandths of standard gravity"),
        ("pose.position", 1000.0, "'pose.position' is probably too large by 1000"),
        ("imu.acceleration", -1.0, "wrong sign"),
        ("encoder.joint_position", -DEGREE, "in degrees, not in rad, and one of them has the wrong sign"),
    ],
)
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_swapped_units_are_named_with_and_without_noise(channel, factor, words, noise):
    rec = recording(3001)
    scale = np.std(rec[channel])
    noisy = rec[channel] + noise * scale * np.random.default_rng(1).normal(size=rec[channel].shape)
    rec = rec.with_channels({channel: factor * noisy})
    assert any(words in sentence for sentence in rec.suspicious())
    with pytest.raises(RecordingError) as caught:
        rec.check()
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("reading", "words"),
    [
        (lambda q: np.roll(q, 1, axis=1), "order w x y z, not x y z w"),
        (lambda q: q * [-1, -1, -1, 1], "inertial to body"),
        (lambda q: np.roll(q * [-1, -1, -1, 1], 1, axis=1), "order w x y z and inertial to body"),
    ],
)
def test_other_quaternion_conventions_are_recognised(reading, words):
    rec = recording(3001)
    rec = rec.with_channels({"pose.attitude": reading(rec["pose.attitude"])})
    with pytest.raises(RecordingError, match=words):
        rec.check()


@pytest.mark.parametrize(
    ("factor", "words"),
    [(1e3, "clock is in ms"), (1e6, "in microseconds, not in s"), (1e9, "in nanoseconds")],
)
def test_a_clock_in_another_unit_is_named(factor, words):
    rec = recording(3001)
    wrong = Recording.from_arrays(factor * rec.time(), {n: rec[n] for n in rec.channels}, labels=rec.labels)
    with pytest.raises(RecordingError, match=words):
        wrong.check()


def test_one_joint_in_degrees_is_named_by_its_label():
    rec = recording(3001)
    rec = rec.with_channels({"encoder.joint_position": rec["encoder.joint_position"] * [1.0, DEGREE]})
    sentences = rec.suspicious()
    assert len(sentences) == 1
    assert "'encoder.joint_position' elbow is 57.3 times" in sentences[0]


def test_channels_on_different_clocks_are_compared():
    t, own = np.arange(3001) / 50.0, np.arange(1500) / 31.0 + 0.2
    channels = motion(t)
    late = {"imu.angular_rate": (own, DEGREE * motion(own)["imu.angular_rate"])}
    rec = Recording.from_arrays(t, {"pose.attitude": channels["pose.attitude"], **late})
    assert "in degrees" in rec.suspicious()[0]


def test_an_odd_scale_is_suspicious_but_no_error():
    rec = recording(3001)
    rec = rec.with_channels({"encoder.joint_position": 3.0 * rec["encoder.joint_position"]})
    assert all("scale factor" in sentence for sentence in rec.suspicious())
    assert len(rec.suspicious()) == 2
    rec.check()


@pytest.mark.parametrize("seed", range(20))
def test_unrelated_noise_and_a_scale_error_of_ten_percent_raise_no_suspicion(seed):
    rng = np.random.default_rng(seed)
    rec = recording(3001)
    rec = rec.with_channels(
        {
            "imu.acceleration": 1.1 * rec["imu.acceleration"] + rng.normal(size=(3001, 3)),
            "encoder.joint_position": rng.normal(size=(3001, 2)).cumsum(axis=0),
            "encoder.joint_velocity": 0.02 * rng.normal(size=(3001, 2)),
        }
    )
    assert rec.suspicious() == []


def test_a_locked_joint_is_not_judged():
    rec = recording(3001)
    still = {"encoder.joint_position": np.full((3001, 2), 0.4), "encoder.joint_velocity": np.zeros((3001, 2))}
    assert rec.without("encoder.joint_acceleration").with_channels(still).suspicious() == []
