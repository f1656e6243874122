"""Faults of single components are named; sound recordings are left alone."""

from __future__ import annotations

import importlib
import math
import sys
from pathlib import Path

import numpy as np
import pytest

from smsid.errors import InconsistentChannelsError
from smsid.recording import Recording
from smsid.recording.checks import channel_findings

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
    result = benchmark.measure(3, 20, 1, ("satellite without arm", "arm"))
    assert result["false_alarms"] == []
    assert result["named_rightly"] >= 19
    for row in result["faults"]:
        assert not any("nan" in sentence.split() for sentence in row["said"])


def test_swapped_axes_are_refused_with_their_evidence(benchmark):
    rec = benchmark.satellite(1)
    swapped = rec.with_channels({"gyro.angular_rate": rec["gyro.angular_rate"][:, [1, 0, 2]]})
    with pytest.raises(InconsistentChannelsError, match="x and y are swapped") as caught:
        swapped.check()
    evidence = caught.value.evidence
    assert evidence["channel"] == "gyro.angular_rate"
    assert evidence["components"] == ("x", "y")
    crossed, straight = evidence["numbers"]
    assert crossed > 0.95 > straight + 0.2


def test_an_unchecked_recording_passes_and_says_so(benchmark):
    rec = benchmark.arm(1)
    rate = np.array(rec["encoder.joint_velocity"])
    rate[:, 1] *= -1.0
    wrong = rec.with_channels({"encoder.joint_velocity": rate})
    with pytest.raises(InconsistentChannelsError, match=r"j2.*sign"):
        wrong.check()
    passed = wrong.unchecked()
    assert passed.check() is passed
    assert passed.provenance["unchecked"] is True


@pytest.mark.parametrize("shift", [-1, 1])
def test_both_wrong_orders_of_a_quaternion_are_named(benchmark, shift):
    rec = benchmark.satellite(2)
    wrong = rec.with_channels({"tracker.attitude": np.roll(rec["tracker.attitude"], shift, axis=1)})
    (finding,) = channel_findings(wrong)
    assert (finding.kind, finding.channel, finding.clear) == ("quaternion", "tracker.attitude", True)


def test_a_jump_by_a_full_turn_is_named_without_a_rate(benchmark):
    rec = benchmark.arm(1).without("encoder.joint_velocity")
    angle = np.array(rec["encoder.joint_position"])
    angle[:, 0] = (angle[:, 0] - np.median(angle[:, 0])) % (2.0 * math.pi) - math.pi
    (finding,) = channel_findings(rec.with_channels({"encoder.joint_position": angle}))
    assert (finding.kind, finding.components, finding.clear) == ("full turn", ("j1",), True)


def test_a_component_without_motion_is_not_judged(benchmark):
    rec = benchmark.arm(1)
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
