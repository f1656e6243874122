"""Shares of a sample that valves are open for, as times at which they open and close."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.errors import RecordingError
from smsid.recording import import_recording
from smsid.recording._pulses import switching_times
from smsid.recording.mapping import parse_mapping

TIMES = np.array([0.0, 0.1, 0.2, 0.3])
SHARES = np.array([[0.0, 1.0], [0.4, 1.0], [1.0, 0.5], [0.25, 0.0]])


def opened(pulses):
    """Return when the first valve is open, as the table above says by hand."""
    return {
        "begin": [(0.1, 0.14), (0.2, 0.325)],
        "middle": [(0.13, 0.17), (0.2, 0.3), (0.3375, 0.3625)],
        "end": [(0.16, 0.3), (0.375, 0.4)],
    }[pulses]


@pytest.mark.parametrize("pulses", ["begin", "middle", "end"])
def test_a_valve_is_open_where_its_pulses_are(pulses):
    times, states = switching_times(TIMES, SHARES, pulses)
    at = np.linspace(0.0003, 0.3993, 400)
    held = states[np.searchsorted(times, at, side="right") - 1, 0]
    there = np.any([(low < at) & (at < high) for low, high in opened(pulses)], axis=0)
    np.testing.assert_array_equal(held, there)
    assert set(np.round(TIMES, 12)) <= set(np.round(times, 12)), "samples are rows, too: no gap between them"
    assert np.diff(times).min() > 1e-3 and not states[-1].any()


@pytest.mark.parametrize("pulses", ["begin", "middle", "end"])
def test_impulses_are_those_of_the_shares_on_any_clock(pulses):
    rng = np.random.default_rng(5)
    times = 1.7e9 + np.cumsum(rng.uniform(0.09, 0.11, 500))
    shares = rng.uniform(0.0, 1.0, (500, 3)) * (rng.uniform(size=(500, 3)) < 0.5)
    shares[100:120] = 1.0
    rows, states = switching_times(times, shares, pulses)
    impulse = np.diff(rows) @ states[:-1]
    np.testing.assert_allclose(
        impulse, np.append(np.diff(times), np.median(np.diff(times))) @ shares, atol=1e-4
    )
    assert states[(rows >= times[100]) & (rows < times[120])].all()


def mapped(**more):
    thruster = {"columns": ["on"], "unit": "1", "labels": ["t1"], "pulses": "begin"} | more
    return {"time": {"column": "t", "unit": "s"}, "channel": {"command.thruster": thruster}}


def written(folder, shares):
    path = folder / "log.csv"
    path.write_text("t,on\n" + "".join(f"{0.1 * k},{s}\n" for k, s in enumerate(shares)), encoding="utf-8")
    return path


def test_a_mapping_makes_them_of_a_log(tmp_path):
    file = written(tmp_path, [0.0, 0.5, 0.0, 1.0, 0.0])
    found = import_recording(file, parse_mapping(mapped()))
    times = found.time("command.thruster")
    np.testing.assert_allclose(times, [0.0, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5], atol=1e-12)
    np.testing.assert_array_equal(np.asarray(found["command.thruster"])[:, 0], [0, 1, 0, 0, 1, 0, 0])


def test_what_are_no_shares_or_no_thrusters_is_said(tmp_path):
    with pytest.raises(RecordingError, match=r"no pulses: 50 at index 1.*percent"):
        import_recording(written(tmp_path, [0.0, 50.0, 0.0]), parse_mapping(mapped()))
    percent = import_recording(written(tmp_path, [0.0, 50.0, 0.0]), parse_mapping(mapped(unit="%")))
    assert len(percent.time("command.thruster")) == 5
    wheel = {"columns": ["on"], "unit": "N m", "labels": ["rw1"], "pulses": "begin"}
    with pytest.raises(RecordingError, match="pulses are shares of thrust"):
        parse_mapping({"time": {"rate": 10.0}, "channel": {"command.wheel_torque": wheel}})
    beside = mapped()
    beside["channel"]["command.wheel_torque"] = {"columns": ["w"], "unit": "N m", "labels": ["rw1"]}
    with pytest.raises(RecordingError, match="clock of its own"):
        parse_mapping(beside)
