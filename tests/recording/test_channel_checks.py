"""Faults of single components are named; sound recordings are left alone."""

from __future__ import annotations

import importlib
import math
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import median_filter
from scipy.spatial.transform import Rotation

from smsid.errors import InconsistentChannelsError
from smsid.estimation.flight import flight_of
from smsid.estimation.identify import identify_spacecraft
from smsid.estimation.parameter_vector import Point
from smsid.recording import Recording
from smsid.recording.checks import channel_findings, sample_faults
from smsid.recording.checks.sample_faults import running_median

from .samples import recording

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def benchmark():
    sys.path.insert(0, str(ROOT / "benchmarks"))
    try:
        return importlib.import_module("channel_faults")
    finally:
        sys.path.pop(0)


def test_a_sound_recording_has_no_findings():
    assert channel_findings(recording()) == ()


def test_faults_of_a_sample_are_named_and_clean_ones_left_alone(benchmark):
    names = ("satellite without arm", "arm")
    rows = [row | benchmark.named(row, faulty) for row, faulty in benchmark.planted(3, 20, names)]
    assert sum(row["right"] for row in rows) >= 19
    assert not any("nan" in sentence.split() for row in rows for sentence in row["said"])
    for name in names:
        assert benchmark.KINDS[name].make(4).suspicious() == []


