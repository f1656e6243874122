"""What is known of each time from all that was read: against closed forms, batch estimates and the truth."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.estimation._smoother import smoothed_states
from smsid.estimation.flight import FlightOptions, flight_of
from smsid.estimation.parameter_vector import Point
from smsid.recording import Recording
from smsid.tracking import track_recordings
from smsid.tracking.history import load_history, save_history

from .craft import INERTIA, RIGID, craft, flight, true_inertia
from .test_change_detection import AT, FOLLOW, GRASPED, with_body

COMMANDED = FlightOptions(drive="command")


@pytest.fixture(scope="module")
def description(tmp_path_factory):
    return craft(tmp_path_factory.mktemp("craft"))


@pytest.fixture(scope="module")
def constant(description):
    """Inertias that stay as they are, over two recordings."""
    flights = [flight(20.0), flight(15.0, seed=2)]
    return track_recordings(description, flights, follow={"bus.I*": 0.0}, options=COMMANDED, smooth=True)[0]


def test_what_stays_is_known_at_all_times_as_it_is_in_the_end(constant):
    """Of a parameter that does not wander, all readings tell the same, whenever: through recordings, too."""
    smoothed, last = constant.smoothed, slice(-1, None)
    assert (constant.sigmas[1] > 20.0 * constant.sigmas[-1]).all()
    off = (smoothed.values - constant.values[last]) / constant.sigmas[last]
    assert np.abs(off).max() < 0.05
    assert smoothed.sigmas / constant.sigmas[last] == pytest.approx(1.0, abs=0.02)


def test_the_end_is_what_the_filter_ends_with(constant):
    own = constant.smoothed
    assert np.abs((own.values[-1] - constant.values[-1]) / constant.sigmas[-1]).max() < 0.02
    known = constant.velocity_sigma[-1] > 0.0
    off = (own.velocity[-1] - constant.velocity[-1])[known] / constant.velocity_sigma[-1, known]
    assert np.abs(off).max() < 0.02


def test_motion_is_that_of_the_smoother_of_states(tmp_path):
    """With parameters as good as known, against the smoother that goes sample by sample, without them."""
    description = craft(tmp_path, off=0.0)
    recording = flight(20.0)
    known = track_recordings(
        description, [recording], follow={"bus.Ixx": 0.0}, cad=1e-9, options=COMMANDED, smooth=True
    )[0]
    point = Point.of(description)
    own = flight_of(point, recording, "", COMMANDED)
    states = smoothed_states(own.model, own.problem)
    at = np.searchsorted(own.problem.data.times, known.own_time - 1e-9)
    nv = own.model.nv
    sigma = np.sqrt(np.maximum(states.covariance[at].diagonal(axis1=1, axis2=2), 0.0))
    velocity = states.states.v[at]
    moves = sigma[0, nv : 2 * nv] > 0.0
    off = (known.smoothed.velocity - velocity)[:, moves] / sigma[:, nv : 2 * nv][:, moves]
    assert np.abs(off).max() < 0.02
    assert known.smoothed.velocity_sigma[:, moves] == pytest.approx(sigma[:, nv : 2 * nv][:, moves], rel=0.02)
    assert (known.smoothed.velocity_sigma[:, moves] < 0.9 * known.velocity_sigma[:, moves]).mean() > 0.3


def test_a_file_keeps_it(constant, tmp_path):
    again = load_history(save_history(constant, tmp_path / "t.nc"))
    assert again.smoothed is not None
    assert np.array_equal(again.smoothed.values, constant.smoothed.values)
    assert np.array_equal(again.smoothed.velocity_sigma, constant.smoothed.velocity_sigma)


def test_the_truth_is_inside(constant):
    off = (constant.smoothed.values - true_inertia()) / constant.smoothed.sigmas
    assert np.sqrt(np.mean(off**2)) < 1.8


@pytest.mark.parametrize("rate", [pytest.param(1e-4, marks=pytest.mark.slow), 3e-3])
def test_a_bias_that_wanders_is_inside_and_known_better_than_on_line(tmp_path, rate):
    """Random walks added to a gyro's readings: normalised errors have variance one, later readings tell.

    Three hundred times the gyro's noise in a second, the filter alone is linear about a motion that is far
    off at first, and a search for one bias finds none that fits.
    """
    description, rng = craft(tmp_path, off=0.02), np.random.default_rng(7)
    normalised, online = [], []
    for seed in range(4):
        recording = flight(30.0, seed=10 + seed)
        times = recording.time()
        walk = np.cumsum(rate * np.sqrt(0.1) * rng.standard_normal((len(times), 3)), axis=0)
        channels = {c: recording[c] for c in recording.channels}
        channels["gyro.angular_rate"] = channels["gyro.angular_rate"] + walk
        drifting = Recording.from_arrays(times, channels, labels=recording.labels, name="drifting")
        follow = {"bus.I*": 0.0, "gyro.angular_rate.bias.*": rate}
        found = track_recordings(description, [drifting], follow=follow, options=COMMANDED, smooth=True)[0]
        assert "does not explain" not in str(found.notes) and "did not come to rest" not in str(found.notes)
        own = found.smoothed
        truth = walk[np.searchsorted(times, found.own_time - 1e-9)]
        apart = slice(10, None, 10)
        normalised.append(((own.values[:, -3:] - truth) / own.sigmas[:, -3:])[apart])
        online.append(((found.values[:, -3:] - truth) ** 2)[apart] / own.sigmas[apart, -3:] ** 2)
        bodies = (own.values[:, :6] - true_inertia()) / own.sigmas[:, :6]
        assert np.abs(bodies).max() < 4.0
    assert 0.75 < np.mean(np.concatenate(normalised) ** 2) < 1.3
    assert np.mean(online) > 1.2 * np.mean(np.concatenate(normalised) ** 2)


def test_a_jump_is_smoothed_from_both_sides(tmp_path):
    """Inertia before and after a grasp from the readings of its own side, told apart to a sample."""
    found = track_recordings(
        craft(tmp_path, off=0.002), [with_body(AT, 1.0)], follow=FOLLOW, cad=0.01, options=COMMANDED,
        false_alarms=0.1, smooth=True,
    )[0]  # fmt: skip
    index = [found.names.index(n) for n in INERTIA]
    values, sigmas = found.smoothed.values[:, index], found.smoothed.sigmas[:, index]
    before, after = found.own_time < AT - 0.25, found.own_time > AT + 0.25
    heavier = np.array(RIGID.inertia) + GRASPED
    for side, truth in ((before, true_inertia()), (after, heavier[np.tril_indices(3)])):
        off = (values[side] - truth) / sigmas[side]
        assert np.abs(off).max() < 4.0
        assert np.ptp(values[side], axis=0) == pytest.approx(0.0, abs=1e-2 * np.abs(truth).max())
    # what the jump explains widens no band of the filter; those of what is smoothed across it stay wide
    last = heavier[np.tril_indices(3)] - found.values[-1, index]
    assert np.abs(last / found.sigmas[-1, index]).max() < 4.0
    wider = sigmas[after] / found.sigmas[-1, index]
    assert wider == pytest.approx(np.full(wider.shape, wider[0, 0]), rel=0.1) and wider[0, 0] > 1.0


def test_what_changes_steadily_is_followed_with_its_trend(tmp_path):
    """A gyro's bias that grows: value and trend inside their bands, over a gap without readings as well."""
    description, trend = craft(tmp_path, off=0.02), np.array([2e-5, -1e-5, 0.0])
    flights = []
    for seed, start in ((3, 0.0), (4, 60.0)):
        recording = flight(20.0, seed=seed)
        times = recording.time()
        channels = {c: recording[c] for c in recording.channels}
        channels["gyro.angular_rate"] = channels["gyro.angular_rate"] + np.outer(times + start, trend)
        flights.append(
            Recording.from_arrays(times + start, channels, labels=recording.labels, name="growing")
        )
    follow = {"bus.I*": 0.0, "gyro.angular_rate.bias.*": (0.0, 1e-4)}
    found = track_recordings(description, flights, follow=follow, options=COMMANDED, smooth=True)[0]
    index = [found.names.index(f"gyro.angular_rate.bias.{a}.trend") for a in "xyz"]
    assert {found.units[i] for i in index} == {"rad/s^2"}
    assert np.abs((found.values[-1, index] - trend) / found.sigmas[-1, index]).max() < 3.5
    bias = np.arange(6, 9)
    truth = np.outer(found.time, trend)
    late = found.own_time > 5.0
    assert np.sqrt(np.mean(((found.values[:, bias] - truth) / found.sigmas[:, bias])[late] ** 2)) < 2.0
    assert (
        np.sqrt(np.mean(((found.smoothed.values[:, bias] - truth) / found.smoothed.sigmas[:, bias]) ** 2))
        < 2.0
    )
    after = np.flatnonzero(found.recording == 1)[0]  # over the gap it goes on
    assert np.abs(found.values[after, bias] - truth[after]).max() < 5.0 * found.sigmas[after, bias].max()
    assert found.values[after, 6] == pytest.approx(truth[after, 0], rel=0.05)
    assert not any(n.endswith("trend") for n in (p.name for p in found.estimate().parameters))
