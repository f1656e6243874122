"""Which estimator takes a set of recordings."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from smsid.errors import NotIdentifiableError
from smsid.estimation import identify
from smsid.identify.estimate import Estimate
from smsid.recording import Recording


@pytest.mark.parametrize("evidence", ["marginal", "other_flight", None])
def test_marginal_combinations_go_to_the_filter_which_marks_them(evidence, monkeypatch):
    message = "The identifiable combinations change with the sensors' noise: l1.m."

    def raises(*_, **__):
        raise NotIdentifiableError(message, **({evidence: True} if evidence else {}))

    estimate = Estimate("x", "ml", (), notes=("first", "last"))
    quality = SimpleNamespace(judgement="explained")
    flights = SimpleNamespace(estimate=estimate, quality=quality, contradictions=())
    monkeypatch.setattr("smsid.estimation._mapping_check.wrong_columns", lambda *_: [])
    monkeypatch.setattr(identify, "by_the_paper", raises)
    flown = "smsid.estimation.identify_flights.identify_flights"
    monkeypatch.setattr(flown, lambda *_, **__: flights)
    description = SimpleNamespace(effect=(), effective_sensors=tuple)
    if evidence is None:
        with pytest.raises(NotIdentifiableError):
            identify.identify_spacecraft(description, [])
        return
    found = identify.identify_spacecraft(description, [])
    assert found.flights is flights and message in found.estimate.notes[1]


@pytest.mark.parametrize("unexcited", [True, False])
def test_no_column_is_sought_that_would_make_a_still_flight_move(unexcited, monkeypatch):
    """The search took 30 s before it was said that no wheel turns."""
    sought = []

    def raises(*_, **__):
        raise NotIdentifiableError("No wheel turns.", unexcited=unexcited)

    monkeypatch.setattr("smsid.estimation._mapping_check.wrong_columns", lambda *_: sought.append(1) or [])
    monkeypatch.setattr(identify, "by_the_paper", raises)
    with pytest.raises(NotIdentifiableError, match="No wheel turns"):
        identify.identify_spacecraft(SimpleNamespace(effect=(), effective_sensors=tuple), [])
    assert bool(sought) is not unexcited


def test_a_long_flight_begins_with_its_first_samples(monkeypatch):
    """The slowest sensor counts; with thrust, or short, a flight is taken whole; a failure is no end."""
    few = identify.BEGINNING
    t = np.arange(2 * few + 1) / 100.0
    rate = np.zeros((len(t), 3))
    channels = {"imu.angular_rate": rate, "pose.position": (t[::2], rate[::2])}
    slow = Recording.from_arrays(t, channels)
    long = Recording.from_arrays(t, {"imu.angular_rate": rate})
    pushed = long.with_channels({"command.force": rate + 1.0})
    assert identify._first_samples(slow) is slow and identify._first_samples(pushed) is pushed
    assert len(identify._first_samples(long).time()) == few + 1
    asked = []

    def paper(_, recordings, **__):
        asked.append(len(recordings[0].time()))
        if len(asked) == 1:
            raise NotIdentifiableError("Nothing moves yet.", advice="Wait.")
        return "whole"

    monkeypatch.setattr(identify, "by_the_paper", paper)
    started: Any = identify._starting_point
    assert started(None, [long], None) == ("whole", "whole")
    assert asked == [few + 1, len(t)]


@pytest.mark.parametrize(("turned", "held"), [(0.0, True), (3e-4, True), (1e-3, False)])
def test_an_attitude_that_turns_under_thrust_is_not_held(turned, held):
    """Ramps of the attitude, read with a noise of 1e-4 rad: 1e-5 rad/s. One reading is an outlier."""
    rng, n = np.random.default_rng(2), 2000
    turn = np.outer(np.linspace(0.0, turned, n), [1.0, 0.5, -0.3]) + rng.normal(0.0, 1e-4, (n, 3))
    turn[700] += 0.3
    attitude = np.column_stack([0.5 * turn, np.ones(n)])
    attitude /= np.linalg.norm(attitude, axis=1)[:, None]
    for size in (0.0, 10.0):
        channels = {"star.attitude": attitude, "command.force": np.tile([size, 0.0, 0.0], (n, 1))}
        recording = Recording.from_arrays(np.arange(n) * 0.05, channels, name="flight")
        reason = identify._turned_while_pushed(recording)
        assert (reason == "") == (held or size == 0.0), reason
