"""Following a rigid satellite's inertia: against the batch estimate, the truth, and itself restored."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from smsid.description import load_description
from smsid.errors import DescriptionError, RecordingError, SimulationError
from smsid.estimation.flight import FlightOptions
from smsid.estimation.identify_flights import identify_flights
from smsid.estimation.parameter_vector import Polar, Unknown
from smsid.identify.momentum_rows import whole_bodies
from smsid.model import build_model
from smsid.model.regressor import Regressor
from smsid.recording import Recording
from smsid.tracking import Sample, Tracker, load_tracker, save_tracker, track_recordings
from smsid.tracking._sample import samples_of
from smsid.tracking._setting import Setting
from smsid.tracking.followed_parameters import Followed
from smsid.tracking.tracker_file import FOLLOWED

from .craft import INERTIA, craft, flight, true_inertia

CONSTANT = dict.fromkeys(["bus.I*"], 0.0)
COMMANDED = FlightOptions(drive="command")


@pytest.fixture(scope="module")
def description(tmp_path_factory):
    return craft(tmp_path_factory.mktemp("craft"))


@pytest.fixture(scope="module")
def recording():
    return flight(20.0)


@pytest.fixture(scope="module")
def samples(recording):
    return list(samples_of(recording))


@pytest.fixture(scope="module")
def tracked(description, recording):
    return track_recordings(description, [recording], follow=CONSTANT, options=COMMANDED)


def streaming(description, lateness=0.0):
    channels = ("st.attitude", "gyro.angular_rate", "tacho.wheel_rate")
    tracker = Tracker(description, follow=CONSTANT)
    setting = Setting.of(tracker.description, tracker.origin.base, channels=channels, hold="linear")
    return Tracker(description, follow=CONSTANT, setting=replace(setting, lateness=lateness))


def test_constant_parameters_end_at_the_batch_estimate(description, recording, tracked):
    """The maximum of the posterior with the same prior, found by Gauss and Newton on the whole recording."""
    from smsid.estimation._maximum import maximise
    from smsid.estimation.flight import flight_of
    from smsid.estimation.parameter_vector import Point
    from smsid.tracking import followed_parameters

    history, _ = tracked
    point = Point.of(description)
    start = followed_parameters(description, follow=CONSTANT)
    unknowns = [f.unknown for f in start.followed]
    own = flight_of(point, recording, "flight", COMMANDED)
    found = maximise(point, unknowns, [own])[0]
    sigma = np.sqrt(np.diag(np.linalg.inv(found.gram))) * found.scales
    batch = np.array([found.point.value(u) for u in unknowns])
    batch += np.linalg.solve(found.gram, found.slope) * found.scales  # the search stops 0.1 sigma before
    assert np.abs((history.values[-1] - batch) / sigma).max() < 0.02
    np.testing.assert_allclose(history.sigmas[-1], sigma, rtol=0.02)


def test_the_truth_is_inside_the_bands_and_they_shrink(tracked):
    history, _ = tracked
    assert list(history.names) == INERTIA
    off = (history.values[-1] - true_inertia()) / history.sigmas[-1]
    assert np.abs(off).max() < 4.0
    assert (history.sigmas[-1] < 0.1 * history.sigmas[0]).all()
    fit = np.nanmean(history.fit[20:], axis=0)
    assert np.abs(fit - 1.0).max() < 0.25


def test_wheels_that_follow_their_measured_motion_give_the_same(description, recording):
    """Once a tracker called inertias what they are without the wheels, under the names of those with them."""
    history, _ = track_recordings(description, [recording], follow=CONSTANT, cad=0.2)
    found = identify_flights(description, [recording], cad=0.2).estimate
    batch = [found[n.replace(".I", ".Ic")].value for n in history.names]  # nothing tells the mass
    for values in (batch, true_inertia()):
        off = (history.values[-1] - values) / history.sigmas[-1]
        assert np.abs(off).max() < 3.0, off
    assert np.abs((history.values[-1] - batch) / history.sigmas[-1]).max() < 0.3


def test_names_mean_what_they_do_in_an_estimate_and_a_spacecraft_begins_as_described():
    """The bus with its wheels and panel, as `identify` reports it; the mass matrix of the linear model."""
    paper = load_description(Path(__file__).parents[2] / "urdf" / "paper_sms.toml")
    model = build_model(paper)
    tracker = Tracker(paper)
    whole = dict(zip(Regressor(model).names, whole_bodies(model), strict=True))
    held = {n: float(x) for n, x in zip(tracker.names, tracker.values, strict=True) if n.startswith("bus.")}
    assert held == pytest.approx({n: whole[n] for n in held})
    assert held["bus.m"] > model.pin.inertias[1].mass + 50.0  # the panel's modes have some of it
    begun = tracker.filter.at.base.model
    own, described = (pin.crba(m.pin, m.pin.createData(), m.home) for m in (begun, model))
    assert np.trace(own) == pytest.approx(np.trace(described), rel=1e-12)


def test_a_bias_that_wandered_leaves_the_filter_linear_about_the_motion_as_it_is_believed(description):
    """No motion knows it; about a motion as it were without, a rate would be off by the whole bias."""
    follow = CONSTANT | {"gyro.angular_rate.bias.*": 1e-5}
    f = Tracker(description, follow=follow).filter
    bias = np.array([u.kind == "bias" for u in f._unknowns])
    root = np.random.default_rng(4).normal(size=f.covariance.shape)
    f.covariance = root @ root.T + np.eye(len(root))
    f.values = f.at.values + np.where(bias, 5.0, 0.0) * f.sigmas()
    off = f.reference_offset()
    assert bias.any() and not off[: 2 * f.nv].any() and off[f.parameters][bias].all()
    f.values = f.at.values + np.where(bias, 0.0, 5.0) * f.sigmas()
    assert f.reference_offset()[: 2 * f.nv].any()


def test_parameters_stay_and_wander_between_recordings(description):
    rates = {"bus.I*": 0.01}
    first, second = flight(8.0, name="first"), flight(3.0, seed=2, name="second")
    own = {"follow": rates, "options": COMMANDED, "warm_up": 0.0}
    once, _ = track_recordings(description, [first], **own)
    for gap in (0.0, 1e4):
        both, _ = track_recordings(description, [first, second], gap=gap, **own)
        k = int(np.flatnonzero(both.recording == 1)[0])
        assert both.time[k] >= once.time[-1] + gap
        if gap:  # walked: 0.01 sqrt(1e4) = 1 kg m^2, then read for a moment
            assert both.sigmas[k - 1].max() < 0.5 < both.sigmas[k].max() < 1.1
        else:
            np.testing.assert_allclose(both.sigmas[k], both.sigmas[k - 1], rtol=0.2)


def test_a_clock_since_an_epoch_does_not_follow_one_from_zero(description):
    """Parameters would have wandered for half a century."""
    first, second = flight(8.0, name="first"), flight(3.0, seed=2, name="second")
    own = {"follow": {"bus.I*": 0.01}, "options": COMMANDED, "warm_up": 0.0}
    plain, _ = track_recordings(description, [first, second], **own)
    for two in ([first, second.shifted(1.7e9)], [first.shifted(1.7e9), second]):
        found, _ = track_recordings(description, two, **own)
        np.testing.assert_allclose(found.sigmas, plain.sigmas, rtol=1e-3)
        assert np.ptp(found.time) < 20.0


def test_a_missions_clock_goes_on_beyond_a_day(description):
    """110 000 s come after 80 000 s, by half an hour and not by nothing."""
    first, second = flight(8.0, name="first"), flight(3.0, seed=2, name="second")
    own = {"follow": {"bus.I*": 0.01}, "options": COMMANDED, "warm_up": 0.0}
    plain, _ = track_recordings(description, [first, second.shifted(3e4)], **own)
    found, _ = track_recordings(description, [first.shifted(8e4), second.shifted(11e4)], **own)
    np.testing.assert_allclose(found.sigmas, plain.sigmas, rtol=1e-3)
    assert np.ptp(found.time) == pytest.approx(30003.0)


def test_a_stream_in_any_order_gives_what_the_ordered_one_gives(description, samples):
    ordered, mixed = streaming(description), streaming(description, lateness=0.35)
    for sample in samples[:40]:
        ordered.update(sample)
    rng = np.random.default_rng(3)
    single = [Sample(s.time, {c: x}) for s in samples[:40] for c, x in s.channels.items()]
    arrival = [s.time + 0.3 * rng.random() for s in single]
    for k in np.argsort(arrival):
        mixed.update(single[k])
    mixed.update(single[0])
    mixed.update(single[-1])
    mixed.flush()
    np.testing.assert_allclose(mixed.state.parameters["bus.Ixx"], ordered.state.parameters["bus.Ixx"])
    sigma = np.sqrt(np.diag(ordered.covariance))
    sigma[sigma == 0.0] = 1.0
    off = (mixed.covariance - ordered.covariance) / np.outer(sigma, sigma)
    assert np.abs(off).max() < 1e-6  # readings of one moment one by one or together: to rounding
    assert mixed.log.counts["late"] == 1
    assert mixed.log.counts["duplicate"] == 1


def test_a_restored_tracker_goes_on_exactly(description, samples, tmp_path):
    whole, first = streaming(description), streaming(description)
    for sample in samples[:20]:
        whole.update(sample)
        first.update(sample)
    save_tracker(first, tmp_path / "state.npz")
    second = load_tracker(tmp_path / "state.npz", description)
    for sample in samples[20:35]:
        whole.update(sample)
        second.update(sample)
    assert np.array_equal(whole.filter.values, second.filter.values)
    assert np.array_equal(whole.covariance, second.covariance)
    assert second.samples == 35
    assert second.watch.squares == whole.watch.squares and second.watch.squares
    assert second.watch.widening == whole.watch.widening


def test_a_saved_tracker_of_another_version_or_craft_is_refused(description, samples, tmp_path, monkeypatch):
    tracker = streaming(description)
    tracker.update(samples[0])
    path = save_tracker(tracker, tmp_path / "state.npz")
    with pytest.raises(RecordingError, match="another description"):
        load_tracker(path, craft(tmp_path / "other", off=0.2))
    monkeypatch.setattr("smsid.tracking.tracker_file.VERSION", 8)
    with pytest.raises(RecordingError, match="version 7; this smsid reads 8"):
        load_tracker(path, description)
    path.write_bytes(json.dumps({}).encode())
    with pytest.raises(RecordingError, match="no saved tracker"):
        load_tracker(path, description)


def test_predictions_hold_what_is_read_later(description, samples):
    tracker = streaming(description)
    for sample in samples[:60]:
        tracker.update(sample)
    before = tracker.covariance
    ahead = tracker.predict(samples[60].time - samples[59].time)
    off = (samples[60].channels["gyro.angular_rate"] - ahead.readings["gyro.angular_rate"]) / ahead.sigmas[
        "gyro.angular_rate"
    ]
    assert np.abs(off).max() < 30.0  # the command is held, where it truly goes on
    assert np.array_equal(tracker.covariance, before)
    far = tracker.predict(5.0)
    assert far.sigmas["gyro.angular_rate"].min() > ahead.sigmas["gyro.angular_rate"].min()


def test_a_stream_that_stops_begins_anew_and_keeps_the_parameters(description, samples):
    tracker = streaming(description)
    for sample in samples[:60]:
        tracker.update(sample)
    known = tracker.sigmas
    later = [replace(s, time=s.time + 100.0) for s in samples[60:64]]
    for sample in later:
        tracker.update(sample)
    assert tracker.log.counts["silence"] == 1
    np.testing.assert_allclose(tracker.sigmas, known, rtol=0.2)
    assert tracker.time == later[-1].time


@pytest.mark.parametrize("gap", [0.5, 2.0, 5.0])
def test_gaps_teach_nothing_where_wheels_follow_their_measured_motion(description, gap):
    """What wheels did in a gap is not known: gone on as before, 5 s of it made inertias wrong and sure."""
    whole = flight(40.0)
    t = whole.time()
    there = ~((t > 15.0) & (t < 15.0 + gap - 1e-6))
    channels = {c: np.asarray(whole[c])[there] for c in whole.channels}
    cut = Recording.from_arrays(t[there], channels, labels=whole.labels, name="cut")
    history, _ = track_recordings(description, [cut], follow=CONSTANT)
    off = (history.values[-1] - true_inertia()) / history.sigmas[-1]
    assert np.abs(off).max() < 3.0, off
    full, _ = track_recordings(description, [whole], follow=CONSTANT)
    assert (history.sigmas[-1] > 0.95 * full.sigmas[-1]).all()
    told = [e for e in history.events if e.kind == "silence"]
    assert len(told) == (gap > 1.0), history.events


@pytest.mark.parametrize("ahead", [20.0, 1e12])
def test_a_moment_whose_clock_was_wrong_is_left_out_and_named(description, samples, ahead):
    """All that came after it had been late: nothing was told of the spacecraft any more."""
    whole, spoilt = streaming(description), streaming(description)
    for k, sample in enumerate(samples[:80]):
        if k != 40:
            whole.update(sample)
        spoilt.update(replace(sample, time=ahead) if k == 40 else sample)
    assert spoilt.log.counts["ahead"] == len(samples[40].channels)
    assert not spoilt.log.counts.get("late") and not spoilt.log.counts.get("silence")
    np.testing.assert_array_equal(spoilt.values, whole.values)
    assert spoilt.time == whole.time == samples[79].time


def test_a_moment_that_waits_behind_a_silence_is_saved(description, samples, tmp_path):
    tracker = streaming(description)
    for sample in samples[:60]:
        tracker.update(sample)
    later = [replace(s, time=s.time + 100.0) for s in samples[60:64]]
    tracker.update(later[0])
    assert tracker.time == samples[59].time  # one alone may be of a clock that was wrong
    restored = load_tracker(save_tracker(tracker, tmp_path / "state.npz"), description)
    for one in (tracker, restored):
        for sample in later[1:]:
            one.update(sample)
        assert one.log.counts["silence"] == 1
    np.testing.assert_array_equal(tracker.values, restored.values)


def test_bad_samples_and_names_are_told(description, samples):
    tracker = streaming(description)
    tracker.update(samples[0])
    with pytest.raises(RecordingError, match=r"'gyro.angular_rate' has 2 components"):
        tracker.update(Sample.of(0.1, {"gyro.angular_rate": [0.0, 0.0]}))
    tracker.update(Sample.of(0.1, {"radio.angular_rate": [0.0, 0.0, 0.0]}))
    assert tracker.log.last[-1].kind == "unknown channel"
    with pytest.raises(RecordingError, match="no number"):
        Sample.of(0.1, {"gyro.angular_rate": ["x"]})
    with pytest.raises(DescriptionError, match="no unknown parameter"):
        Tracker(description, follow={"bus.Iww": 0.0})
    with pytest.raises(DescriptionError, match="rate"):
        Tracker(description, follow={"bus.Ixx": -1.0})


def test_commands_of_slow_telemetry_are_not_forgotten_before_they_act(description, samples):
    """Samples taken in together, over more seconds than commands are remembered, are those one by one."""
    together, single = streaming(description), streaming(description)
    together.update_all(samples[:120])
    for sample in samples[:120]:
        single.update(sample)
    single.flush()
    np.testing.assert_allclose(together.state.v, single.state.v, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(together.filter.values, single.filter.values, rtol=1e-9)


def test_what_is_missing_widens_bands_and_moves_nothing(description, samples):
    whole, thinned = streaming(description), streaming(description)
    rng = np.random.default_rng(8)
    whole.update_all(samples)
    for sample in samples:
        there = {c: x for c, x in sample.channels.items() if c.startswith("command") or rng.random() < 0.6}
        thinned.update(Sample(sample.time, there))
    thinned.flush()
    assert not thinned.log.counts.get("late") and not thinned.log.counts.get("silence")
    more = thinned.sigmas / whole.sigmas
    assert (more > 1.1).all() and (more < 2.0).all()
    assert np.abs((thinned.values - whole.values) / thinned.sigmas).max() < 3.0
    for tracker in (whole, thinned):  # begun 5 % off: filtered again about better and better values
        assert np.abs((tracker.values - true_inertia()) / tracker.sigmas).max() < 4.0


def test_a_motion_that_is_lost_is_told_and_begun_anew(description, samples):
    """A reading beyond all bounds throws the filter off; at the beginning it is another spacecraft's."""

    def struck(at):
        wild = {"gyro.angular_rate": np.full(3, 1e15)}
        return [replace(s, channels=s.channels | wild) if abs(s.time - at) < 0.01 else s for s in samples]

    sound, tracker = streaming(description), streaming(description)
    sound.update_all(samples)
    tracker.update_all(struck(12.0))
    lost = [e for e in tracker.log.last if e.kind == "lost"]
    assert len(lost) == 1 and 11.5 < lost[0].time < 12.5
    assert tracker.time == pytest.approx(sound.time) and tracker.samples > 0.9 * sound.samples
    assert np.abs((tracker.values - true_inertia()) / tracker.sigmas).max() < 4.0
    assert (tracker.sigmas > sound.sigmas).all()  # by the last eight seconds only
    with pytest.raises(SimulationError, match="lost the recording"):
        streaming(description).update_all(struck(5.0))


