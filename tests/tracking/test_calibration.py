"""What bands and alarms rest on: the density of what is read, parameters that wander, shared levels."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from smsid.estimation.flight import FlightOptions
from smsid.tracking import Tracker, track_recordings
from smsid.tracking._change_detection import ChangeDetector
from smsid.tracking._sample import samples_of
from smsid.tracking._setting import Setting

from .craft import craft, flight
from .test_change_detection import FOLLOW


@pytest.fixture(scope="module")
def description(tmp_path_factory):
    return craft(tmp_path_factory.mktemp("craft"))


@pytest.fixture(scope="module")
def recording():
    return flight(12.0)


def streaming(description):
    follow = {"bus.I*": 0.0}
    start = Tracker(description, follow=follow)
    channels = ("st.attitude", "gyro.angular_rate", "tacho.wheel_rate")
    setting = Setting.of(start.description, start.origin.base, channels=channels, hold="linear")
    return Tracker(description, follow=follow, setting=setting)


def test_the_likelihood_of_a_sample_is_the_density_of_its_errors(description, recording):
    tracker, found = streaming(description), []
    tracker.listener = found.append
    for sample in list(samples_of(recording))[:200]:
        tracker.update(sample)
    told = [c for c in found if len(c.rows)]
    assert len(told) > 20
    for c in told:
        whitening, errors = c.record.whitening[-1], c.record.errors[-1]
        covariance = np.linalg.inv(whitening.T @ whitening)
        density = multivariate_normal.logpdf(errors, cov=covariance) + 0.5 * len(c.rows) * np.log(2 * np.pi)
        # of numbers as large as the logarithms of small noise
        assert c.log_likelihood == pytest.approx(density, rel=1e-6, abs=1e-6)


def test_parameters_that_wander_are_known_less_well_for_it(description, recording):
    """Ten times as far in a second as they are known to in the end, when they stay."""
    options = FlightOptions(drive="command")
    still, _ = track_recordings(description, [recording], follow={"bus.I*": 0.0}, options=options)
    rate = 10.0 * float(still.sigmas[-1].max())
    wandering, _ = track_recordings(description, [recording], follow={"bus.I*": rate}, options=options)
    assert (wandering.sigmas[-1] > 2.0 * still.sigmas[-1]).all()


def test_alarms_are_shared_among_all_that_is_tested(description):
    """Bonferroni: tests in an hour, of every group, at every look, times the level are the alarms allowed."""
    detector = ChangeDetector.watch(Tracker(description, follow=FOLLOW, cad=0.01), false_alarms=0.5)
    groups, looks = len(detector._groups), 3.0  # 1 + 1 + 1/2 + 1/4 + ... in the time between two starts
    assert groups > 1
    tests = 3600.0 / detector.every * looks * groups
    assert detector.level * tests == pytest.approx(0.5)
