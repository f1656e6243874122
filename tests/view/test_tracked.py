"""A track is replayed as the motion that was believed in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from smsid.errors import RecordingError, SmsidError
from smsid.tracking import TrackHistory
from smsid.tracking.track_recordings import dof_names
from smsid.view import build_replay
from smsid.view._tracked import tracked_states


@pytest.fixture
def moved(model):
    """States q, v of the paper's craft, and the track that says so."""
    rng = np.random.default_rng(1)
    q = np.array([pin.integrate(model.pin, model.home, rng.normal(0.0, 0.3, model.nv)) for _ in range(5)])
    v = rng.standard_normal((5, model.nv))
    place = np.array([np.r_[x[:3], pin.log3(pin.Quaternion(x[3:7]).toRotationMatrix()), x[7:]] for x in q])
    nothing, sigma = np.zeros((5, 0)), np.zeros((5, model.nv))
    history = TrackHistory(
        "paper_sms", np.arange(5.0), np.arange(5.0), np.zeros(5, dtype=int), ("one",), (), (), np.zeros(0),
        nothing, nothing, tuple(dof_names(model)), place, sigma, v, sigma, (), nothing, np.zeros((0, 0)),
    )  # fmt: skip
    return model, q, v, history


def test_states_are_those_that_were_tracked(moved):
    model, q, v, history = moved
    found = tracked_states(model, history)
    np.testing.assert_array_equal(found.v, v)
    for ours, true in zip(found.q, q, strict=True):
        assert np.abs(pin.difference(model.pin, ours, true)).max() < 1e-12


def test_two_recordings_meet_in_one_moment(moved):
    model, _, _, history = moved
    twice = replace(history, time=np.array([0.0, 1.0, 1.0, 2.0, 3.0]))
    np.testing.assert_array_equal(tracked_states(model, twice).time, [0.0, 1.0, 2.0, 3.0])


def test_it_is_played_beside_others_and_has_no_commands(moved):
    model, _, _, history = moved
    shown = build_replay(model.description, [history, history])
    assert len(shown.companions) == 1 and shown.label == "tracked"
    with pytest.raises(SmsidError, match="no commands to fly"):
        build_replay(model.description, [history], simulated=True)


def test_a_track_of_another_spacecraft_is_refused(moved):
    model, _, _, history = moved
    with pytest.raises(RecordingError, match="other degrees of freedom"):
        tracked_states(model, replace(history, dofs=("bus.x", *history.dofs[1:-1], "sail")))