def test_what_is_not_followed_is_held_at_the_estimate_not_at_the_description(description, recording):
    """The craft's inertia is 5 % off as described. The estimate tells it about the centre of mass, as nothing
    tells the mass; one element is followed, the others are where the estimate has them.
    """
    found = identify_flights(description, [recording], cad=0.2, options=COMMANDED).estimate
    assert "bus.Icxx" in found
    again = flight(20.0, seed=8)
    history, tracker = track_recordings(
        description, [again], follow={"bus.Ixx": 0.0}, estimate=found, options=COMMANDED
    )
    assert history.names == ("bus.Ixx",)
    assert "does not explain" not in str(history.notes)
    assert any("held at what the estimate says" in n and "bus.Izz" in n for n in history.notes)
    assert abs(history.values[-1, 0] - true_inertia()[0]) < 6.0 * found["bus.Icxx"].sigma
    held = {u.name: x for u, x in tracker.start.held}
    assert held["bus.Izz"] == pytest.approx(found["bus.Iczz"].value, rel=1e-4)
    everything, _ = track_recordings(description, [again], follow=CONSTANT, estimate=found, options=COMMANDED)
    names = [everything.names.index(n) for n in INERTIA]
    off = (everything.values[-1, names] - true_inertia()) / everything.sigmas[-1, names]
    assert np.abs(off).max() < 3.5
    told = np.array([found[n.replace("I", "Ic")].sigma for n in INERTIA])
    assert (everything.sigmas[-1, names] < told).all()


def test_what_is_followed_is_restored_whole():
    """A component of an amplitude keeps what it is a component of; numbers that are not finite stay so."""
    polar = Polar("wheel.amplitude", "wheel.angle", 0.3)
    own = (Followed(Unknown("wheel.amplitude", "effect", "N", 0.0, 1.0, 0.1, polar=polar), 0.01),)
    table = json.loads(json.dumps([asdict(x) for x in own]))
    assert FOLLOWED.validate_python(table) == own
