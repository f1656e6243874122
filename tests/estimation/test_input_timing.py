"""How commands act between samples is told by the recording, or found from it."""

from dataclasses import replace

import numpy as np
import pytest

from smsid.effects import ThrusterGain
from smsid.estimation.input_hold import bends_between_samples, locked_coordinates
from smsid.estimation.input_timing import timing_of, timings
from smsid.estimation.kalman import run_filter
from smsid.estimation.measurements import measurements_of
from smsid.estimation.problem import CommandTiming, Problem, ProcessNoise
from smsid.recording import Recording


@pytest.fixture(scope="module")
def thrust(flown):
    """Half a minute of the first experiment: thrust that switches, a torque that holds the attitude."""
    return flown("exp1", 30.0, 4)


def problem_of(point, recording):
    data = measurements_of(point.base, recording, point.description.effective_sensors()).thinned(25.0)
    return Problem(
        recording, data, locked_coordinates(point.base, recording), CommandTiming(), ProcessNoise()
    )


def test_thrust_that_switches_beside_a_torque_that_does_not(known, thrust):
    assert timing_of(known.point, problem_of(known.point, thrust)).hold == "jumps"


def test_found_also_where_the_model_does_not_follow(known, thrust):
    """With noise a thousandth of what it is, nothing is followed to it."""
    problem = problem_of(known.point, thrust)
    loud = replace(problem, data=problem.data.scaled(np.full(problem.data.rows, 1e-3)))
    weak = known.point.with_effect(ThrusterGain(name="weak", gain=(-0.002, -0.002, -0.002)))
    assert timing_of(weak, loud).hold == "jumps"


@pytest.mark.parametrize(("inputs", "side"), [("held", "left"), ("linear", "right")])
def test_told_by_the_recording(known, thrust, inputs, side):
    told = thrust.with_provenance({"inputs": inputs, "acceleration": f"limit from the {side}"})
    assert timings(told) == (CommandTiming(inputs, side),)
    assert timing_of(known.point, problem_of(known.point, told)) == CommandTiming(inputs, side)


def test_waves_vary(known, problem, recording):
    """Torques of the second experiment never jump: nothing to choose but held and linear."""
    assert {t.hold for t in timings(recording)} == {"held", "linear"}
    assert timing_of(known.point, problem).hold == "linear"


def test_slow_samples_of_what_varies_are_a_smooth_course(known, recording):
    """At 100 Hz the paper's waves do not bend between samples; at 20 Hz they do, by more than what is known
    to 1e-4 bears, and at 5 Hz are followed so.
    """
    at_20_hz = Recording.from_arrays(
        recording.time("imu.angular_rate")[::5],
        {c: recording[c][::5] for c in recording.channels},
        labels=recording.labels,
    )
    assert bends_between_samples(at_20_hz)
    slow = {c: recording[c][::20] for c in recording.channels}
    thin = Recording.from_arrays(recording.time("imu.angular_rate")[::20], slow, labels=recording.labels)
    assert not bends_between_samples(recording) and bends_between_samples(thin)
    assert "smooth" in {t.hold for t in timings(thin)}
    assert timing_of(known.point, problem_of(known.point, thin)).hold == "smooth"


def test_what_jumps_is_not_smooth(thrust):
    slow = {c: thrust[c][::20] for c in ("command.force", "command.torque")}
    assert not bends_between_samples(slow)


def test_ways_far_behind_over_the_first_samples_go_no_further(known, problem, monkeypatch):
    """The recording is filtered whole only where two ways are near each other."""
    lengths = []

    def counted(model, one):
        lengths.append(len(one.data.times))
        return run_filter(model, one)

    plain = replace(problem, recording=problem.recording.with_provenance({}))
    monkeypatch.setattr("smsid.estimation.input_timing.run_filter", counted)
    monkeypatch.setattr("smsid.estimation.input_timing.HOPELESS_LOSS", np.inf)
    every = timing_of(known.point, plain, CommandTiming())
    assert lengths.count(len(problem.data.times)) == len(timings(plain.recording)) > 1
    monkeypatch.undo()
    lengths.clear()
    monkeypatch.setattr("smsid.estimation.input_timing.run_filter", counted)
    assert timing_of(known.point, plain, CommandTiming()) == every
    assert len(lengths) > 1 and max(lengths) < len(problem.data.times) / 3
    lengths.clear()
    quiet = replace(plain, data=plain.data.scaled(np.full(plain.data.rows, 0.2)))
    timing_of(known.point, quiet, CommandTiming())
    assert max(lengths) == len(problem.data.times)  # what is not followed to its noise tells nothing early
