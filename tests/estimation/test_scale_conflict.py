"""Thrust or wheels on a wrong scale: named where the recordings tell it; where none does, that is said."""

import numpy as np

from smsid.estimation._scale_conflict import ScaleConflict
from smsid.estimation.identify_flights import identify_flights
from tests.estimation.satellite import Satellite, burns_and_wheels, guess, recorded

RIGID = Satellite(tank=(1e-9, 1e-9, 1e-9), panel=(1.0, 0.1, 1e-6, -1e-6))


def scaled(recording, channel):
    return recording.with_channels({channel: 1.1 * np.asarray(recording[channel])})


def test_thrust_that_is_a_tenth_too_large_is_named_and_nothing_is_called_identifiable(tmp_path):
    """A tank and a panel take part in what thrust does and in what wheels do: that tells the scale."""
    truth = Satellite()
    recording = recorded(truth, truth.fly(90.0, burns_and_wheels), np.random.default_rng(3), every=10)
    found = identify_flights(guess(tmp_path, truth, off=0.02), [scaled(recording, "command.force")])
    assert found.quality.judgement == "not explained"
    conflict = found.quality.conflict
    assert isinstance(conflict, ScaleConflict)
    scales = dict(conflict.scales)
    assert abs(scales["command.force"] - 1.1) < 0.03
    assert abs(scales["tacho.wheel_rate"] - 1.0 / 1.1) < 0.03, "or the wheels, as much too small"
    assert "'command.force' about 1.1 times" in found.estimate.notes[0]
    assert not [p for p in found.estimate.parameters if p.status == "identifiable"]


def test_where_wheels_alone_turn_a_rigid_satellite_no_scale_is_told_and_that_is_said(tmp_path):
    def drive(t):
        wheels = 0.1 * np.sin(2 * np.pi * np.array([0.05, 0.083, 0.031]) * t)
        return np.zeros(3), np.zeros(3), wheels

    description = guess(tmp_path, RIGID, tank=False, panel=False)
    right = recorded(RIGID, RIGID.fly(30.0, drive), np.random.default_rng(3))
    one, other = (identify_flights(description, [r]) for r in (right, scaled(right, "tacho.wheel_rate")))
    ratio = other.estimate["bus.Icxx"].value / one.estimate["bus.Icxx"].value
    assert abs(ratio - 1.1) < 0.01, "a craft a tenth heavier turns alike"
    for found in (one, other):
        assert found.quality.judgement == "explained" and found.quality.conflict is None
        assert any("nothing tells the scale of 'tacho.wheel_rate'" in n for n in found.estimate.notes)
