"""Changes in flight of the numpy satellite: named, timed, sized; none where nothing changes."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from smsid.estimation.flight import FlightOptions
from smsid.recording import Recording
from smsid.tracking import ChangeDetector, Tracker, track_recordings
from smsid.tracking._jump_runs import JumpRuns, Rerun
from smsid.tracking._sample import samples_of
from smsid.tracking._setting import Setting
from tests.estimation.satellite import recorded

from .craft import INERTIA, RIGID, STEP, craft, flight, mean_over_step, wheels

FOLLOW = {"bus.I*": 0.0, "gyro.angular_rate.bias.*": 0.0}
GRASPED = np.array([[4.0, 0.5, 0.0], [0.5, 3.0, -0.4], [0.0, -0.4, 6.0]])  # [kg m^2]
AT = 40.0  # [s]
COMMANDED = FlightOptions(drive="command")


@pytest.fixture(scope="module")
def description(tmp_path_factory):
    return craft(tmp_path_factory.mktemp("craft"), off=0.002)


@pytest.fixture(scope="module")
def grasped():
    """A flight in which a body that turns with the satellite is grasped at 40 s: its inertia comes on top."""
    return with_body(AT, 1.0)


def with_body(at, share):
    before = RIGID.fly(at, mean_over_step, step=STEP)
    heavier = replace(RIGID, inertia=tuple(map(tuple, np.array(RIGID.inertia) + share * GRASPED)))
    after = heavier.fly(25.0, lambda t: mean_over_step(t + at), step=STEP, start=before[1][-1, :24])
    flown = tuple(np.concatenate([a, b[1:]]) for a, b in zip(before, after, strict=True))
    times = np.arange(len(flown[0])) * STEP
    found = recorded(RIGID, (times, *flown[1:]), np.random.default_rng(3), without=("gyro.acceleration",))
    channels = {c: found[c] for c in found.channels}
    channels["command.wheel_torque"] = np.array([wheels(t) for t in found.time()])
    return Recording.from_arrays(found.time(), channels, labels=found.labels, name="grasped")


def watched(description, recording, until=np.inf, **more):
    channels = ("st.attitude", "gyro.angular_rate", "tacho.wheel_rate")
    plain = Tracker(description, follow=FOLLOW, cad=0.01)
    setting = Setting.of(plain.description, plain.origin.base, channels=channels, hold="linear")
    tracker = Tracker(description, follow=FOLLOW, cad=0.01, setting=setting)
    detector = ChangeDetector.watch(tracker, **more)
    tracker.update_all(s for s in samples_of(recording) if s.time < until)
    return detector


def test_a_grasped_body_is_named_in_time_with_its_inertia(description, grasped):
    history, tracker = track_recordings(
        description, [grasped], follow=FOLLOW, cad=0.01, options=COMMANDED, warm_up=0.0, false_alarms=0.1
    )
    (event,) = [e for e in history.events if e.kind == "change"]
    assert event.channel == "bus" and 0.0 < event.time - AT < 3.0
    assert event.text.startswith("bus changed at")
    truth = (np.array(RIGID.inertia) + GRASPED)[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    assert np.abs((tracker.filter.values[:6] - truth) / tracker.sigmas[:6]).max() < 4.0


def test_the_size_of_a_jump_is_within_its_interval(description, grasped):
    (change,) = watched(description, grasped).changes
    true = GRASPED[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    assert change.names == tuple(INERTIA)
    assert change.began - change.grid <= AT <= change.began + change.grid
    off = (change.jumps - true) / change.sigmas
    assert np.abs(off).max() < 4.0 and np.sqrt(np.mean(off**2)) < 2.0, off
    assert np.abs(change.jumps - true).max() < 0.05 * GRASPED.max()


def test_a_jump_is_timed_to_a_sample_however_the_telemetry_comes(description):
    """One sample on the wrong side of so large a jump moves parameters by many standard deviations."""
    at = 40.7  # between two starts
    (change,) = watched(description, with_body(at, 2.0)).changes
    assert abs(change.began - at) < 0.11
    off = (change.jumps - 2.0 * GRASPED[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]) / change.sigmas
    assert np.abs(off).max() < 4.0 and np.sqrt(np.mean(off**2)) < 2.0, off


def test_the_time_of_a_jump_is_sought_to_a_sample():
    """Also where what is read is explained on the whole: a sample on the wrong side is one of hundreds."""
    times, true = np.arange(400) * 0.05, 10.15

    class Runs(JumpRuns):
        def _run(self, start, index, point, onset, opening=-np.inf, follows=False):
            filtered = SimpleNamespace(values=np.zeros(1))
            return Rerun(filtered, onset, -1e3 * abs(onset - true), left=1.0)

    runs = Runs(every=1.0)
    runs.passes.append((times, None, None, None, ()))
    first = runs._run(None, None, None, 9.0)
    best = runs._at_onset(SimpleNamespace(time=5.0), np.array([0]), first, 4.0)
    assert best.onset == pytest.approx(true) and best.grid == pytest.approx(0.05)


def test_a_motion_that_a_jump_loses_goes_on_with_it(description, grasped):
    """Where the motion is lost before a change is told, it is taken in at once, and only once."""
    detector = watched(description, grasped, until=AT + 1.5)
    assert not detector.changes and detector.rescue() and not detector.rescue()
    truth = (np.array(RIGID.inertia) + GRASPED)[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    assert np.abs((detector.tracker.values[:6] - truth) / detector.tracker.sigmas[:6]).max() < 4.0


def test_a_gyro_that_jumps_is_named(description):
    steady = flight(62.0, seed=5)
    rates = steady["gyro.angular_rate"].copy()
    rates[steady.time() >= AT, 1] += 2e-5  # two standard deviations of a reading
    (change,) = watched(description, steady.with_channels({"gyro.angular_rate": rates})).changes
    assert change.group == "gyro.angular_rate.bias"
    assert abs(change.jumps[1] - 2e-5) < 4.0 * change.sigmas[1]
    assert 0.0 < change.alarm - AT < 5.0
    assert change.others and change.others[0][1] > 0.0


def test_what_passes_at_once_is_no_change(description):
    """Half a second of a gyro beside its noise is beyond chance at first, and no jump of anything."""
    steady = flight(62.0, seed=5)
    rates, t = steady["gyro.angular_rate"].copy(), steady.time()
    rates[(t > AT - 0.05) & (t < AT + 0.55), 1] += 3.4e-5
    assert not watched(description, steady.with_channels({"gyro.angular_rate": rates})).changes


def test_a_single_reading_far_off_is_no_change(description):
    steady = flight(62.0, seed=5)
    rates = steady["gyro.angular_rate"].copy()
    rates[np.searchsorted(steady.time(), AT), 1] += 1e-3  # a hundred standard deviations
    assert not watched(description, steady.with_channels({"gyro.angular_rate": rates})).changes


def test_signatures_are_what_a_jump_does_to_the_innovations(description):
    """Against a second filter with a shifted parameter: squares of what that changes are the information."""
    steady, begun = flight(60.0, seed=5), 45.0  # [s], after what is filtered once more
    changed, told = [], []
    for shift in (0.0, 1.0):  # standard deviations
        detector = watched(description, steady, until=begun)
        f = detector.tracker.filter
        which = detector.tracker.names.index("gyro.angular_rate.bias.y")
        detector._starts, detector._next = [], np.inf
        detector._begin(f.time)
        f.values[which] += shift * f.sigmas()[which]
        seen = []
        before = detector.tracker.listener

        def hear(update, seen=seen, before=before):
            before(update)
            if update.record is not None:
                seen.append(update.record.innovations[-1])

        detector.tracker.listener = hear
        scale = shift * f.sigmas()[which] / f.scales[which]
        kept, detector._judge = detector._starts[0], lambda *_: None
        detector.tracker.update_all(s for s in samples_of(steady) if s.time >= begun)
        changed.append(np.concatenate(seen))
        told.append(kept.information[which, which])
    directly = float(np.sum((changed[1] - changed[0]) ** 2)) / scale**2
    assert told[0] == pytest.approx(directly, rel=1e-4)


def test_false_alarms_are_no_more_than_asked_for(description):
    """At sixty an hour, one a minute: at most three in 60 s but once in fifty; at the usual rate none."""
    steady = flight(60.0, seed=11)
    assert len(watched(description, steady, false_alarms=60.0).changes) <= 3
    assert not watched(description, steady).changes


def test_the_size_of_the_sequential_test_under_the_null(description):
    """Ten minutes of innovations drawn as the filter says they are: no more alarms than asked for.

    At 600 an hour 100 are allowed. Bonferroni's inequality keeps them below that, but not out of sight.
    """
    steady = flight(12.0, seed=11)
    plain = Tracker(description, follow=FOLLOW, cad=0.01)
    setting = Setting.of(plain.description, plain.origin.base, hold="linear")
    tracker = Tracker(description, follow=FOLLOW, cad=0.01, setting=setting)
    detector = ChangeDetector(tracker, false_alarms=600.0)
    last = []
    tracker.listener = last.append
    tracker.update_all(samples_of(steady))
    pattern = last[-20:]  # two seconds of sensitivities and gains, again and again
    rng, alarms, time, every = np.random.default_rng(4), 0, 0.0, 0.1
    for k in range(round(600.0 / every)):
        own = pattern[k % len(pattern)]
        assert own.record is not None
        drawn = rng.standard_normal(own.record.innovations.shape)
        time += every
        within = own.record._replace(innovations=drawn), 0, len(drawn) - 1
        detector.hear(replace(own, time=time, passed=every, innovations=drawn[-1], within=within))
        if detector._alarm is not None:  # heard; on it goes
            alarms += 1
            detector._alarm, detector._starts = None, []
    assert 10 <= alarms <= 100
