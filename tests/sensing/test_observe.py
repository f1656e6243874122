"""Recordings from exact values: rates, clocks, exact delays, noise that depends on the channel alone."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from smsid.errors import RecordingError
from smsid.recording import Recording
from smsid.sensing import Sensor, add_noise, observe, sample_times

from .statistics import sigma_band

OMEGA = 2 * np.pi * 1.3
SPIN = np.array([0.1, -0.2, 0.5])


def truth(times):
    t = np.asarray(times)[:, None]
    wave = np.sin(OMEGA * t + np.arange(3))
    return {
        "imu.acceleration": wave,
        "imu.angular_rate": np.broadcast_to(SPIN, wave.shape),
        "gyro.angular_rate": wave,
        "pose.position": wave,
        "pose.velocity": OMEGA * np.cos(OMEGA * t + np.arange(3)),
        "pose.attitude": Rotation.from_rotvec(t * SPIN).as_quat(),
        "encoder.joint_position": wave[:, :2],
        "encoder.joint_velocity": wave[:, 1:],
        "panel.acceleration": np.stack((wave, 2 * wave), axis=1),
        "command.force": np.sign(wave),
    }


def run(*sensors, seed=0, stop=2.0, **options):
    return observe(truth, sensors, start=0.5, stop=stop, rng=np.random.default_rng(seed), **options)


def imu(**fields):
    return Sensor(**{"name": "imu", "kind": "imu", "rate": 100.0, **fields})


def test_perfect_sensors_record_the_truth_each_on_its_clock():
    recording = run(
        imu(),
        Sensor(name="pose", kind="pose", rate=30.0),
        Sensor(name="encoder", kind="encoder", rate=100.0),
        Sensor(name="panel", kind="accelerometers", rate=250.0, appendage="panel", stations=(0, 3)),
    )
    assert set(recording.clocks) == {"time", "imu.time", "encoder.time", "pose.time"}
    for channel in recording.channels:
        assert np.allclose(recording[channel], truth(recording.time(channel))[channel], atol=1e-12)
    assert np.allclose(recording.time("pose"), 0.5 + np.arange(46) / 30.0)
    assert recording.time()[-1] == pytest.approx(2.0) and recording.time().size == 376


def test_sensors_at_the_shared_rate_have_no_clock_of_their_own():
    recording = run(imu(), Sensor(name="encoder", kind="encoder", rate=100.0))
    assert recording.clocks == ("time",)


def test_the_shared_rate_can_be_chosen_and_carries_the_exact_channels():
    recording = run(imu(), rate=50.0, exact=["command.force"])
    assert set(recording.clocks) == {"time", "imu.time"}
    assert np.array_equal(recording["command.force"], truth(recording.time())["command.force"])
    assert set(run(imu(), rate=50.0).clocks) == {"imu.time"}


def test_delay_is_exact_on_a_sine():
    delay = 0.0123
    recording = run(imu(rate=7.0, errors={"acceleration": {"delay": delay}}), stop=10.0)
    t = recording.time("imu")
    assert np.allclose(
        recording["imu.acceleration"][1:], np.sin(OMEGA * (t[1:, None] - delay) + np.arange(3))
    )
    assert np.allclose(recording["imu.acceleration"][0], np.sin(OMEGA * 0.5 + np.arange(3)))
    assert np.array_equal(recording["imu.angular_rate"], np.tile(SPIN, (t.size, 1)))


def test_no_time_before_the_start_is_asked_for():
    asked = []

    def spy(times):
        asked.append(times)
        return truth(times)

    slow = imu(errors={"acceleration": {"delay": 0.2}})
    observe(spy, [slow], start=0.5, stop=1.0, rng=np.random.default_rng(0))
    assert len(asked) == 2 and min(a.min() for a in asked) == 0.5


def test_noise_has_the_stated_sigma():
    recording = run(imu(preset="reference"), stop=100.0)
    n = recording.time().size
    low, high = sigma_band(n, 6)
    for channel, sigma in {"imu.acceleration": 1e-4, "imu.angular_rate": 1e-5}.items():
        error = recording[channel] - truth(recording.time())[channel]
        ratio = error.std(axis=0, ddof=1) / sigma
        assert np.all((ratio > low) & (ratio < high))


def test_density_follows_the_rate_of_the_sensor():
    noisy = {"acceleration": {"noise_density": 1e-3}}
    for rate in (25.0, 400.0):
        recording = run(imu(rate=rate, errors=noisy), stop=100.0)
        error = recording["imu.acceleration"] - truth(recording.time())["imu.acceleration"]
        low, high = sigma_band(error.size, 2)
        assert low < error.std() / (1e-3 * np.sqrt(rate)) < high


def test_noise_depends_on_the_channel_and_not_on_the_company():
    noisy = [imu(preset="stim300"), Sensor(name="pose", kind="pose", preset="reference")]
    alone, both, turned = run(noisy[0]), run(*noisy), run(*noisy[::-1])
    for channel in alone.channels:
        assert np.array_equal(alone[channel], both[channel])
    for channel in both.channels:
        assert np.array_equal(both[channel], turned[channel])


def test_the_same_seed_repeats_and_the_same_generator_does_not():
    assert run(imu(preset="reference")).equals(run(imu(preset="reference")))
    rng = np.random.default_rng(0)
    first, second = (observe(truth, [imu(preset="reference")], start=0, stop=1, rng=rng) for _ in range(2))
    assert not np.any(first["imu.acceleration"] == second["imu.acceleration"])


def test_channels_and_sensors_have_unlike_noise():
    a, b = (
        imu(errors={"angular_rate": {"noise_sigma": 1.0}}),
        imu(name="gyro", quantities=["angular_rate"], errors={"angular_rate": {"noise_sigma": 1.0}}),
    )
    recording = run(a, b, stop=20.0)
    t = truth(recording.time())
    one, two = (recording[c] - t[c] for c in ("imu.angular_rate", "gyro.angular_rate"))
    assert abs(np.corrcoef(one.ravel(), two.ravel())[0, 1]) < 4.0 / np.sqrt(one.size)


def test_provenance_names_sensors_and_seed_and_keeps_what_is_given():
    recording = run(imu(preset="stim300"), provenance={"engine": "sine"}, role="validation", name="run 7")
    sensing = recording.provenance["sensing"]
    assert recording.provenance["engine"] == "sine"
    assert (recording.role, recording.name) == ("validation", "run 7")
    assert sensing["sensors"][0]["preset"] == "stim300" and sensing["entropy"] == "0"
    assert Sensor(**sensing["sensors"][0]) == imu(preset="stim300", rate=100.0)


def test_labels_reach_the_recording():
    recording = run(Sensor(name="encoder", kind="encoder", rate=10.0), labels={"joint": ["elbow", "wrist"]})
    assert recording.labels["joint"] == ("elbow", "wrist")


def test_what_the_truth_lacks_is_named():
    with pytest.raises(RecordingError, match="wheel_rate") as caught:
        run(Sensor(name="wheels", kind="tachometer", rate=10.0))
    assert "imu.acceleration" in caught.value.evidence["available"]


@pytest.mark.parametrize(
    ("sensors", "options"),
    [
        ([imu(), imu()], {}),
        ([], {}),
        ([imu()], {"stop": 0.4}),
        ([imu()], {"stop": np.inf}),
        ([imu()], {"rate": -1.0}),
        ([imu()], {"exact": ["imu.acceleration"]}),
    ],
)
def test_observations_that_make_no_sense_are_refused(sensors, options):
    with pytest.raises(RecordingError):
        run(*sensors, **options)


@pytest.mark.parametrize("rate", [3.0, 10.0, 30.0, 100.0, 1000.0 / 7.0])
def test_sample_times_end_at_the_stop_and_are_even(rate):
    times = sample_times(2.0, 2.0 + 70.0 / rate, rate)
    assert times.size == 71 and np.allclose(np.diff(times), 1.0 / rate)


def clean(rate=200.0, stop=10.0, **values):
    t = sample_times(0.0, stop, rate)
    found = {c: v for c, v in truth(t).items() if c.split(".")[0] in ("imu", "pose", "command")}
    return Recording.from_arrays(
        t, {**found, **values}, role="validation", name="clean", provenance={"engine": "x"}
    )


def test_add_noise_keeps_the_rest_and_notes_the_step():
    before = clean()
    after = add_noise(
        before, [imu(rate=200.0, errors={"acceleration": {"noise_sigma": 0.1}})], np.random.default_rng(1)
    )
    assert after.clocks == ("time",) and set(after.channels) == set(before.channels)
    assert (after.role, after.name, after.provenance["engine"]) == ("validation", "clean", "x")
    assert after.provenance["steps"][-1]["add_noise"]["sensors"][0]["name"] == "imu"
    for channel in set(before.channels) - {"imu.acceleration"}:
        assert np.array_equal(before[channel], after[channel])
    error = after["imu.acceleration"] - before["imu.acceleration"]
    low, high = sigma_band(error.size, 1)
    assert low < error.std() / 0.1 < high


def test_add_noise_equals_observe_on_the_same_samples():
    sensor = imu(preset="stim300", rate=200.0)
    observed = observe(truth, [sensor], start=0.0, stop=10.0, rng=np.random.default_rng(3))
    added = add_noise(clean(), [sensor], np.random.default_rng(3))
    assert np.allclose(observed["imu.acceleration"], added["imu.acceleration"], atol=1e-12)


def test_add_noise_resamples_slower_sensors_and_delays_them():
    delay = 0.0137
    pose = Sensor(
        name="pose",
        kind="pose",
        rate=30.0,
        errors={q: {"delay": delay} for q in ("position", "attitude", "velocity")},
    )
    after = add_noise(clean(), [pose], np.random.default_rng(0))
    t = after.time("pose")
    assert np.allclose(t, np.arange(t.size) / 30.0) and set(after.clocks) >= {"time", "pose.time"}
    exact = truth(t[1:] - delay)
    assert np.allclose(after["pose.position"][1:], exact["pose.position"], atol=1e-6)
    assert np.allclose(after["pose.attitude"][1:], exact["pose.attitude"], atol=1e-9)


def test_add_noise_samples_a_faster_sensor_where_the_recording_is():
    fast = imu(rate=2000.0, errors={"angular_rate": {"noise_density": 1e-3}})
    after = add_noise(clean(stop=100.0), [fast], np.random.default_rng(0))
    error = after["imu.angular_rate"] - SPIN
    low, high = sigma_band(error.size, 1)
    assert low < error.std() / (1e-3 * np.sqrt(200.0)) < high


def test_add_noise_drops_what_the_sensor_does_not_measure():
    tracker = Sensor(name="pose", kind="pose", rate=10.0, quantities=["attitude"])
    after = add_noise(clean(), [tracker], np.random.default_rng(0))
    assert "pose.position" not in after and "pose.attitude" in after
    assert after.provenance["steps"][-1]["add_noise"]["dropped"] == ["pose.velocity", "pose.position"] or set(
        after.provenance["steps"][-1]["add_noise"]["dropped"]
    ) == {"pose.velocity", "pose.position"}


def test_add_noise_refuses_missing_channels_and_uneven_times():
    with pytest.raises(RecordingError, match="wheel_rate"):
        add_noise(clean(), [Sensor(name="wheels", kind="tachometer", rate=10.0)], np.random.default_rng(0))
    t = np.array([0.0, 0.1, 0.2, 0.5, 0.6])
    uneven = Recording.from_arrays(
        t, {"imu.acceleration": np.zeros((5, 3)), "imu.angular_rate": np.zeros((5, 3))}
    )
    with pytest.raises(RecordingError, match="evenly"):
        add_noise(uneven, [imu()], np.random.default_rng(0))
