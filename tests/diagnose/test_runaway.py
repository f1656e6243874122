"""A simulation that runs away by itself costs what it was asked for, and nothing else."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from smsid.diagnose import diagnose
from smsid.diagnose._open_loop import SETTLE, unexplained_fraction
from smsid.errors import SimulationError
from smsid.estimation.map_estimate import evaluate

BEYOND = 1e9  # times the torque that was commanded


def runaway(recording, begin=0.0):
    """The recording with joints driven beyond all measure from ``begin`` [s] on."""
    torque = np.array(recording["command.joint_torque"])
    torque[recording.time("command.joint_torque") >= begin] *= BEYOND
    return recording.with_channels({"command.joint_torque": torque})


@pytest.fixture(scope="module")
def without_validation(description, recording):
    return diagnose(description, [recording], rate=10.0).diagnosis


def unchanged(found, before):
    """Everything but the gain and the recordings that were given."""
    assert found.verdict == before.verdict in ("adequate", "explained", "unexplained")
    for name in ("sentence", "causes", "partial", "remaining", "tests", "limits", "noise", "whitened_rms"):
        # of what nothing excites the limit is not a number, which equals nothing
        assert repr(getattr(found, name)) == repr(getattr(before, name)), name


def test_a_validation_flight_that_runs_away_costs_only_the_gain(description, recording, without_validation):
    found = diagnose(description, [recording], validation=[runaway(recording)], rate=10.0).diagnosis
    assert found.gain is None
    assert f"not on '{recording.name}'" in found.gain_reason
    assert "no longer finite" in found.gain_reason
    unchanged(found, without_validation)


def test_whatever_of_the_gain_cannot_be_simulated(description, recording, without_validation, monkeypatch):
    def lost(*_):
        raise SimulationError("It ran away at 3 s.", advice="Look at it.")

    monkeypatch.setattr(sys.modules["smsid.diagnose.diagnose"], "gain", lost)
    found = diagnose(description, [recording], validation=[recording], rate=10.0).diagnosis
    assert found.gain is None
    assert found.gain_reason == f"not on '{recording.name}': It ran away at 3 s."
    unchanged(found, without_validation)


def test_a_validation_flight_that_does_not_run_away_has_a_gain(description, recording, without_validation):
    found = diagnose(description, [recording], validation=[recording], rate=10.0).diagnosis
    assert found.gain is not None and found.gain_reason == ""
    unchanged(found, without_validation)


def test_the_motion_left_is_not_a_number_where_the_simulation_runs_away(known, problem):
    fitted = evaluate(known.point, known.unknowns[:1], problem)
    noise = dict.fromkeys((b.channel for b in problem.data.blocks), 1.0)
    assert unexplained_fraction(fitted, noise) < 0.1
    begin = float(problem.data.times[0]) + SETTLE + 0.2  # by itself already
    lost = replace(problem, recording=runaway(problem.recording, begin))
    assert np.isnan(unexplained_fraction(replace(fitted, problem=lost), noise))