def test_what_matters_is_refused_or_said_by_identify(benchmark):
    kind = benchmark.KINDS["arm"]
    sound = kind.make(5)
    clean = kind.identify(sound)
    assert not any("doubtful" in note for note in clean.notes)
    channel = "encoder.joint_position"
    row = {"recording": "arm", "channel": channel}
    samples = np.array(sound[channel])
    turned = samples * [1.0, -1.0, 1.0]
    refused = benchmark.identified(row, sound.with_channels({channel: turned}), lambda: clean)
    assert refused["outcome"] == "refused" and "joint2" in refused["by"]
    held = samples[10 * (np.arange(len(samples)) // 10)]
    said = benchmark.identified(row, sound.with_channels({channel: held}), lambda: clean)
    assert said["outcome"].endswith(", said") and "changes at every 10th sample only" in said["says"][0]
    with_error = np.array(samples)
    with_error[7::50, 1] += 2.0
    left_out = benchmark.identified(row, sound.with_channels({channel: with_error}), lambda: clean)
    assert left_out["outcome"] == "right, said"
    assert any("80 isolated outliers of 'encoder.joint_position' joint2" in n for n in left_out["says"])


def test_swapped_axes_are_refused_with_their_evidence(benchmark):
    rec = benchmark.KINDS["satellite without arm"].make(1)
    swapped = rec.with_channels({"gyro.angular_rate": rec["gyro.angular_rate"][:, [1, 0, 2]]})
    with pytest.raises(InconsistentChannelsError, match="x and y are swapped") as caught:
        swapped.check()
    evidence = caught.value.evidence
    assert evidence["channel"] == "gyro.angular_rate"
    assert evidence["components"] == ("x", "y")
    crossed, straight = evidence["numbers"]
    assert crossed > 0.95 > straight + 0.2


def test_an_unchecked_recording_passes_and_says_so(benchmark):
    rec = benchmark.KINDS["arm"].make(1)
    rate = np.array(rec["encoder.joint_velocity"])
    rate[:, 1] *= -1.0
    wrong = rec.with_channels({"encoder.joint_velocity": rate})
    with pytest.raises(InconsistentChannelsError, match=r"joint2.*sign"):
        wrong.check()
    passed = wrong.unchecked()
    assert passed.check() is passed
    assert passed.provenance["unchecked"] is True


@pytest.mark.parametrize("shift", [-1, 1])
def test_both_wrong_orders_of_a_quaternion_are_named(benchmark, shift):
    rec = benchmark.KINDS["satellite without arm"].make(2)
    wrong = rec.with_channels({"tracker.attitude": np.roll(rec["tracker.attitude"], shift, axis=1)})
    (finding,) = channel_findings(wrong)
    assert (finding.kind, finding.channel, finding.clear) == ("quaternion", "tracker.attitude", True)


def test_a_jump_by_a_full_turn_is_named_without_a_rate(benchmark):
    rec = benchmark.KINDS["arm"].make(1).without("encoder.joint_velocity")
    angle = np.array(rec["encoder.joint_position"])
    angle[:, 0] = (angle[:, 0] - np.median(angle[:, 0])) % (2.0 * math.pi) - math.pi
    (finding,) = channel_findings(rec.with_channels({"encoder.joint_position": angle}))
    assert (finding.kind, finding.components, finding.clear) == ("full turn", ("joint1",), True)


def test_a_component_without_motion_is_not_judged(benchmark):
    rec = benchmark.KINDS["arm"].make(1)
    rng = np.random.default_rng(0)
    noise = {name: 1e-4 * rng.standard_normal(rec[name].shape) for name in rec.channels}
    assert channel_findings(rec.with_channels(noise)) == ()


@pytest.mark.parametrize("start", [0.0, 1.7e9])
def test_a_rate_that_stays_the_same_is_not_stuck_whenever_the_clock_began(start):
    t = start + 0.01 * np.arange(48)
    q = np.column_stack([np.sin(t - start), 4.0 * (t - start) - 3.0]).round(6)
    rate = np.column_stack([np.cos(t - start), np.full(t.size, 4.0)]).round(6)
    one = Recording.from_arrays(t, {"log.joint_position": q, "log.joint_velocity": rate})
    assert not one.suspicious()


def test_what_a_knock_makes_ring_is_no_outlier():
    rng = np.random.default_rng(0)
    t = np.arange(0.0, 60.0, 1.0 / 425.0)
    x = 5e-3 * rng.standard_normal((t.size, 3))
    for begin in (10.0, 30.0, 50.0):  # half a period of 150 Hz is less than two samples
        after = np.clip(t - begin, 0.0, None)
        x[:, 2] += 0.5 * np.exp(-after / 0.02) * np.sin(2.0 * np.pi * 150.0 * after)
    knocked = Recording.from_arrays(t, {"phone.acceleration": x})
    assert channel_findings(knocked) == ()
    x[[2000, 9000], 2] += 0.5
    (finding,) = channel_findings(Recording.from_arrays(t, {"phone.acceleration": x}))
    assert (finding.kind, finding.components, finding.numbers[0]) == ("outlier", ("z",), 2.0)


def _there_and_back(late: float) -> Recording:
    """Give an angle that goes out, rests and comes back, several times, and its rate, ``late`` [s]."""
    t = np.arange(0.0, 60.0, 0.01)
    way = np.clip((np.abs((t % 12.0) - 6.0) - 1.5) / 3.0, 0.0, 1.0)
    angle = np.round(0.4 * (3.0 * way**2 - 2.0 * way**3), 6)
    rate = np.interp(t - late, t, np.gradient(angle, t))
    rate += 1e-4 * np.random.default_rng(0).standard_normal(t.size)
    channels = {"encoder.joint_position": angle[:, None], "encoder.joint_velocity": rate[:, None]}
    return Recording.from_arrays(t, channels, labels={"joint": ["lift"]})


def test_an_angle_that_rests_at_a_turn_is_not_saturated_because_its_rate_is_late():
    assert channel_findings(_there_and_back(0.0)) == ()
    (finding,) = channel_findings(_there_and_back(0.2))
    assert (finding.kind, finding.channel) == ("delay", "encoder.joint_velocity")
    assert finding.numbers[0] == pytest.approx(0.2, abs=0.021)
    assert "under a source of its own" in finding.mend


@pytest.mark.parametrize(("kind", "turns"), [("stuck", 16.0), ("saturated", 16.0), ("saturated", 60.0)])
def test_a_sensor_that_stops_where_it_stands_is_stuck_and_no_range_that_ends(kind, turns):
    """For the last 3 s of 80 a position stood at its smallest value: refused by ``diagnose`` as saturated."""
    t = 0.01 * np.arange(6000)
    rng = np.random.default_rng(0)
    x = 0.3 * np.sin(2.0 * np.pi * t / turns)  # one slew, or several
    rate = np.gradient(x, t) + 1e-4 * rng.standard_normal(t.size)
    x = x + 1e-5 * rng.standard_normal(t.size)
    if kind == "stuck":  # where it was last, as it went on
        rate, x = rate + 0.2, x + 0.2 * t
        x[5700:] = x[5699] = x[:5700].max() + 1e-6
    else:
        x = np.minimum(x, 0.295)
    channels = {"encoder.joint_position": x[:, None], "encoder.joint_velocity": rate[:, None]}
    (finding,) = channel_findings(Recording.from_arrays(t, channels, labels={"joint": ["lift"]}))
    assert (finding.kind, finding.channel, finding.clear) == (kind, "encoder.joint_position", True)
    assert finding.of_a_sensor is (kind == "stuck")
    assert f"is {kind} at" in finding.sentence


def test_missing_samples_and_gaps_hide_no_contradiction(benchmark):
    rec = benchmark.KINDS["satellite without arm"].make(1)
    rate = np.array(rec["gyro.angular_rate"][:, [1, 0, 2]])
    rate[500:520, 1] = np.nan
    t = np.array(rec.time())
    t[2000:] += 30.0
    channels = {n: np.array(rec[n]) for n in rec.channels} | {"gyro.angular_rate": rate}
    sound = channels | {"gyro.angular_rate": np.where(np.isnan(rate), np.nan, rec["gyro.angular_rate"])}
    assert Recording.from_arrays(t, sound, labels=rec.labels).check_consistency() == ()
    with pytest.raises(InconsistentChannelsError, match="x and y are swapped"):
        Recording.from_arrays(t, channels, labels=rec.labels).check_consistency()


def test_contradictions_are_worked_out_once(benchmark, monkeypatch):
    rec = benchmark.KINDS["arm"].make(1)
    calls = []
    monkeypatch.setattr(
        "smsid.recording.checks.channel_findings", lambda r: calls.append(r) or channel_findings(r)
    )
    assert rec.check().suspicious() == [] and rec.check_consistency() == ()
    assert len(calls) == 1


def test_a_filter_refuses_what_is_beyond_doubt_and_says_the_rest(benchmark):
    rec = benchmark.KINDS["satellite without arm"].make(1)
    wrong = rec.with_channels({"gyro.angular_rate": rec["gyro.angular_rate"][:, [1, 0, 2]]})
    described = _faulty_satellite()
    with pytest.raises(InconsistentChannelsError, match="swapped"):
        identify_spacecraft(described, [wrong], method="filter")
    point = Point.of(described)
    assert any("doubtful" in n and "swapped" in n for n in flight_of(point, wrong.unchecked(), "sat").notes)
    assert not any("doubtful" in n for n in flight_of(point, rec, "sat").notes)


@pytest.mark.parametrize("degrees", [77.0, -100.0])
def test_a_sensor_that_is_turned_has_no_axes_exchanged(benchmark, degrees):
    """An attitude 1.35 rad off was refused: "x and y are swapped and x turned round" (0.97 crossed)."""
    rec = benchmark.KINDS["satellite without arm"].make(1)
    turn = Rotation.from_euler("z", degrees, degrees=True)
    found = [
        rec.with_channels({"gyro.angular_rate": rec["gyro.angular_rate"] @ m.T}).contradictions().findings
        for m in (turn.as_matrix(), np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    ]
    (turned,) = [f for f in found[0] if f.channel == "gyro.angular_rate"]
    assert turned.kind == "turned" and turned.of_a_sensor and turned.clear
    assert turned.numbers[0] == pytest.approx(abs(degrees), abs=1.0)
    (swapped,) = [f for f in found[1] if f.channel == "gyro.angular_rate"]
    assert swapped.kind == "swapped" and not swapped.of_a_sensor


def _faulty_satellite():
    return importlib.import_module("_faulty_recordings")._satellite()


@pytest.mark.parametrize("channel", ["encoder.joint_position", "encoder.joint_velocity"])
def test_a_single_reading_of_1e300_is_named_and_refused(benchmark, channel):
    rec = benchmark.KINDS["arm"].make(1)
    values = np.array(rec[channel])
    values[700, 1] = 1e300
    wrong = rec.with_channels({channel: values})
    (sentence,) = wrong.suspicious()
    assert f"'{channel}' joint2 has 1 isolated outliers" in sentence
    with pytest.raises(InconsistentChannelsError, match=r"joint2.*1e\+300"):
        wrong.check()


def test_a_fault_of_a_long_recording_is_found_by_some_of_its_spans():
    """Sixty thousand samples and more: spans begin at every other one."""
    long = recording(70_001)
    assert not long.contradictions().findings
    name, rate = "encoder.joint_velocity", long["encoder.joint_velocity"]
    found = long.with_channels({name: rate[:, ::-1]}).contradictions().findings
    assert [(f.kind, f.channel) for f in found if f.other == "encoder.joint_position"] == [("swapped", name)]
    late = np.column_stack([np.interp(long.time() - 0.3, long.time(), x) for x in rate.T])
    found = long.with_channels({name: late}).contradictions().findings
    (delay,) = [f for f in found if f.other == "encoder.joint_position"]
    assert delay.kind == "delay" and delay.numbers[0] == pytest.approx(0.3, abs=0.02)


@pytest.mark.parametrize("count", [1, 3, 5000])
def test_the_running_median_is_that_of_scipy(count):
    x = np.random.default_rng(0).integers(0, 50, count).astype(float)  # with ties
    np.testing.assert_array_equal(running_median(x), median_filter(x, size=7, mode="nearest"))


def _turning(seed: int, flips: bool) -> Recording:
    """A craft that turns, attitude by scipy's rotations, the signs of quaternions as loggers choose."""
    rng = np.random.default_rng(seed)
    t = np.arange(1001) / 5.0
    phases, rates = rng.uniform(0.0, 6.0, (2, 3)), np.array([[0.05], [0.021]])
    rate = 0.03 * np.sum(np.sin(2.0 * np.pi * rates[:, :, None] * t + phases[:, :, None]), axis=0).T
    turn, q = Rotation.from_rotvec(rng.normal(size=3)), []
    for k in range(t.size):
        q.append(turn.as_quat())
        turn = turn * Rotation.from_rotvec(0.1 * (rate[k] + rate[min(k + 1, t.size - 1)]))
    quaternions = np.array(q) * (rng.choice([-1.0, 1.0], t.size) if flips else np.ones(t.size))[:, None]
    rate = rate + 1e-4 * rng.normal(size=rate.shape)
    return Recording.from_arrays(t, {"st.attitude": quaternions, "gyro.angular_rate": rate})


@pytest.mark.parametrize("seed", range(4))
def test_signs_of_quaternions_hide_no_convention_and_are_no_outliers(seed):
    sound, inverse = _turning(seed, flips=True), np.array([-1.0, -1.0, -1.0, 1.0])
    assert channel_findings(sound) == ()
    q = np.array(sound["st.attitude"])
    for wrong, words in ((q * inverse, "inertial to body"), (np.roll(q, 1, axis=1), "order w x y z")):
        with pytest.raises(InconsistentChannelsError, match=words):
            sound.with_channels({"st.attitude": wrong}).check()
    q[400] = [0.5, -0.5, 0.5, -0.5]  # nor does a wild sample switch the check off
    found = channel_findings(sound.with_channels({"st.attitude": q * inverse}))
    assert {f.kind for f in found} == {"outlier", "quaternion"}
    held = np.repeat(_turning(seed, flips=False)["st.attitude"][:250], 4, axis=0)
    signs = np.where(np.arange(1000) % 3, 1.0, -1.0)[:, None]
    clock = sound.time("st.attitude")[:1000]
    findings = channel_findings(Recording.from_arrays(clock, {"st.attitude": held * signs}))
    assert [f.kind for f in findings] == ["held"]


def test_an_outlier_within_the_range_is_told_by_its_distance():
    t = np.arange(2000) / 10.0
    x = np.sin(0.05 * t) + 1e-3 * np.random.default_rng(0).normal(size=t.size)
    x[315] = -0.4  # where the angle is 1: the rest reaches 1 as well
    found = sample_faults.outlier_finding("encoder.joint_position", "joint1", t, x)
    assert found is not None
    assert "up to 1.399 off the samples around them, the rest at most 0.00" in found.sentence
