"""Recursive total least squares of the momentum as a tracker, on another engine's flight."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import xarray as xr
from twins.mujoco_twin import Drive, MujocoTwin
from twins.recordings import Q0_ARM
from twins.state import State
from typer.testing import CliRunner

from smsid.cli.app import app
from smsid.errors import EstimateError, NotIdentifiableError, RecordingError, SmsidError
from smsid.identify.estimate import Estimate
from smsid.identify.paper.hidden_states import hidden_states
from smsid.identify.paper.motion import prepare
from smsid.identify.paper.noise_replicates import add_noise_replicate
from smsid.model import build_model
from smsid.recording import Recording, save_recording
from smsid.sensing import add_noise
from smsid.tracking import MomentumTracker, Sample
from smsid.tracking._hidden_state_carrier import HiddenStateCarrier
from smsid.tracking._sample import samples_of
from tests.identify.support import from_twin, paper

WINDOW = 14.0  # [s]


@pytest.fixture(scope="module")
def flight() -> Recording:
    """40 s in MuJoCo on wheels and arm, from rest, with the described sensors' noise."""

    def wheels(t: float) -> np.ndarray:
        return 2.0 * np.sin(2 * np.pi * np.array([0.04, 0.06, 0.05]) * t + np.arange(3)) * min(t, 1.0)

    def arm(t: float) -> np.ndarray:
        swing = np.sin(2 * np.pi * np.array([0.1, 0.13, 0.17]) * t + np.arange(3))
        return np.array([20.0, 25.0, 10.0]) * swing * min(t, 1.0)

    drive, start = Drive(wheel_torque=wheels, joint_torque=arm), State(q=Q0_ARM.copy())
    exact = from_twin(MujocoTwin().simulate(drive, 40.0, initial=start, dt=1e-2))
    return add_noise(exact, paper().sensor, np.random.default_rng(5))


@pytest.fixture(scope="module")
def samples(flight: Recording) -> list[Sample]:
    return list(samples_of(flight))


def off(tracker: MomentumTracker) -> np.ndarray:
    """Return how far the values are from the true ones, in standard deviations."""
    return (tracker.values - tracker.nominal) / tracker.sigmas


def test_a_wrong_prior_is_corrected_window_by_window(samples: list[Sample]):
    tracker = MomentumTracker(paper(), window=WINDOW)
    wide = tracker.sigmas
    wrong = np.random.default_rng(1).multivariate_normal(np.zeros(len(wide)), tracker.parameter_covariance)
    tracker._mean = tracker._mean + wrong
    heard: list[float] = []
    tracker.listener = lambda update: heard.append(update.time)
    told = [x for s in samples for x in tracker.update(s)]
    assert len(told) == 1  # modes are smoothed with the window after
    told += tracker.flush()
    assert [u.time for u in told] == heard == pytest.approx([13.95, 27.95, 40.0])
    assert np.abs(off(tracker)).max() < 4.0 and np.sqrt(np.mean(off(tracker) ** 2)) < 1.2
    i = tracker.names.index("link2.mx + 2 link3.m")
    assert tracker.sigmas[i] < 0.02 * wide[i] and told[0].sigmas[i] > told[-1].sigmas[i]
    # faster than the low-pass and the panel's described modes follow: residuals say so, and widen
    assert told[-1].normalised[3:].min() > 0.5 and 1.5 < told[-1].normalised.max() < 6.0


def test_a_shorter_memory_knows_less(samples: list[Sample]):
    known = []
    for memory in (None, 20.0, 10.0):
        tracker = MomentumTracker(paper(), window=WINDOW, memory=memory, cad=0.02)
        i = tracker.names.index("link2.mx + 2 link3.m")
        tracker._mean[i] *= 1.2
        tracker.update_all(samples)
        tracker.flush()
        known.append(tracker.sigmas[i])
        assert abs(off(tracker)[i]) < 4.0
    assert known[0] < known[1] < known[2] < 0.02 * tracker.nominal[i]


def test_a_second_recording_goes_on_where_the_first_ended(samples: list[Sample]):
    tracker = MomentumTracker(paper(), window=WINDOW)
    tracker.update_all(samples)
    tracker.flush()
    first = tracker.sigmas.copy()
    tracker.begin_recording()
    tracker.update_all(samples)
    tracker.flush()
    i = tracker.names.index("link3.mx")
    assert tracker.sigmas[i] < first[i] and np.abs(off(tracker)).max() < 4.0


def test_what_momentum_cannot_tell_is_refused(samples: list[Sample]):
    tracker = MomentumTracker(paper(), window=WINDOW)
    with pytest.raises(RecordingError, match="momentum is not conserved"):
        tracker.update(Sample.of(0.0, {"command.force": [1.0, 0.0, 0.0]}))
    moving = MomentumTracker(paper(), window=WINDOW)
    with pytest.raises(NotIdentifiableError, match="does not start at rest"):
        moving.update_all(s for s in samples if s.time > 3.0)
    with pytest.raises(RecordingError, match="A memory of 0"):
        MomentumTracker(paper(), memory=0.0)
    with pytest.raises(EstimateError, match="no Step B"):
        MomentumTracker(paper(), estimate=Estimate("paper_sms", "paper", (), (), {}))


def test_the_command_follows_by_momentum(flight: Recording, urdf, tmp_path):
    save_recording(flight, tmp_path / "flight.nc")
    words = ["track", str(urdf / "paper_sms.toml"), str(tmp_path / "flight.nc"), "--method"]
    files = ["-o", str(tmp_path / "track.nc"), "--report", str(tmp_path / "track.html")]
    run = CliRunner().invoke(app, [*words, "momentum", "--memory", "60", *files], catch_exceptions=False)
    assert run.exit_code == 0 and "link2.mx + 2 link3.m" in run.stdout
    history = xr.load_dataset(tmp_path / "track.nc", engine="h5netcdf")
    assert history.sizes["parameter"] == 30
    for wrong in (["momentum", "--follow", "bus.m"], ["filter", "--memory", "9"]):
        with pytest.raises(SmsidError, match=r"--follow is for|--memory is for"):
            CliRunner().invoke(app, [*words, *wrong], catch_exceptions=False)
    guessed = CliRunner().invoke(app, [*words, "guess"])
    assert guessed.exit_code == 2 and "'guess' is not one of 'filter', 'momentum'" in guessed.output


def test_hidden_states_are_carried_on(flight: Recording):
    model = build_model(paper())
    noisier = add_noise_replicate(flight, model.description.sensor, np.random.default_rng(0))
    whole = replace(prepare(model, flight), again=prepare(model, noisier))
    hidden = hidden_states(model, whole)
    edges = [0, 250, 500, len(whole)]
    carrier = HiddenStateCarrier(model)
    pushed = [carrier.push(m) for m in (*(whole.only(slice(a, b)) for a, b in pairwise(edges)), None)]
    assert pushed[0] is None  # a motion comes out when the one after it is there
    found = [chunk[1] for chunk in pushed[1:] if chunk is not None]
    assert [len(x.slosh["tank"][0]) for x in found] == np.diff(edges).tolist()
    for own, theirs in ((found, hidden), ([x.again for x in found], hidden.again)):
        assert theirs is not None
        for k in range(2):
            joined = np.concatenate([x.slosh["tank"][k] for x in own])
            np.testing.assert_allclose(joined, theirs.slosh["tank"][k], atol=1e-12)
        modes = np.concatenate([x.modes["panel"].position for x in own])
        expected = theirs.modes["panel"].position
        # what lies further ahead than the next piece hardly matters
        assert np.abs(modes - expected).max() < 0.01 * np.abs(expected).max()
