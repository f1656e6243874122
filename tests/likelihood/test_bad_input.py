"""Recordings as they should not be: inside the stated interval all the same, or refused with the reason."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.description import load_description
from smsid.errors import DescriptionError, RecordingError
from smsid.identify.valid_samples import outliers, spikes, usable_samples
from smsid.likelihood import Refinement, refine
from smsid.likelihood.nuisance_parameters import Nuisance
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.recording_term import piece_of
from smsid.likelihood.spline import DerivativeSamples, fit_motion
from smsid.model import build_model
from smsid.paths import urdf_folder
from smsid.recording import Recording

from . import faulty, twin
from .test_refine import FAR, TRUTH, off

OUTPUTS = ("imu.acceleration", "imu.angular_rate", "pose.position", "pose.velocity", "panel.acceleration")


def flown() -> Recording:
    return twin.noisy(twin.exp1((1, 1, 1), 60.0), 0)


def inside(found: Refinement) -> None:
    for name, truth in TRUTH.items():
        p = found.estimate[name]
        assert abs(p.value - truth) < FAR * p.sigma, f"{name}: {p.value} +- {p.sigma}"
    assert found.estimate["tank.mass"].relative_sigma < 2e-3


def test_one_sample_in_a_hundred_is_an_outlier():
    found = refine(off(), [faulty.changed(flown(), faulty.of(OUTPUTS, faulty.outliers))])
    inside(found)
    assert sum("far outside of their noise" in note for note in found.estimate.notes) == len(OUTPUTS)


@pytest.mark.parametrize(
    "dropped", [faulty.missing(20.0, 22.0), faulty.not_finite(20.0, 22.0)], ids=["missing", "not finite"]
)
def test_two_seconds_dropped_out(dropped: faulty.Change):
    inside(refine(off(), [faulty.changed(flown(), faulty.of(("imu.",), dropped))]))


def test_saturated_accelerometer():
    found = refine(off(), [faulty.changed(flown(), faulty.saturated("imu.acceleration"))])
    inside(found)
    assert any("imu.acceleration left out" in note for note in found.estimate.notes)


@pytest.mark.parametrize("sensor", ["pose", "panel"])
def test_a_clock_that_is_late_and_drifts(sensor: str):
    """The panel's accelerations jump with thrust: late by a sample they look like outliers."""
    found = refine(off(), [faulty.changed(flown(), faulty.late(sensor))])
    inside(found)
    own = {p.name: p for p in found.estimate.group("nuisance") if ".clock" in p.name}
    assert all(name.startswith(f"exp1: {sensor}.") for name in own)  # no other clock is blamed
    offset, drift = own[f"exp1: {sensor}.clock_offset"], own[f"exp1: {sensor}.clock_drift"]
    assert abs(offset.value - faulty.LATE) < FAR * offset.sigma
    assert abs(drift.value - faulty.DRIFT / (1.0 + faulty.DRIFT)) < FAR * drift.sigma
    assert any("clocks that do not agree" in note for note in found.estimate.notes)


def test_too_short_to_say_anything():
    recording = flown()
    with pytest.raises(RecordingError, match="too few"):
        refine(off(), [recording.window(0.0, 0.1)])
    found = refine(off(), [recording.window(0.0, 0.5)])
    assert found.estimate["tank.mass"].status == "not_identifiable"


def test_wheels_whose_rates_are_missing_are_refused():
    recording = twin.noisy(twin.exp2(10.0), 0)
    cut = faulty.changed(recording, faulty.of(("tachometer.",), faulty.missing(4.0, 6.0)))
    with pytest.raises(RecordingError, match="wheels' rates are missing"):
        piece_of(twin.model(), cut, Nuisance())


def test_joint_motion_with_spikes_and_a_gap():
    rng = np.random.default_rng(1)
    times = np.arange(0.0, 40.0, 0.01)
    angle, rate = np.sin(0.7 * times), 0.7 * np.cos(0.7 * times)
    samples = []
    for order, (values, sigma) in enumerate(((angle, 1e-5), (rate, 1e-4))):
        noisy = values + sigma * rng.standard_normal(len(times))
        noisy[rng.random(len(times)) < 0.01] += 50.0 * sigma
        noisy[[700, 702, 1500, 1501]] += 1e4 * sigma  # of two so near each other one hides the other
        noisy[rng.random(len(times)) < 0.001] = np.nan
        kept = (times < 20.0) | (times > 22.0)
        samples.append(DerivativeSamples(order, times[kept], noisy[kept, None], np.array([sigma])))
    motion = fit_motion(samples, 0.0, times[-1], 100.0, 0.1)
    assert motion.spacing > 0.5  # no knots were spent on spikes
    off_ = np.abs(motion.values(times)[0][:, 0] - angle)
    known = (times < 19.5) | (times > 22.5)
    assert off_[known].max() < 3e-5
    assert off_.max() < 0.02  # across the gap it goes on smoothly


def test_what_is_usable():
    values = np.array([[0.0, 1.0], [np.nan, 1.0], [3.0, 0.0], [1.0, -3.0]])
    np.testing.assert_array_equal(usable_samples(values, "acceleration", 3.0), [True, False, False, False])
    quaternions = np.array([[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.1]])
    np.testing.assert_array_equal(usable_samples(quaternions, "attitude", None), [True, False])
    rng = np.random.default_rng(0)
    noise = rng.standard_normal((2000, 1))
    assert usable_samples(noise, "velocity", None).all()
    assert usable_samples(np.round(noise), "velocity", None).all()  # quantised, not clipped
    clipped = usable_samples(np.minimum(noise, 1.0), "velocity", None)
    assert np.count_nonzero(~clipped) == np.count_nonzero(noise >= 1.0)


def test_outliers_are_told_from_noise():
    rng = np.random.default_rng(0)
    residual = rng.standard_normal((10_000, 2))
    assert not outliers(residual)[0].any()
    residual[::100, 1] += 30.0
    bad, sigma = outliers(residual)
    assert np.array_equal(np.flatnonzero(bad), np.arange(0, 10_000, 100))
    np.testing.assert_allclose(sigma, 1.0, rtol=0.03)
    # a distribution with long tails everywhere is not one with outliers
    assert not outliers(rng.standard_t(1.0, (10_000, 1)))[0].any()


def test_spikes_of_a_smooth_motion():
    times = np.arange(0.0, 10.0, 0.01)
    values = np.column_stack([np.sin(times), np.cos(times)]) + 1e-5 * np.random.default_rng(
        0
    ).standard_normal((1000, 2))
    assert not spikes(values, np.full(2, 1e-5)).any()
    values[[100, 500], 0] += 1e-3
    assert np.flatnonzero(spikes(values, np.full(2, 1e-5))).tolist() == [100, 500]


def test_an_arm_on_the_ground_is_told_apart_and_where_to_go(tmp_path):
    """A bare URDF has no keys to set."""
    text = (urdf_folder() / "arm3.urdf").read_text(encoding="utf-8")
    (tmp_path / "arm.urdf").write_text(text, encoding="utf-8")
    model = build_model(load_description(tmp_path / "arm.urdf").model_copy(update={"root": "fixed"}))
    with pytest.raises(DescriptionError, match=r"stands on the ground.*smsid new") as caught:
        Parameters.of(model)
    assert "Maximum likelihood" not in str(caught.value)
